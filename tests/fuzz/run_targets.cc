// What describes a run: experiments, tasks, manifests.

#include "fuzz/fuzz_targets.h"
#include "jobs/job_status.h"
#include "jobs/manifest_file.h"
#include "localization/results/query_job.h"
#include "views/task_list.h"

#include "raylift/experiment/experiment.h"
#include "raylift/localization/result_files.h"

namespace raylift {
namespace {

std::vector<std::string> OneSeed(std::string_view seed) { return {std::string(seed)}; }

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

LocalizedQuery Localized() {
  LocalizedQuery query;
  query.name = "a.jpg";
  query.estimate.cam_from_world = Rigid3();
  query.estimate.covariance = Eigen::Matrix<double, 6, 6>::Identity();
  query.estimate.verdict = PoseVerdict::kLocalized;
  query.estimate.inliers_2d3d = {true, false};
  return query;
}

// Lines of a continuous run.
std::vector<std::string> ManifestSeeds() {
  const LocalizedQuery query = Localized();
  QueryRecord record{.key = "k", .localized = query, .diagnostics = FormatQueryDiagnostics(query)};
  record.joined = {.image = {query.name, Camera(), Rigid3()},
                   .covariance = PoseCovariance::Identity(),
                   .links = {{{1, 2}, {3, 4, 5}}}};
  return {"{\"command\": \"localize\", \"tasks\": 2}\n" + ToJsonLine(RunFacts{}) + "\n" +
          ToJsonLine(record) + "\n"};
}

}  // namespace

std::vector<FuzzTarget> RunFuzzTargets() {
  return {
      {"experiment_toml",
       [](std::string_view bytes) {
         ExpandGrid(ReadExperiment(PutFile("experiment.toml", bytes),
                                   [](const std::string&) { return std::nullopt; }));
       },
       [] { return OneSeed(kExperiment); },
       "${A} [[grid]] [[table]] [[figure]] [[claim]] every method score lo alpha align filter "
       "geometry scene where first second max_loss mode candidates {every} 9223372036854775807"},
      {"manifest",
       [](std::string_view bytes) {
         const auto file = PutFile("job/manifest.jsonl", bytes);
         RecordsOf(ReadTaskManifest(file, &IsReadableLine));
         ReadJobStatus(file.parent_path());
       },
       &ManifestSeeds,
       "\"name\" \"place\" \"key\" \"tasks\" \"shard\" \"queries\" \"joined\" \"links\" \"camera\" "
       "null -1 1e308 [[[["},
      {"query_diagnostics",
       [](std::string_view bytes) {
         const auto file = PutFile("queries.jsonl", bytes);
         ReadQueryDiagnostics(file);
       },
       [] { return std::vector{FormatQueryDiagnostics(Localized()) + "\n"}; },
       "\"covariance\" \"pose\" \"status\" \"verdict\" \"confidence\" null -1 1e308 1e-320 [[[["},
      {"image_size", [](std::string_view bytes) { ParseSize("--size", std::string(bytes)); },
       [] { return std::vector<std::string>{"640x480"}; }, "x 2147483648 -1"},
  };
}

}  // namespace raylift
