// What became of a query, as Python holds it.

#pragma once

#include <memory>
#include <optional>
#include <utility>

#include "raylift/localization/localizer.h"

namespace raylift::python {

// A result with what the localizer that made it knew of the scene.
struct KnownResult : QueryResult {
  KnownResult() = default;
  KnownResult(QueryResult result, const Localizer& localizer)
      : QueryResult(std::move(result)), scene_noise(localizer.options().estimator.scene_noise) {}

  std::optional<SceneNoise> scene_noise;
};
using ResultPointer = std::shared_ptr<KnownResult>;

}  // namespace raylift::python
