// raylift evaluate: estimated poses against the ground truth.

#include <cstdio>

#include "commands.h"
#include "options.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/evaluation/pose_errors.h"
#include "raylift/evaluation/recall.h"
#include "raylift/evaluation/tables.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/query_list.h"

namespace raylift {
namespace {

using std::filesystem::path;

struct EvaluateFlags {
  path ground_truth;
  std::vector<path> poses;
  std::vector<std::string> names;
  std::string thresholds = "0.25,2:0.5,5:5,10";
  path json, csv;
  bool quiet = false;
};

PosesByName ReadPoses(const path& file) {
  PosesByName poses;
  for (const NamedPose& pose : ReadPoseFile(file)) {
    if (!poses.emplace(pose.name, pose.cam_from_world).second) {
      throw InputError(file, fmt::format("the name {} stands twice", pose.name));
    }
  }
  return poses;
}

PosesByName ReadGroundTruth(const path& model_or_file) {
  if (!std::filesystem::is_directory(model_or_file)) {
    return ReadPoses(model_or_file);
  }
  PosesByName poses;
  for (const PosedImage& image : ReadColmapModel(model_or_file).PosedImages()) {
    poses.emplace(image.name, image.cam_from_world);
  }
  return poses;
}

// Result files are mostly called poses.txt: then the folder tells them apart.
std::string ResultName(const path& file) {
  const std::string stem = file.stem().string();
  const std::string folder = file.parent_path().filename().string();
  return stem == "poses" && !folder.empty() ? folder : stem;
}

void Run(const EvaluateFlags& flags) {
  const std::vector<Threshold> thresholds = ParseThresholds(flags.thresholds);
  if (!flags.names.empty() && flags.names.size() != flags.poses.size()) {
    throw OptionError(
        fmt::format("--names: {} names for {} pose files", flags.names.size(), flags.poses.size()));
  }
  for (const path& output : {flags.json, flags.csv}) {
    if (!output.empty()) {
      RequireWritable(output);
    }
  }
  const PosesByName ground_truth = ReadGroundTruth(flags.ground_truth);
  std::vector<ResultSummary> results;
  for (size_t i = 0; i < flags.poses.size(); ++i) {
    const std::string name = flags.names.empty() ? ResultName(flags.poses[i]) : flags.names[i];
    results.push_back(Summarize(
        name, CompareWithGroundTruth(ground_truth, ReadPoses(flags.poses[i])), thresholds));
    const std::string warning = UnknownNamesWarning(results.back());
    if (!warning.empty()) {
      PrintWarning(warning);
    }
  }
  const ResultTable table{thresholds, results};
  if (!flags.json.empty()) {
    WriteFile(flags.json, FormatTableJson(table));
  }
  if (!flags.csv.empty()) {
    WriteFile(flags.csv, FormatTableCsv(table));
  }
  if (!flags.quiet) {
    fmt::print("{}", FormatTableText(table));
  }
}

}  // namespace

Command AddEvaluateCommand(CLI::App& program) {
  auto flags = std::make_shared<EvaluateFlags>();
  CLI::App* command =
      program.add_subcommand("evaluate", "Recalls and median errors of poses against the truth");
  command->add_option("--ground-truth", flags->ground_truth, "COLMAP model folder, or a pose file")
      ->required();
  command
      ->add_option("--poses", flags->poses,
                   "Pose files (name qw qx qy qz tx ty tz), one row of the table each")
      ->required();
  command->add_option("--names", flags->names, "Names of the rows (default: from the file names)");
  command
      ->add_option("--thresholds", flags->thresholds,
                   "Recall thresholds: position,degrees between colons")
      ->capture_default_str();
  command->add_option("--json", flags->json, "The table as JSON");
  command->add_option("--csv", flags->csv, "The table as CSV");
  command->add_flag("--quiet", flags->quiet, "Print no table");
  AddConfigOption(*command);
  command->footer(
      "Example:\n"
      "  raylift evaluate --ground-truth truth --poses p3p.txt adaptive.txt \\\n"
      "      --thresholds 0.05,5:0.1,1:0.25,2 --csv table.csv");
  return {command, [flags] { Run(*flags); }};
}

}  // namespace raylift
