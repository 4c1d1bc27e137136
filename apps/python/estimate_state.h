// Pose problems and estimates as pickles hold them.

#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "apps/python/pose_problem.h"

#include "raylift/estimation/pose_estimate.h"

namespace raylift::python {

// The problem in JSON, and its scene's noise or nothing.
using ProblemState = std::pair<std::string, std::string>;
ProblemState StateOf(const KnownProblem& problem);
std::shared_ptr<KnownProblem> ProblemOf(const ProblemState& state);

std::string StateOf(const PoseEstimate& estimate);
std::shared_ptr<PoseEstimate> EstimateOf(const std::string& state);

// What a notebook shows of an estimate.
std::vector<std::pair<std::string, std::string>> HtmlRowsOf(const PoseEstimate& estimate);

}  // namespace raylift::python
