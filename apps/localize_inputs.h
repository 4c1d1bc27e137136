// Opens the scene, queries and matches that `raylift localize` works with, as its flags say.

#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "apps/localize_flags.h"

#include "raylift/localization/localize_all.h"
#include "raylift/localization/match_source.h"
#include "raylift/localization/scene.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// References come from a model or from the mesh alone, rendered for the queries' cameras.
struct LocalizeInputs {
  Scene scene;
  std::vector<Query> queries;
  std::optional<WorldFrame> world;
};
LocalizeInputs OpenLocalizeInputs(const LocalizeFlags& flags);

// Returns the references and the geometry alone; `queries` say what cameras references are rendered
// for.
Scene OpenSceneOf(const LocalizeFlags& flags, std::span<const Query> queries);
// Returns the coordinate system of the world: the given one, else the one that the geometry's files
// name; nullopt where neither is known. Where the two lie apart, the scene's warnings say so.
std::optional<WorldFrame> WorldOf(const std::optional<WorldFrame>& given, Scene& scene);
// Returns the scene with the calibration of --scene-calibration, where that is given.
Scene WithKnownCalibration(const LocalizeFlags& flags, Scene scene);

// Returns the first surface that may look like the photographs; null where there is none.
std::shared_ptr<const RayCaster> PicturedSurface(const Scene& scene);

// Opens the matches of the queries.
std::unique_ptr<MatchSource> OpenMatchesOf(const LocalizeFlags& flags, const Scene& scene,
                                           std::span<const Query> queries, uint64_t seed);

// Extracts the features of the flags' shard that OpenMatchesOf() would.
FeatureCount PrepareFeatures(const LocalizeFlags& flags, const LocalizeInputs& inputs,
                             uint64_t seed);

// Returns a scene with its matches, ready to localize.
std::unique_ptr<LocalizeAll> OpenLocalizer(const LocalizeFlags& flags, const Scene& scene,
                                           std::span<const Query> queries,
                                           LocalizeAllOptions options);

// Writes scene_calibration.json and, where depth was corrected, depth_alignment.jsonl. Returns
// warnings: where queries could tell what the references do not.
std::vector<std::string> WriteCalibration(const LocalizeFlags& flags, const Scene& scene,
                                          const EstimatorOptions& estimator);

// Returns the warnings of the input or, where there are none, those of its depths' factors, which
// mean nothing where the input is misread. Returns neither where the input is not to be examined.
std::vector<std::string> InputOrDepthWarnings(const LocalizeFlags& flags,
                                              std::vector<std::string> of_input,
                                              const Scene& scene);

}  // namespace raylift
