// The calibration of a scene, learned once and used for every query: the corrections of its
// geometry's depth, and the noise of its geometry and of the matches with its references. In a
// scene that holds a calibration a query gets the same pose alone and among others, in any order.
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

// The images whose matches with the references a calibration rests on.
enum class CalibratedBy { kReferences, kQueries };
template <>
inline constexpr auto kEnumNames<CalibratedBy> = std::to_array<EnumName<CalibratedBy>>({
    {CalibratedBy::kReferences, "references"},
    {CalibratedBy::kQueries, "queries"},
});

struct SceneCalibration {
  CalibratedBy by = CalibratedBy::kReferences;
  // The correction of each source's depth, in the order of the scene's sources; nullopt where it
  // stays as it is. Empty where no alignment was asked for.
  std::vector<std::optional<DepthAlignment>> depth = {};
  // The sigmas of the confidences beside each source's depth, nullopt where there are none. Empty
  // where no source has any.
  std::vector<std::optional<ConfidenceWorth>> confidences = {};
  // Noise of the lifted points, for the automatic filter, and of a query's matches; nullopt where
  // it is not known: each query then estimates its own.
  std::optional<MultiViewNoise> geometry_noise = std::nullopt;
  std::optional<SceneNoise> match_noise = std::nullopt;
};

struct CalibrationOptions {
  // The match noise is that of this localizer's estimates. Noise that its method, filter and
  // candidates do not use is not learned.
  LocalizerOptions localizer = {};
  // kAuto uses some 500 images; it is off where depth is known better than that or not used:
  // rendered references, methods and candidates without depth, the paper's refinement.
  AlignMode align = AlignMode::kAuto;
  // With kQueries noise is learned from the queries even where the references could tell it.
  CalibratedBy noise_by = CalibratedBy::kReferences;
  bool any_filter = false;  // geometry noise is also learned where no automatic filter uses it
  // Says whether the match noise may be learned from queries; not where they come one after the
  // other, as the first ones must not depend on later ones.
  bool queries_tell_match_noise = true;
  int threads = 0;
};

// Returns the scene with a calibration; a scene that has one already is returned as it is. Depth
// and geometry noise rest on the matches of the references with each other or, where `matches`
// holds none, on those of the queries; noise rests on 30 images, the same ones in whatever order
// they come. Rendered references do not show the noise of photographs: with them noise is learned
// from queries alone, and only by kQueries. The result does not depend on the number of threads.
Scene Calibrate(const Scene& scene, const std::shared_ptr<const MatchSource>& matches,
                std::span<const Query> queries, const CalibrationOptions& options);

// Returns the scene with its depth corrected by the calibration. Throws InputError where the
// calibration is of other sources of geometry or other references.
Scene Calibrated(const Scene& scene, std::shared_ptr<const SceneCalibration> calibration);

// Returns the sigmas of the confidences beside a source's depth; nullopt where they are not known.
std::optional<ConfidenceWorth> ConfidencesOf(const Scene& scene, size_t source);

// Convert a calibration to JSON and back, without loss. Throws InputError for text that is no
// calibration.
std::string FormatSceneCalibration(const SceneCalibration& calibration);
SceneCalibration ParseSceneCalibration(const std::string& text);

void WriteSceneCalibration(const std::filesystem::path& path, const SceneCalibration& calibration);
std::shared_ptr<const SceneCalibration> ReadSceneCalibration(const std::filesystem::path& path);

// Returns the scene with the depth of each of its sources corrected by matches between the
// references (indices refer to references.images). The points of SfM models stay: they agree with
// the references as they are.
Scene Aligned(const Scene& scene, AlignMode mode, std::span<const ReferenceMatch> matches,
              int threads);

}  // namespace raylift
