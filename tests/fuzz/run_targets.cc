// What describes a run: experiments, tasks, manifests.

#include "fuzz/fuzz_targets.h"
#include "jobs/job_status.h"
#include "jobs/manifest_file.h"
#include "localization/continuous/checkpoint.h"
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

// The one query's record of a continuous run, which begins to read it where a former one has ended.
std::filesystem::path RecordFile() {
  for (const auto& entry : std::filesystem::directory_iterator(ScratchFolder() / "continuous")) {
    if (entry.path().filename() != "run.json") return entry.path();
  }
  return {};
}

ContinuousCheckpoint Checkpoint(bool resume) {
  return ContinuousCheckpoint(ScratchFolder() / "continuous", "key", resume);
}

std::vector<std::string> RecordSeeds() {
  const LocalizedQuery query = Localized();
  Checkpoint(false).Write(0, {query, FormatQueryDiagnostics(query), std::nullopt});
  return {TakeFile(RecordFile())};
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
       [] {
         return OneSeed(
             "{\"command\": \"localize\", \"tasks\": 2}\n{\"num_references\": 1}\n"
             "{\"name\": \"a.jpg\", \"place\": 0, \"key\": \"k\", \"warnings\": []}\n");
       },
       "\"name\" \"place\" \"key\" \"tasks\" \"shard\" \"queries\" null -1 1e308 [[[["},
      {"query_diagnostics",
       [](std::string_view bytes) {
         const auto file = PutFile("queries.jsonl", bytes);
         ReadQueryDiagnostics(file);
       },
       [] { return std::vector{FormatQueryDiagnostics(Localized()) + "\n"}; },
       "\"covariance\" \"pose\" \"status\" \"verdict\" \"confidence\" null -1 1e308 1e-320 [[[["},
      {"continuous_record",
       [](std::string_view bytes) {
         static const std::filesystem::path file = (RecordSeeds(), RecordFile());
         PutFile(file.lexically_relative(ScratchFolder()), bytes);
         Checkpoint(true).Read(0, {Localized().name, Camera()});
       },
       &RecordSeeds, "\"joined\" \"links\" \"camera\" \"diagnostics\" null -1 1e308 [[[["},
      {"image_size", [](std::string_view bytes) { ParseSize("--size", std::string(bytes)); },
       [] { return std::vector<std::string>{"640x480"}; }, "x 2147483648 -1"},
  };
}

}  // namespace raylift
