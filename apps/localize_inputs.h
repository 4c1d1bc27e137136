// What `raylift localize` works with, from its flags.

#pragma once

#include <memory>
#include <span>

#include "localize_flags.h"

#include "raylift/localization/batch_localizer.h"
#include "raylift/localization/scene.h"
#include "raylift/scene/query.h"

namespace raylift {

// The references, from a model or from the mesh alone, rendered for the queries' cameras.
Scene OpenSceneOf(const LocalizeFlags& flags, std::span<const Query> queries);

// A scene with its matches, ready to localize. Writes how depth was aligned, where it was.
std::unique_ptr<BatchLocalizer> OpenLocalizer(const LocalizeFlags& flags, const Scene& scene,
                                              std::span<const Query> queries, BatchOptions options);

}  // namespace raylift
