// Surfels: a point cloud as small discs that lie on the surface its points were measured on, so
// that rays can be cast at it.
//
// A disc lies in a plane through the k points nearest to its own. Its radius r is such that its mean
// squared distance from its center, r^2 / 2, is theirs. Then
//  - on average k discs cover a place of a surface that was sampled at random, whatever the density
//    is. RayCaster takes a place for a surface where their centers surround it: all but a share of
//    k exp(-k / 2) of its places (0.5 % for k = 16), and no place outside;
//  - where the surface is curved, the points' mean, through which the plane goes, lies behind it by
//    r^2 / 4R, as much as the discs that meet at a place lie before it on average: the mean of
//    their depths has no bias of second order.

#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "raylift/renderers/point_cloud.h"

namespace raylift {

struct SurfelOptions {
  std::optional<double> radius = std::nullopt;  // of all discs; none: by the local density
  int neighbors = 16;                           // k: more smooth more, and hold against more noise
  int threads = 0;                              // <= 0: all; never changes the result
};

struct Surfels {
  // Discs are float, relative to this origin, which is subtracted in double before rounding.
  Eigen::Vector3d origin_in_world = Eigen::Vector3d::Zero();
  std::vector<Eigen::Vector4f> discs;  // center and radius
  std::vector<Eigen::Vector3f> normals;
  // How far the points scatter about the discs' planes: standard deviation.
  std::vector<float> sigmas;
  std::vector<std::array<uint8_t, 3>> colors_rgb;  // empty where the cloud has none
  std::vector<std::string> warnings;

  size_t MemoryBytes() const;
};

// Points at one place count as one. Those of which no plane can be told (fewer than three places,
// or all on a line) are left out and counted. InputError where none is left.
Surfels MakeSurfels(PointCloud cloud, const SurfelOptions& options = {});

}  // namespace raylift
