// Geometry whose depth is corrected per reference, for depth maps that do not agree with each other
// (monocular depth: each map has a scale and a slow drift of its own).

#pragma once

#include <array>
#include <cstddef>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "raylift/lifting/geometry_source.h"

namespace raylift {

// z becomes z * exp(log_factor(pixel)) + shift. The log factor is bilinear between the nodes of a
// grid spread over the image from corner to corner, row by row; a 1 x 1 grid is one factor.
struct DepthCorrection {
  int columns = 1;
  int rows = 1;
  std::vector<double> log_factors = {0};
  double shift = 0;  // scene units

  double Correct(double z, const Camera& camera, const Eigen::Vector2d& pixel) const;
};

// The nodes whose weighted sum is a grid's value at a pixel. Pixels outside the image take the
// border's value. A node may stand twice, with weight 0.
struct GridWeight {
  size_t node;
  double weight;
};
std::array<GridWeight, 4> GridWeights(int columns, int rows, const Camera& camera,
                                      const Eigen::Vector2d& pixel);

// Moves the points of a source along the rays of their reference pixels. References without a
// correction are left as they are; points whose corrected depth is not positive are dropped.
class AlignedSource final : public GeometrySource {
 public:
  AlignedSource(std::shared_ptr<const GeometrySource> source,
                std::map<std::string, DepthCorrection> correction_of_reference);

  std::string Description() const override;
  std::vector<std::optional<SurfacePoint>> Lift(
      const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const override;

 private:
  std::shared_ptr<const GeometrySource> source_;
  std::map<std::string, DepthCorrection> corrections_;
};

}  // namespace raylift
