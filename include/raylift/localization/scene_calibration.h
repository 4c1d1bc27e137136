// What is known of a scene beyond its files, learned once and used for every query: how the depth
// of its geometry is corrected, and how noisy its geometry and the matches with its references are.
// In a scene that holds a calibration a query gets the same pose alone and among others, in any
// order.
//
//   Scene scene = Calibrate(OpenScene(...), matches, {}, {.localizer = options});
//   WriteSceneCalibration("scene_calibration.json", *scene.calibration);
//   ...
//   Scene again = Calibrated(OpenScene(...), ReadSceneCalibration("scene_calibration.json"));
//
// It is learned from the references where these can be matched with each other, as by the built-in
// front end: each is a query of the others. Files of matches often hold none between references;
// then queries are needed.

#pragma once

#include <array>
#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/base/enum_names.h"
#include "raylift/estimation/match_noise.h"
#include "raylift/lifting/consistency_filter.h"
#include "raylift/lifting/depth_alignment.h"
#include "raylift/lifting/depth_confidence.h"
#include "raylift/localization/localizer.h"
#include "raylift/localization/scene.h"

namespace raylift {

// Whose matches with the references a calibration rests on.
enum class CalibratedBy { kReferences, kQueries };
template <>
inline constexpr auto kEnumNames<CalibratedBy> = std::to_array<EnumName<CalibratedBy>>({
    {CalibratedBy::kReferences, "references"},
    {CalibratedBy::kQueries, "queries"},
});

struct SceneCalibration {
  CalibratedBy by = CalibratedBy::kReferences;
  // How the depth of each source is corrected, in the order of the scene's; nullopt where it is
  // left as it is. Empty where nothing was asked.
  std::vector<std::optional<DepthAlignment>> depth = {};
  // What the confidences beside each source's depth are worth, nullopt where there are none. Empty
  // where no source has any.
  std::vector<std::optional<ConfidenceWorth>> confidences = {};
  // Of the lifted points, for the automatic filter, and of a query's matches; nullopt where it is
  // not known: each query then finds its own.
  std::optional<MultiViewNoise> geometry_noise = std::nullopt;
  std::optional<SceneNoise> match_noise = std::nullopt;
};

struct CalibrationOptions {
  // Match noise is what this localizer's estimates find. What its method, filter and candidates
  // make no use of is not learned.
  LocalizerOptions localizer = {};
  // kAuto asks some 500 images, and is off where depth is known better than that, or not used:
  // rendered references, methods and candidates without depth, the paper's refinement.
  AlignMode align = AlignMode::kAuto;
  // kQueries: noise is learned from the queries even where the references could tell it.
  CalibratedBy noise_by = CalibratedBy::kReferences;
  bool any_filter = false;  // geometry noise is also learned where no automatic filter uses it
  // Whether queries may tell the match noise. They may not where they come one after the other, as
  // the first ones must not know of those that come later.
  bool queries_tell_match_noise = true;
  int threads = 0;
};

// Returns the scene with a calibration; a scene that has one already is returned as it is. Depth
// and geometry noise rest on the matches of the references with each other or, where `matches`
// holds none, on those of the queries; of 30 images the noise, the same ones whatever their order.
// Rendered references tell nothing of photographs: of them noise is learned from queries alone, and
// only by kQueries. The result does not depend on the number of threads.
Scene Calibrate(const Scene& scene, const std::shared_ptr<const MatchSource>& matches,
                std::span<const Query> queries, const CalibrationOptions& options);

// Returns the scene with its depth corrected as the calibration says. Throws InputError where that
// is of a scene with other sources of geometry or other references.
Scene Calibrated(const Scene& scene, std::shared_ptr<const SceneCalibration> calibration);

// Returns what is known of the confidences beside a source's depth; nullopt where nothing is.
std::optional<ConfidenceWorth> ConfidencesOf(const Scene& scene, size_t source);

// JSON both ways: what is parsed is what was formatted, to the last bit. Throws InputError for text
// that is no calibration.
std::string FormatSceneCalibration(const SceneCalibration& calibration);
SceneCalibration ParseSceneCalibration(const std::string& text);

void WriteSceneCalibration(const std::filesystem::path& path, const SceneCalibration& calibration);
std::shared_ptr<const SceneCalibration> ReadSceneCalibration(const std::filesystem::path& path);

// Returns the scene with the depth of its sources corrected, each by itself, by matches between the
// references (indices count in references.images). The points of SfM models stay: they agree with
// the references as they are.
Scene Aligned(const Scene& scene, AlignMode mode, std::span<const ReferenceMatch> matches,
              int threads);

}  // namespace raylift
