// Gaussian splats to try things on: as files, and laid on a mesh.

#pragma once

#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "raylift/surfaces/triangle_mesh.h"

namespace raylift {

struct TestSplat {
  Eigen::Vector3d mean = {0, 0, 0};
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d scale = {1, 1, 1};
  double opacity = 0.99;
  std::vector<Eigen::Vector3f> harmonics = {{0, 0, 0}};  // 1, 4, 9 or 16
};

// The coefficient of degree 0 that makes this color (1: full intensity).
Eigen::Vector3f HarmonicOf(const Eigen::Vector3d& rgb);

// As the reference code and gsplat write it: kDiscs have two scales.
enum class SplatLayout { kEllipsoids, kDiscs };
std::string SplatPly(std::span<const TestSplat> splats, SplatLayout layout);

// Flat discs that cover a mesh in the colors of its texture or vertices: on a square lattice in
// each triangle's plane, `spacing` apart or as far as a small triangle has room for.
std::vector<TestSplat> DiscsOn(const TriangleMesh& mesh, double spacing);

}  // namespace raylift
