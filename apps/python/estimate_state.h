// The state of the module's pose problems and localized queries, and what pickles hold of them and
// of estimates.

#pragma once

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "raylift/estimation/match_noise.h"
#include "raylift/estimation/pose_estimator.h"
#include "raylift/localization/localizer.h"
#include "raylift/scene/pose_problem.h"

namespace raylift::python {

struct KnownProblem : PoseProblem {
  KnownProblem() = default;
  explicit KnownProblem(PoseProblem problem, std::optional<SceneNoise> noise = std::nullopt)
      : PoseProblem(std::move(problem)), scene_noise(noise) {}

  // The noise of matches by the calibration of the problem's scene.
  std::optional<SceneNoise> scene_noise;
};

// A result, with what its localizer knew of the scene.
struct KnownResult : QueryResult {
  KnownResult() = default;
  KnownResult(QueryResult result, const Localizer& localizer)
      : QueryResult(std::move(result)),
        scene_noise(localizer.options().estimator.scene_noise),
        surface(localizer.scene().Surface()) {}

  std::optional<SceneNoise> scene_noise;
  std::weak_ptr<const RayCaster> surface;  // of the scene, for pictures
};
using ResultPointer = std::shared_ptr<KnownResult>;

// The problem in JSON, and its scene's noise or nothing.
using ProblemState = std::pair<std::string, std::string>;
ProblemState StateOf(const KnownProblem& problem);
std::shared_ptr<KnownProblem> ProblemOf(const ProblemState& state);

std::string StateOf(const PoseEstimate& estimate);
std::shared_ptr<PoseEstimate> EstimateOf(const std::string& state);

// Returns the rows that a notebook shows of an estimate.
std::vector<std::pair<std::string, std::string>> HtmlRowsOf(const PoseEstimate& estimate);

}  // namespace raylift::python
