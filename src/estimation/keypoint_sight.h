// A keypoint in one image as the joint refinement sees it, and the densities that it compares.

#pragma once

#include <cmath>
#include <numbers>

#include "estimation/joint_noise.h"
#include <Eigen/Core>

namespace raylift {

// The residual of a ray in an image, pixels, and how it moves with the ray.
struct PixelResidual {
  bool in_front = false;
  Eigen::Vector2d error_px = Eigen::Vector2d::Zero();
  Eigen::Matrix<double, 2, 3> jacobian = Eigen::Matrix<double, 2, 3>::Zero();
};

inline PixelResidual ResidualOf(const Eigen::Matrix3d& image_from_ray, const Eigen::Vector3d& ray) {
  const Eigen::Vector3d n = image_from_ray * ray;
  PixelResidual residual;
  if (!(n.z() > 0)) return residual;
  const double inverse = 1 / n.z();
  residual.in_front = true;
  residual.error_px = n.head<2>() * inverse;
  residual.jacobian =
      (image_from_ray.topRows<2>() - residual.error_px * image_from_ray.row(2)) * inverse;
  return residual;
}

// Densities of normal distributions, by the squared distance from the mean.
inline double Normal1D(double squared, double variance) {
  return std::exp(-0.5 * squared / variance) / std::sqrt(2 * std::numbers::pi * variance);
}
inline double Normal2D(double squared, double variance) {
  return std::exp(-0.5 * squared / variance) / (2 * std::numbers::pi * variance);
}

// Of the logarithm of a point's distance that says nothing of the keypoint: any in the scene. As
// two of those that are differ, and none is impossible.
inline double DensityOfAnyDistance(const JointNoise& noise, double log_distance) {
  constexpr double kLeast = 1e-9;
  const double off = log_distance - noise.log_distance_mean;
  return Normal1D(off * off, 2 * noise.log_distance_variance) + kLeast;
}

}  // namespace raylift
