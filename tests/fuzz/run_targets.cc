// What describes a run: experiments, tasks, manifests.

#include "fuzz/fuzz_targets.h"

#include "raylift/experiment/experiment_file.h"
#include "raylift/experiment/grid.h"
#include "raylift/jobs/job_status.h"
#include "raylift/localization/query_manifest.h"
#include "raylift/views/task_list.h"

namespace raylift {
namespace {

std::vector<std::string> One(std::string_view seed) { return {std::string(seed)}; }

constexpr std::string_view kExperiment = R"(title = "The demo"
seeds = [0, 1]
[scenes.demo]
model = "model"
queries = "q.txt"
images = "images"
ground_truth = "truth"
thresholds = "0.1,1:0.25,2"
[scenes.demo.geometry]
mesh = "mesh:scene.obj"
noisy = { spec = "mesh:scene.obj", scale_sigma = 0.05 }
[filters."2 px"]
reprojection_px = 2
[[grid]]
every = [1, 2]
method = ["p3p", "e5p1", "adaptive"]
geometry = "mesh"
[[table]]
name = "methods"
rows = ["method", "score"]
columns = ["every"]
[[claim]]
text = "P3P wins"
where = { every = 1 }
first = { method = "p3p" }
second = { method = "e5p1" }
)";

}  // namespace

std::vector<FuzzTarget> RunFuzzTargets() {
  return {
      {"experiment_toml",
       [](std::string_view bytes) {
         ExpandGrid(ReadExperiment(PutFile("experiment.toml", bytes),
                                   [](const std::string&) { return std::nullopt; }));
       },
       [] { return One(kExperiment); },
       "${A} [[grid]] [[table]] [[figure]] [[claim]] every method score lo alpha align filter "
       "geometry scene where first second max_loss mode candidates {every} 9223372036854775807"},
      {"manifest",
       [](std::string_view bytes) {
         const auto file = PutFile("job/manifest.jsonl", bytes);
         RecordsOf(ReadTaskManifest(file, &IsReadableLine));
         ReadJobStatus(file.parent_path());
       },
       [] {
         return One(
             "{\"command\": \"localize\", \"tasks\": 2}\n{\"num_references\": 1}\n"
             "{\"name\": \"a.jpg\", \"place\": 0, \"key\": \"k\", \"warnings\": []}\n");
       },
       "\"name\" \"place\" \"key\" \"tasks\" \"shard\" \"queries\" null -1 1e308 [[[["},
      {"image_size", [](std::string_view bytes) { ParseSize("--size", std::string(bytes)); },
       [] { return std::vector<std::string>{"640x480"}; }, "x 2147483648 -1"},
  };
}

}  // namespace raylift
