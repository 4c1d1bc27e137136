// Factors that make photographs of one surface look alike.

#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include <Eigen/Core>

namespace raylift {

// What a photograph shows at a point.
struct PointColor {
  size_t photograph;
  double weight;
  Eigen::Vector3d log_rgb;
};

// Factors for each channel of each photograph, of geometric mean 1, that make the logarithms at each
// point agree: weighted least squares, whose weights are Cauchy's where photographs disagree by more
// than they usually do. Photographs that share no point with others keep 1.
std::vector<Eigen::Vector3d> LevelExposures(size_t num_photographs,
                                            std::span<const std::vector<PointColor>> points);

}  // namespace raylift
