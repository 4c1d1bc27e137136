// Estimates poses from the edges of a mesh in photographs, where nothing can be matched as the mesh
// has no colors. Each photograph needs a prior of its pose.

#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>

#include "raylift/estimation/pose_estimator.h"
#include "raylift/renderers/ray_caster.h"

namespace raylift {

class EdgeAligner final : public PoseEstimator {
 public:
  EdgeAligner(std::shared_ptr<const RayCaster> mesh, std::filesystem::path photographs,
              uint64_t seed);

  // Looks at the problem's name, camera and priors, a position and an orientation, alone. Where the
  // mesh shows too few edges, the pose is that of the prior, with no confidence. Throws InputError
  // where the photograph cannot be read or does not have its camera's size.
  PoseEstimate Estimate(const PoseProblem& problem) const override;

 private:
  std::shared_ptr<const RayCaster> mesh_;
  std::filesystem::path photographs_;
  uint64_t seed_;
};

}  // namespace raylift
