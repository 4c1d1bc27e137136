// Finds the turns of a camera about its center from which a photograph shows the edges of a scene
// best.

#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "localization/alignment/edge_image.h"
#include "localization/alignment/scene_edges.h"
#include <Eigen/Core>
#include <Eigen/Geometry>

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"

namespace raylift {

// Returns the directions of the middles of a picture's borders and of its corners, each as the
// angle from the axis in its direction.
std::vector<Eigen::Vector2d> BorderAngles(const Camera& camera);

// Scores all turns up to an angle, on a grid whose cells are a pixel wide. A turn about an axis
// across the view shifts the picture, so that the evidence around each piece of an edge, added up
// over all pieces, gives the scores of a whole window of turns at once.
class EdgeTurns {
 public:
  static constexpr size_t kMost = 2000;  // pieces of edges

  // The image must outlive this. Turns are as coarse as cells of `cell_px` pixels.
  EdgeTurns(const EdgeImage& image, int cell_px, double most_rad);

  const Camera& camera() const { return camera_; }  // whose pixels are cells

  double most_rad() const { return most_rad_; }
  // Returns the least angle of a window's side from its center.
  double ReachRad() const { return 0.5 * kWindow / camera_.MeanFocalPx(); }

  struct Scored {
    Rigid3 cam_from_world;
    double score;  // about EdgeScore(); pieces count alike
  };
  // Returns the best turn up to half a window away.
  Scored BestOfWindow(std::span<const SceneEdge> edges, const Rigid3& cam_from_world) const;
  // Returns the best turn of each window: one for each step of the roll and of both other angles.
  std::vector<Scored> BestOfWindows(std::span<const SceneEdge> edges,
                                    const Rigid3& cam_from_world) const;

  // Returns how many turns are scored that differ by more than edges are wide.
  size_t NumTried() const;

 private:
  static constexpr int kWindow = 16;  // turns per side of a window

  using Sums = std::array<int16_t, size_t{kWindow} * kWindow>;
  Sums SumsOf(std::span<const SceneEdge> edges, const Rigid3& cam_from_world) const;
  void MakeScores();

  const EdgeImage& image_;
  int cell_px_;
  double most_rad_;
  Camera camera_;
  int stride_, rows_;
  double least_cosine_ = 0;  // of rays with the lens's axis that may fall into a window
  std::array<std::vector<int16_t>, EdgeImage::kDirections> scores_;
  std::vector<Eigen::Quaterniond> turns_;  // of the windows' centers
};

}  // namespace raylift
