#include "apps/localize_output.h"

#include <filesystem>
#include <optional>

#include "lifting/alignment_text.h"
#include "localization/results/exports.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/io/image_file.h"
#include "raylift/io/pose_problem_json.h"
#include "raylift/io/query_list.h"
#include "raylift/localization/scene_calibration.h"

namespace raylift {
namespace {

using std::filesystem::path;

// Returns the file of a query of its own: its folders and its extension are kept, as a.jpg and
// a.png may both be queries; nothing leaves `folder`.
path FileOfQuery(const path& folder, const std::string& query, const char* extension) {
  return PathBelow(folder, query) += extension;
}

}  // namespace

LocalizeOutput::LocalizeOutput(const LocalizeFlags& flags, size_t num_queries,
                               std::shared_ptr<const RayCaster> mesh)
    : flags_(flags), query_images_(flags.QueryImages()), mesh_(std::move(mesh)) {
  RequireWritable(flags.out / "poses.txt");
  if (!flags.report.empty()) {
    RequireWritable(flags.report / "index.html");
    report_ = std::make_unique<LocalizationReport>(LocalizationReportOptions{
        .num_queries = num_queries,
        .query_images = query_images_,
        .reference_images = flags.images.empty() ? query_images_ : flags.images,
        .mesh = mesh_,
        .ground_truth =
            flags.ground_truth.empty() ? PosesByName() : ReadModelOrPoses(flags.ground_truth),
        .folder = flags.report});
  }
  if (!flags.write_problems.empty()) RequireWritable(flags.write_problems / "problem.json");
}

std::vector<path> LocalizeOutput::Show(size_t index, const QueryResult& result) {
  LapClock clock;
  const CommittedFiles written(CommittedFiles::Sync::kByPromise);
  const std::string& name = result.localized.name;
  // A rig has one problem, which is written with the photograph that it belongs to.
  const bool is_of_another = !result.localized.rig.empty() && result.localized.rig != name;
  if (!flags_.write_problems.empty() && !is_of_another) {
    WritePoseProblem(FileOfQuery(flags_.write_problems, name, ".json"),
                     {result.rig_problem.value_or(result.problem), std::nullopt});
  }
  if (static_cast<int>(index) < flags_.pictures && result.localized.localized() &&
      mesh_ != nullptr) {
    const Image photograph = ReadImage(query_images_ / name, ImageChannels::kRgb);
    WriteImage(FileOfQuery(flags_.out / "pictures", name, ".jpg"),
               DrawQueryPicture(result, photograph, *mesh_, 1));
  }
  if (report_) report_->Take(index, result);
  show_seconds_ += clock.Lap();
  return written.paths();
}

void LocalizeOutput::Finish(const std::vector<LocalizedQuery>& localized, const Run& run,
                            const std::string& options_json) const {
  WriteFile(flags_.out / "options.json", options_json);
  if (report_) {
    WriteFile(flags_.report / "index.html",
              report_->Format(
                  "Raylift: " + flags_.out.string(), run.scene.references.images, run.warnings,
                  run.walked != nullptr ? std::optional(ReportedWalk{*run.walked, run.queries})
                                        : std::nullopt));
  }
  if (!flags_.write_model.empty()) {
    WriteColmapModel(flags_.write_model,
                     LocalizedModel(run.scene.references, run.queries, localized),
                     ColmapForm::kBinary);
  }
  if (!flags_.run.quiet) Print(localized, run);
}

void LocalizeOutput::Print(const std::vector<LocalizedQuery>& localized, const Run& run) const {
  for (size_t i = 0; i < run.scene.sources.size(); ++i) {
    const SceneSource& source = run.scene.sources[i];
    if (source.geometry.kind == GeometryKind::kDepth) {
      fmt::print("read {} as {}\n", source.spec, source.geometry.interpretation);
    }
    if (source.alignment && source.alignment->mode != AlignMode::kOff) {
      fmt::print("aligned {} {}\n", source.spec, Describe(*source.alignment));
    }
    if (const auto worth = ConfidencesOf(run.scene, i)) {
      fmt::print("{}: {}\n", source.spec, Describe(*worth));
    }
  }
  size_t count = 0;
  for (const LocalizedQuery& query : localized) count += query.localized() ? 1 : 0;
  size_t doubtful = 0;
  for (const LocalizedQuery* query : NotLocalizedOrDoubtful(localized)) {
    if (!query->localized()) {
      fmt::print("not localized: {}: {}\n", query->name, query->reason);
      continue;
    }
    ++doubtful;
    fmt::print("doubtful: {}: right with probability {:.2g}, {} of {} keypoints are inliers\n",
               query->name, query->confidence(), query->estimate.inlier_keypoints,
               query->estimate.num_keypoints);
  }
  if (const RerenderCounts counts = CountRerendered(localized); counts.asked) {
    fmt::print("rendered again: {} poses sharpened in {} rounds\n", counts.improved,
               counts.rounds_kept);
  }
  if (flags_.continuous.enabled) {
    fmt::print("{} localized queries joined the references\n", run.joined);
  }
  const std::string of_which = doubtful > 0 ? fmt::format(" ({} doubtful)", doubtful) : "";
  fmt::print("{}\n", Describe(run.times, localized));
  fmt::print("localized {} of {} queries{} against {} references: {}\n", count, localized.size(),
             of_which, run.scene.references.images.size(), (flags_.out / "poses.txt").string());
}

}  // namespace raylift
