// The relative pose of two calibrated cameras from five matches: the essential matrices by Nister
// (TPAMI 2004), with his elimination to a polynomial of degree ten in one unknown, decomposed by
// Horn's closed form (1990) and polished by Newton's method on the five epipolar equations.

#pragma once

#include <array>
#include <span>

#include <Eigen/Core>

namespace raylift {

inline constexpr int kMaxFivePointSolutions = 10;

// Essential matrices E with query_ray' E reference_ray = 0; returns their count.
int SolveEssential(const std::array<Eigen::Vector3d, 5>& query_rays,
                   const std::array<Eigen::Vector3d, 5>& reference_rays,
                   std::span<Eigen::Matrix3d, kMaxFivePointSolutions> essentials);

// query_from_reference up to the length of the translation, which is one.
struct RelativePose {
  Eigen::Matrix3d rotation;
  Eigen::Vector3d direction;
};

// The relative poses that put all five points in front of both cameras. Rays are unit vectors.
// All poses are finite, rotations orthogonal to rounding.
int SolveRelativePose(const std::array<Eigen::Vector3d, 5>& query_rays,
                      const std::array<Eigen::Vector3d, 5>& reference_rays,
                      std::span<RelativePose, kMaxFivePointSolutions> poses);

}  // namespace raylift
