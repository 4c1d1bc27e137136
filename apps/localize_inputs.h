// What `raylift localize` works with, from its flags.

#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "apps/localize_flags.h"
#include "localization/batch_localizer.h"

#include "raylift/localization/match_source.h"
#include "raylift/localization/scene.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// References come from a model or from the mesh alone, rendered for the queries' cameras.
struct LocalizeInputs {
  Scene scene;
  std::vector<Query> queries;
};
LocalizeInputs OpenLocalizeInputs(const LocalizeFlags& flags);

// Extracts the features that OpenLocalizer() would, of the flags' shard.
FeatureCount PrepareFeatures(const LocalizeFlags& flags, const LocalizeInputs& inputs,
                             uint64_t seed);

// A scene with its matches, ready to localize. Writes how depth was aligned, where it was.
std::unique_ptr<BatchLocalizer> OpenLocalizer(const LocalizeFlags& flags, const Scene& scene,
                                              std::span<const Query> queries, BatchOptions options);

}  // namespace raylift
