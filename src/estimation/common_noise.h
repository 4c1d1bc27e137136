// The noise that the problems of one scene have in common, as their estimates find it.

#pragma once

#include <cstddef>
#include <functional>
#include <optional>

#include "raylift/estimation/match_noise.h"
#include "raylift/estimation/options.h"
#include "raylift/estimation/pose_estimator.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

// Learns the noise from some 30 of `count` problems, evenly spaced; nullopt where they are too few
// to tell or the options make no use of it. `problem_at` is called from several threads.
std::optional<SceneNoise> LearnSceneNoise(size_t count,
                                          const std::function<PoseProblem(size_t)>& problem_at,
                                          const EstimatorOptions& options, int threads);

}  // namespace raylift
