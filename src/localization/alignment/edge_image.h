// Computes the edges of a photograph at one size, and the evidence of each pixel for or against an
// edge of the scene there: how near the next edge of that direction is, against how near one is by
// chance.

#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "raylift/geometry/camera.h"
#include "raylift/scene/image.h"

namespace raylift {

// A pixel on an edge, where the gradient's magnitude has a maximum along the gradient.
struct EdgePixel {
  Eigen::Vector2f position_px;  // within the pixel, or next to it
  Eigen::Vector2f normal;       // unit, either way
};

class EdgeImage {
 public:
  // Edges have one of so many directions; those of the next ones count as alike.
  static constexpr int kDirections = 12;

  // Takes an image of the camera's size. `sigma_px` is the standard deviation of the distance
  // between edges of the scene and of the photograph.
  EdgeImage(const Image& gray, const Camera& camera, double sigma_px);

  const Camera& camera() const { return camera_; }
  std::span<const EdgePixel> edges() const { return edges_; }

  // Returns, less 1, the likelihood ratio of the photograph here if it shows an edge of the scene
  // across `normal` (any length, not 0) and if it does not: with the density n of the distance d of
  // an edge from where the scene's is, and 2 r exp(-2 r d) that of the nearest one by chance, r of
  // them being crossed per pixel in this neighborhood,
  //   n(d) / (2 r) + P(the edge is beyond d) - 1.
  // Returns 0, which is no evidence, outside the picture.
  double Evidence(const Eigen::Vector2d& pixel, const Eigen::Vector2d& normal) const {
    if (!(pixel.x() >= 0 && pixel.y() >= 0 && pixel.x() < width_ && pixel.y() < height_)) return 0;
    return evidence_[Direction(normal)]
                    [Index(static_cast<int>(pixel.x()), static_cast<int>(pixel.y()))];
  }
  double EvidenceAt(int x, int y, size_t direction) const {
    return evidence_[direction][Index(x, y)];
  }
  static size_t Direction(const Eigen::Vector2d& normal);
  // Returns how many edges of this direction are crossed per pixel by chance.
  double ChanceRate(const Eigen::Vector2d& pixel, const Eigen::Vector2d& normal) const;

  // Returns the edge of about this direction that is the nearest one along the unit normal, up to
  // `reach_px` away.
  std::optional<EdgePixel> NearestAlong(const Eigen::Vector2d& pixel, const Eigen::Vector2d& normal,
                                        double reach_px) const;

 private:
  size_t Index(int x, int y) const {
    return static_cast<size_t>(y) * static_cast<size_t>(width_) + static_cast<size_t>(x);
  }
  void FindEdges(const Image& gray);
  void MakeEvidence(double sigma_px);

  Camera camera_;
  int width_, height_;
  std::vector<EdgePixel> edges_;
  std::vector<int32_t> edge_at_;  // index of the pixel's edge, or -1
  std::array<std::vector<float>, kDirections> evidence_;
  std::array<std::vector<float>, kDirections> rate_;
};

}  // namespace raylift
