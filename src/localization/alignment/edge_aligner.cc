#include "localization/alignment/edge_aligner.h"

#include <algorithm>
#include <utility>

#include "base/rng.h"
#include "estimation/methods/methods.h"
#include "localization/alignment/edge_search.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/io/image_file.h"

namespace raylift {

namespace {

PosePrior PriorOf(const PoseProblem& problem) {
  const auto& position = problem.priors.position;
  const auto& orientation = problem.priors.orientation;
  RAYLIFT_CHECK(position && orientation);
  // A prior that is exact is searched with this sigma.
  constexpr double kLeastSigma = 1e-4;
  const Eigen::Quaterniond& rotation = orientation->cam_from_world;
  return {.cam_from_world = {rotation, -(rotation * position->position)},
          .sigma_position = position->sigma.cwiseMax(kLeastSigma),
          .sigma_deg = std::max(kLeastSigma, orientation->sigma_deg)};
}

}  // namespace

EdgeAligner::EdgeAligner(std::shared_ptr<const RayCaster> mesh, std::filesystem::path photographs,
                         uint64_t seed)
    : mesh_(std::move(mesh)), photographs_(std::move(photographs)), seed_(seed) {}

PoseEstimate EdgeAligner::Estimate(const PoseProblem& problem) const {
  const PosePrior prior = PriorOf(problem);
  const std::filesystem::path file = photographs_ / problem.name;
  const Image gray = ReadImage(file, ImageChannels::kGray);
  RequireSizeOf(problem.query_camera, problem.name, {gray.width_px, gray.height_px}, file);
  const FoundByEdges found = [&] {
    try {
      return SearchByEdges(mesh_, gray, problem.query_camera, prior,
                           StreamSeed(seed_, problem.name, "edges"));
    } catch (const InputError& error) {
      throw InputError(fmt::format("{}: {}", problem.name, error.what()));
    }
  }();
  PoseEstimate estimate;
  estimate.verdict = PoseVerdict::kDoubtful;
  if (found.modes.empty()) {
    estimate.cam_from_world = prior.cam_from_world;
    return estimate;
  }
  const EdgeFit& fit = found.modes.front().fit;
  estimate.cam_from_world = fit.cam_from_world;
  SetCovariance(fit.covariance, estimate);
  estimate.confidence = ConfidenceOf(found);
  estimate.alternatives = AlternativesOf(found);
  if (estimate.confidence >= kLocalizedConfidence) estimate.verdict = PoseVerdict::kLocalized;
  return estimate;
}

}  // namespace raylift
