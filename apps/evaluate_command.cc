// raylift evaluate: compares estimated poses with the ground truth.

#include <cstdio>
#include <map>

#include "apps/argument_files.h"
#include "apps/commands.h"
#include "apps/interrupt.h"
#include "apps/options.h"
#include "apps/pose_files.h"
#include "comparison/image_errors.h"
#include "evaluation/submission.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/comparison/report.h"
#include "raylift/evaluation/pose_errors.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/query_list.h"
#include "raylift/io/scene_file.h"
#include "raylift/lifting/geometry_spec.h"
#include "raylift/localization/result_files.h"
#include "raylift/localization/scene.h"

namespace raylift {
namespace {

using std::filesystem::path;

struct EvaluateFlags {
  path ground_truth;
  std::vector<path> poses;
  std::vector<std::string> names;
  std::string thresholds = "0.25,2:0.5,5:5,10";
  path groups;
  path json, csv;
  path trajectory_json, times;
  bool calibration = false;
  std::string geometry;
  path dcre_csv;
  bool submission = false;
  path queries, model, report;
  RunFlags run;
};

void Check(const EvaluateFlags& flags) {
  if (!flags.names.empty() && flags.names.size() != flags.poses.size()) {
    throw OptionError(
        fmt::format("--names: {} names for {} pose files", flags.names.size(), flags.poses.size()));
  }
  if (flags.submission && flags.queries.empty()) {
    throw OptionError("--check-submission needs --queries");
  }
  if (!flags.submission && flags.ground_truth.empty()) {
    throw OptionError("--ground-truth is required (a --scene has none where it is not public)");
  }
  if (flags.geometry.empty() && !flags.dcre_csv.empty()) {
    throw OptionError("--dcre-csv", flags.dcre_csv.string(), "needs --geometry");
  }
  if (flags.trajectory_json.empty() && !flags.times.empty()) {
    throw OptionError("--times", flags.times.string(), "needs --trajectory-json");
  }
  flags.run.Check();
}

// Prints and writes the APE and RPE of all results.
void EvaluateTrajectories(const EvaluateFlags& flags, const std::vector<std::string>& names,
                          const std::vector<TimedName>& order, const PosesByName& ground_truth,
                          const std::vector<PosesByName>& estimated) {
  std::vector<TrajectoryErrors> trajectories;
  for (size_t i = 0; i < estimated.size(); ++i) {
    const PosesByName matched = MatchNames(ground_truth, estimated[i]);
    std::vector<TrajectoryPose> poses;
    for (const auto& [time_s, name] : order) {
      if (!matched.contains(name)) continue;
      poses.push_back({matched.at(name), ground_truth.at(name)});
    }
    trajectories.push_back(CompareTrajectories(names[i], poses));
  }
  WriteFile(flags.trajectory_json, FormatTrajectoryJson(trajectories));
  if (!flags.run.quiet) fmt::print("{}", FormatTrajectoryText(trajectories));
}

// Prints what is wrong with each file; throws InputError at the end where anything is.
void CheckSubmissions(const EvaluateFlags& flags) {
  const std::vector<std::string> names = NamesOf(ReadQueryList(flags.queries));
  std::vector<Eigen::Vector3d> centers;
  if (!flags.model.empty()) {
    for (const PosedImage& image : ReadColmapModel(flags.model).PosedImages()) {
      centers.push_back(image.cam_from_world.OriginInSource());
    }
  }
  path first_wrong;
  size_t num_problems = 0;
  for (const path& file : flags.poses) {
    const SubmissionReport report = CheckSubmission(file, names, centers);
    if (!flags.run.quiet) {
      fmt::print("{}: poses of {} of {} queries, {} problems\n", file.string(), report.num_poses,
                 report.num_queries, report.problems.size());
      for (const auto* lines : {&report.problems, &report.remarks}) {
        for (const std::string& line : *lines) fmt::print("  {}\n", line);
      }
    }
    if (!report.problems.empty() && first_wrong.empty()) first_wrong = file;
    num_problems += report.problems.size();
  }
  if (num_problems > 0) {
    throw InputError(first_wrong,
                     fmt::format("not fit to be handed in ({} problems)", num_problems));
  }
}

// Returns the DCRE of each query of each result as CSV; shares of the diagonal in percent.
std::string FormatDcreCsv(const std::vector<std::string>& names,
                          const std::vector<std::vector<DcreQuery>>& results) {
  std::string text = "result,query,has_depth,points,mean_percent,max_percent\n";
  for (size_t r = 0; r < results.size(); ++r) {
    for (const DcreQuery& query : results[r]) {
      TableRow row = {names[r], query.name, query.has_depth ? "true" : "false", "0", "", ""};
      if (query.dcre) {
        row[3] = std::to_string(query.dcre->count);
        row[4] = fmt::format("{:.6g}", 100 * query.dcre->mean);
        row[5] = fmt::format("{:.6g}", 100 * query.dcre->max);
      }
      text += CsvLine(row);
    }
  }
  return text;
}

// Prints and writes the dense errors of all results.
void EvaluateDense(const EvaluateFlags& flags, const std::vector<std::string>& names,
                   const PosesByName& ground_truth, const std::vector<PosesByName>& estimated) {
  const std::vector<PosedImage> views = ReadPosedQueries(flags.ground_truth, flags.queries);
  const NamedGeometry geometry = MakeGeometrySource(
      flags.geometry,
      {.model = flags.ground_truth, .references = views, .threads = flags.run.threads});
  PrintWarnings(geometry.warnings);
  std::vector<PosesByName> matched;
  matched.reserve(estimated.size());
  for (const PosesByName& poses : estimated) matched.push_back(MatchNames(ground_truth, poses));
  constexpr int kPixels = 5000;
  const auto results = MeasureDcre(*geometry.source, views, matched, kPixels, flags.run.threads);
  if (!flags.dcre_csv.empty()) WriteFile(flags.dcre_csv, FormatDcreCsv(names, results));
  if (flags.run.quiet) return;
  std::vector<DcreSummary> summaries;
  for (size_t r = 0; r < results.size(); ++r) {
    summaries.push_back(SummarizeDcre(names[r], results[r]));
  }
  fmt::print("{}", FormatDcreText(summaries));
}

// Returns how well the covariances that localize has written beside the poses fit the true errors.
Calibration CalibrationOf(const path& poses_file, const PosesByName& estimated,
                          const PosesByName& ground_truth) {
  std::map<std::string, Eigen::Matrix<double, 6, 6>> covariances;
  for (const auto& query : ReadQueryDiagnostics(poses_file.parent_path() / "queries.jsonl")) {
    if (query.estimate.covariance) covariances[query.name] = *query.estimate.covariance;
  }
  std::vector<UncertainPose> poses;
  for (const auto& [name, pose] : MatchNames(ground_truth, estimated)) {
    const auto covariance = covariances.find(name);
    if (covariance == covariances.end()) continue;
    poses.push_back({pose, ground_truth.at(name), covariance->second});
  }
  return Calibrate(poses);
}

// Returns each result, followed by the same for each group of queries.
std::vector<ResultSummary> WithGroups(const std::vector<ResultSummary>& results,
                                      const PosesByName& ground_truth,
                                      const std::vector<PosesByName>& estimated,
                                      const std::vector<Threshold>& thresholds,
                                      const path& groups_file) {
  if (groups_file.empty()) return results;
  const std::map<std::string, std::string> groups = ReadGroups(groups_file);
  std::vector<ResultSummary> rows;
  for (size_t i = 0; i < results.size(); ++i) {
    rows.push_back(results[i]);
    const Comparison whole = CompareWithGroundTruth(ground_truth, estimated[i]);
    for (const auto& [group, comparison] : SplitByGroup(whole, groups)) {
      rows.push_back(
          Summarize(fmt::format("{}[{}]", results[i].name, group), comparison, thresholds));
    }
  }
  return rows;
}

// Writes the page, and the table beside it.
void WriteReport(const EvaluateFlags& flags, const std::vector<Threshold>& thresholds,
                 const PosesByName& ground_truth, const std::vector<PosesByName>& estimated,
                 const std::vector<ResultSummary>& summaries, const ResultTable& table) {
  std::vector<EvaluatedResult> results;
  for (size_t i = 0; i < estimated.size(); ++i) {
    results.push_back({summaries[i], CompareWithGroundTruth(ground_truth, estimated[i]),
                       MatchNames(ground_truth, estimated[i])});
  }
  WriteFile(flags.report / "index.html",
            FormatEvaluationReport(thresholds, results, ground_truth, "Raylift: results"));
  WriteFile(flags.report / "table.csv", FormatTableCsv(table));
  WriteFile(flags.report / "table.json", FormatTableJson(table));
}

void Run(const EvaluateFlags& flags) {
  const std::vector<Threshold> thresholds = ParseThresholds(flags.thresholds);
  Check(flags);
  if (flags.submission) CheckSubmissions(flags);
  if (flags.ground_truth.empty()) return;
  for (const path& output : {flags.json, flags.csv, flags.dcre_csv, flags.trajectory_json}) {
    if (!output.empty()) RequireWritable(output);
  }
  if (!flags.report.empty()) RequireWritable(flags.report / "index.html");
  const PosesByName ground_truth = ReadModelOrPoses(flags.ground_truth);
  std::vector<TimedName> order;
  if (!flags.trajectory_json.empty()) order = InOrderOfTime(ground_truth, flags.times);
  std::vector<PosesByName> estimated;
  std::vector<std::string> names;
  std::vector<ResultSummary> results;
  for (size_t i = 0; i < flags.poses.size(); ++i) {
    names.push_back(flags.names.empty() ? ResultName(flags.poses[i]) : flags.names[i]);
    estimated.push_back(ReadNamedPoses(flags.poses[i]));
    results.push_back(Summarize(
        names.back(), CompareWithGroundTruth(ground_truth, estimated.back()), thresholds));
    if (flags.calibration) {
      results.back().calibration = CalibrationOf(flags.poses[i], estimated.back(), ground_truth);
    }
    const std::string warning = UnknownNamesWarning(results.back());
    if (!warning.empty()) PrintWarning(warning);
  }
  const std::vector<ResultSummary> rows =
      WithGroups(results, ground_truth, estimated, thresholds, flags.groups);
  const ResultTable table{thresholds, rows};
  if (!flags.json.empty()) WriteFile(flags.json, FormatTableJson(table));
  if (!flags.csv.empty()) WriteFile(flags.csv, FormatTableCsv(table));
  if (!flags.run.quiet) {
    fmt::print("{}", FormatTableText(table));
    for (const ResultSummary& result : results) {
      const std::string missing = DescribeMissing(result);
      if (!missing.empty()) fmt::print("{}\n", missing);
    }
  }
  if (!flags.report.empty())
    WriteReport(flags, thresholds, ground_truth, estimated, results, table);
  if (!flags.trajectory_json.empty()) {
    EvaluateTrajectories(flags, names, order, ground_truth, estimated);
  }
  if (!flags.geometry.empty()) EvaluateDense(flags, names, ground_truth, estimated);
}

}  // namespace

Command AddEvaluateCommand(CLI::App& program) {
  auto flags = std::make_shared<EvaluateFlags>();
  CLI::App& command =
      AddCommand(program, "evaluate", "Recalls and median errors of poses against the truth");
  AddSceneOption(command);
  const OptionGroup options(command);
  options.Add("--ground-truth", flags->ground_truth, "COLMAP model folder, or a pose file");
  options
      .Add("--poses", flags->poses,
           "Pose files (name qw qx qy qz tx ty tz), one row of the table each")
      .Required();
  options.Add("--names", flags->names, "Names of the rows (default: from the file names)");
  options.Add(
      "--thresholds", flags->thresholds,
      "Recall thresholds: position,degrees between colons, or those of\n" + ThresholdPresetNames());
  options.Add("--groups", flags->groups,
              "Groups of queries (name group), such as day and night: one more row each");
  options.Flag("--calibration", flags->calibration,
               "Also how well the covariances fit that stand in queries.jsonl beside the\n"
               "poses: squared errors over them (1 where right), share within their 90 %");
  options.Add("--json", flags->json, "The table as JSON");
  options.Add("--csv", flags->csv, "The table as CSV");
  options.Add("--trajectory-json", flags->trajectory_json,
              "Also APE of the poses and RPE of the steps between them, as evo defines\n"
              "them, without alignment");
  options.Add("--times", flags->times,
              "Their order: lines `name seconds` of the ground truth (default: by name,\n"
              "img_2 before img_10)");
  options.Add("--report", flags->report,
              "Folder for one HTML page to look at (index.html), and the table");
  const OptionGroup dense(command, "Dense errors");
  dense.Add("--geometry", flags->geometry,
            "Also report how far the scene moves in the images (DCRE): a mesh,\n"
            "or depth maps of the queries. " +
                GeometryHelp());
  dense.Add("--dcre-csv", flags->dcre_csv, "DCRE of each query");
  const OptionGroup submission(command, "Submission");
  submission.Flag("--check-submission", flags->submission,
                  "Check that the files can be handed in at visuallocalization.net;\n"
                  "then --ground-truth is not required");
  submission.Add("--queries", flags->queries,
                 "List of queries: for --check-submission, and for --geometry where\n"
                 "the ground truth is a pose file");
  submission.Add("--model", flags->model,
                 "COLMAP model of the references, to tell where the scene is");
  AddRunOptions(command, flags->run);
  SetFooter(command,
            "Example:\n"
            "  raylift evaluate --ground-truth truth --poses p3p.txt adaptive.txt \\\n"
            "      --thresholds 0.05,5:0.1,1:0.25,2 --csv table.csv");
  return {&command, [flags] { UntilSignal([&] { Run(*flags); }, &BeginsAnew); }};
}

}  // namespace raylift
