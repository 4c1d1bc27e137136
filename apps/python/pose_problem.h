// What the module's class PoseProblem holds.

#pragma once

#include <optional>
#include <utility>

#include "raylift/estimation/match_noise.h"
#include "raylift/scene/pose_problem.h"

namespace raylift::python {

struct KnownProblem : PoseProblem {
  KnownProblem() = default;
  explicit KnownProblem(PoseProblem problem, std::optional<SceneNoise> noise = std::nullopt)
      : PoseProblem(std::move(problem)), scene_noise(noise) {}

  // What the calibration of the scene that it is of says of matches.
  std::optional<SceneNoise> scene_noise;
};

}  // namespace raylift::python
