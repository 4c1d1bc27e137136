// raylift estimate: pose problems in, poses out. Needs no geometry.

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <map>
#include <memory>
#include <optional>

#include "commands.h"
#include "options.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/evenly_spaced.h"
#include "raylift/base/file.h"
#include "raylift/base/json_text.h"
#include "raylift/base/option_checks.h"
#include "raylift/base/parallel.h"
#include "raylift/base/progress.h"
#include "raylift/base/text.h"
#include "raylift/base/text_table.h"
#include "raylift/geometry/pose_json.h"
#include "raylift/io/pose_problem_json.h"
#include "raylift/io/query_list.h"
#include "raylift/localization/estimate_json.h"
#include "raylift/localization/localizer.h"

namespace raylift {
namespace {

using std::filesystem::path;

struct EstimateFlags {
  std::vector<path> problems;
  path csv, json, poses;
  int repeat = 1;
  bool independent = false;
  FilterFlags filter;
  EstimatorFlags estimator;
  RunFlags run;
};

struct Row {
  std::string name;
  PoseEstimate estimate;
  double time_ms = 0;

  bool ok() const { return ReasonNotLocalized(estimate).empty(); }
  PoseVerdict verdict() const { return ok() ? estimate.verdict : PoseVerdict::kFailed; }
  double confidence() const { return ok() ? estimate.confidence : 0; }
};

std::string FormatCsv(const std::vector<Row>& rows, std::string_view method) {
  std::string text = CsvLine({"name", "method", "status", "qw", "qx", "qy", "qz", "tx", "ty", "tz",
                              "inliers_2d3d", "inliers_2d2d", "iterations", "solver", "time_ms",
                              "verdict", "confidence", "rotation_sigma_deg", "position_sigma"});
  for (const Row& row : rows) {
    const PoseEstimate& estimate = row.estimate;
    TableRow fields = {row.name, std::string(method),
                       row.ok() ? "ok" : ReasonNotLocalized(estimate)};
    if (estimate.cam_from_world) {
      const Eigen::Quaterniond& q = estimate.cam_from_world->rotation;
      const Eigen::Vector3d& t = estimate.cam_from_world->translation;
      for (const double number : {q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z()}) {
        fields.push_back(FormatDouble(number));
      }
    } else {
      fields.resize(fields.size() + 7);
    }
    fields.push_back(std::to_string(estimate.score_2d3d.num_inliers));
    fields.push_back(std::to_string(estimate.score_2d2d.num_inliers));
    fields.push_back(std::to_string(estimate.iterations));
    fields.emplace_back(estimate.cam_from_world ? ToString(estimate.solver) : "");
    fields.push_back(fmt::format("{:.3f}", row.time_ms));
    fields.emplace_back(ToString(row.verdict()));
    fields.push_back(FormatDouble(row.confidence()));
    for (const double sigma : {estimate.rotation_sigma_deg, estimate.position_sigma}) {
      fields.push_back(estimate.covariance ? FormatDouble(sigma) : "");
    }
    text += CsvLine(fields);
  }
  return text;
}

std::vector<path> ListAll(const std::vector<path>& files_or_folders) {
  std::vector<path> files;
  for (const path& entry : files_or_folders) {
    const auto listed = ListPoseProblems(entry);
    files.insert(files.end(), listed.begin(), listed.end());
  }
  return files;
}

std::string FormatJson(const std::vector<Row>& rows, std::string_view method) {
  nlohmann::ordered_json json = nlohmann::ordered_json::array();
  for (const Row& row : rows) {
    const PoseEstimate& estimate = row.estimate;
    nlohmann::ordered_json object = {{"name", row.name},
                                     {"method", method},
                                     {"status", row.ok() ? "ok" : ReasonNotLocalized(estimate)},
                                     {"verdict", ToString(row.verdict())},
                                     {"confidence", row.confidence()},
                                     {"inliers_2d3d", estimate.score_2d3d.num_inliers},
                                     {"inliers_2d2d", estimate.score_2d2d.num_inliers},
                                     {"time_ms", row.time_ms}};
    if (estimate.cam_from_world) {
      object.update(PoseJson<nlohmann::ordered_json>(*estimate.cam_from_world));
    }
    AddEstimate(estimate, object);
    json.push_back(std::move(object));
  }
  return JsonText(json, 1) + '\n';
}

// The estimate, and the median time of `repeat` runs, which all give the same.
Row Estimate(const PoseEstimator& estimator, const PoseProblem& problem, int repeat) {
  Row row{.name = problem.name, .estimate = {}, .time_ms = 0};
  std::vector<double> times_ms;
  for (int i = 0; i < repeat; ++i) {
    const auto start = std::chrono::steady_clock::now();
    row.estimate = estimator.Estimate(problem);
    const std::chrono::duration<double, std::milli> elapsed =
        std::chrono::steady_clock::now() - start;
    times_ms.push_back(elapsed.count());
  }
  std::sort(times_ms.begin(), times_ms.end());
  row.time_ms = times_ms[times_ms.size() / 2];
  return row;
}

// A pose file holds a name once.
void RequireDistinctNames(const std::vector<path>& files, const std::vector<Row>& rows) {
  std::map<std::string_view, size_t> first;
  for (size_t i = 0; i < rows.size(); ++i) {
    const auto [other, is_new] = first.emplace(rows[i].name, i);
    if (!is_new) {
      throw InputError(files[i], "name",
                       fmt::format("\"{}\" stands twice (also in {}): --poses needs distinct names",
                                   rows[i].name, files[other->second].string()));
    }
  }
}

PoseProblem ReadFiltered(const path& file, const FilterOptions& filter) {
  PoseProblem problem = ReadPoseProblem(file).problem;
  FilterProblem(filter, problem);
  return problem;
}

// What some 30 of the problems have in common, the same ones whatever their order.
std::optional<SceneNoise> LearnSceneNoise(std::vector<path> files, const EstimateFlags& flags,
                                          const FilterOptions& filter,
                                          const EstimatorOptions& options) {
  constexpr size_t kProblems = 30;
  if (flags.independent || !UsesSceneNoise(options) || files.size() < kLeastForCommonNoise) {
    return std::nullopt;
  }
  std::sort(files.begin(), files.end());
  const auto estimator = MakePoseEstimator(options);
  const std::vector<size_t> sample = EvenlySpaced(files.size(), kProblems);
  std::vector<PoseEstimate> estimates(sample.size());
  ParallelFor(estimates.size(), flags.run.threads, [&](size_t i) {
    estimates[i] = estimator->Estimate(ReadFiltered(files[sample[i]], filter));
  });
  return CommonNoise(estimates);
}

std::vector<Row> EstimateAll(const std::vector<path>& files, const EstimateFlags& flags,
                             const FilterOptions& filter, const PoseEstimator& estimator) {
  std::vector<Row> rows(files.size());
  Progress progress("problems", files.size(), flags.run.Show());
  ParallelFor(files.size(), flags.run.threads, [&](size_t i) {
    rows[i] = Estimate(estimator, ReadFiltered(files[i], filter), flags.repeat);
    progress.Advance();
  });
  return rows;
}

void Run(const EstimateFlags& flags) {
  RequireAtLeast("--repeat", flags.repeat, 1);
  EstimatorOptions options = flags.estimator.Resolve();
  FilterOptions filter = flags.filter.Resolve();
  filter.few_points = FewPointsFor(options.method);
  flags.run.Check();
  for (const path& output : {flags.csv, flags.json, flags.poses}) {
    if (!output.empty()) {
      RequireWritable(output);
    }
  }
  const std::vector<path> files = ListAll(flags.problems);
  options.scene_noise = LearnSceneNoise(files, flags, filter, options);
  const std::vector<Row> rows = EstimateAll(files, flags, filter, *MakePoseEstimator(options));
  if (!flags.csv.empty()) {
    WriteFile(flags.csv, FormatCsv(rows, ToString(options.method)));
  }
  if (!flags.json.empty()) {
    WriteFile(flags.json, FormatJson(rows, ToString(options.method)));
  }
  std::vector<NamedPose> poses;
  for (const Row& row : rows) {
    if (row.ok()) {
      poses.push_back({row.name, *row.estimate.cam_from_world});
    } else if (!flags.run.quiet) {
      fmt::print("no pose: {}: {}\n", row.name, ReasonNotLocalized(row.estimate));
    }
  }
  if (!flags.poses.empty()) {
    RequireDistinctNames(files, rows);
    WritePoseFile(flags.poses, poses);
  }
  if (!flags.run.quiet) {
    fmt::print("{}: {} of {} problems have a pose\n", ToString(options.method), poses.size(),
               rows.size());
  }
}

}  // namespace

Command AddEstimateCommand(CLI::App& program) {
  auto flags = std::make_shared<EstimateFlags>();
  CLI::App* command = program.add_subcommand(
      "estimate", "Poses from pose problems (JSON files of matches); needs no geometry");
  command->add_option("problems", flags->problems, "Files, or folders of .json files")->required();
  command->add_option("--csv", flags->csv, "One row per problem")->group("Output");
  command->add_option("--json", flags->json, "One object per problem")->group("Output");
  command->add_option("--poses", flags->poses, "Pose file: name qw qx qy qz tx ty tz")
      ->group("Output");
  command->add_flag("--independent", flags->independent,
                    "The problems are not of one scene: none tells of the noise of another's\n"
                    "matches (where Adaptive estimates both kinds together)");
  command
      ->add_option("--repeat", flags->repeat,
                   "Estimate each problem N times; time_ms is the median")
      ->capture_default_str()
      ->group("Running");
  AddFilterOptions(*command, flags->filter);
  AddEstimatorOptions(*command, flags->estimator);
  AddRunOptions(*command, flags->run);
  command->footer(
      "Example:\n"
      "  raylift estimate problems --method select --alpha 0.9 --csv select.csv");
  return {command, [flags] { Run(*flags); }};
}

}  // namespace raylift
