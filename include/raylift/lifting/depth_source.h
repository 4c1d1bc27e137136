// Depth maps as a source of geometry.

#pragma once

#include <memory>
#include <string>

#include "raylift/lifting/depth_folder.h"
#include "raylift/lifting/depth_sampling.h"
#include "raylift/lifting/geometry_source.h"
#include "raylift/lifting/surface_limits.h"

namespace raylift {

class DepthSource final : public GeometrySource {
 public:
  DepthSource(std::string description, std::shared_ptr<const DepthFolder> maps,
              const DepthSamplingOptions& sampling = {}, const SurfaceLimits& limits = {});

  std::string Description() const override;
  std::vector<std::optional<SurfacePoint>> Lift(
      const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const override;

 private:
  std::string description_;
  std::shared_ptr<const DepthFolder> maps_;
  DepthSamplingOptions sampling_;
  SurfaceLimits limits_;
};

// Lifts pixels by one map that is already in memory.
std::vector<std::optional<SurfacePoint>> LiftByDepthMap(const DepthMap& map,
                                                        const PosedImage& reference,
                                                        std::span<const Eigen::Vector2d> pixels,
                                                        const DepthSamplingOptions& options = {});

}  // namespace raylift
