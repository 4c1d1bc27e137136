// Accuracy and completeness of several sources against a mesh, image by image: memory holds a
// limited number of points of each, whatever the number of images and the size of the surface.

#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "raylift/comparison/surface_distance.h"
#include "raylift/evaluation/depth_errors.h"
#include "raylift/lifting/geometry_source.h"
#include "raylift/surfaces/triangle_mesh.h"

namespace raylift {

class SurfaceScorer {
 public:
  // `thresholds` ascend. What `views` see of the truth is what completeness is asked of.
  SurfaceScorer(const TriangleMesh& mesh, const GeometrySource& truth,
                std::span<const PosedImage> views, size_t num_sources,
                std::span<const double> thresholds, int threads);

  // What every source shows to the next view, in world coordinates; the truth's place is ignored.
  void Add(std::span<const std::vector<Eigen::Vector3d>> points_of_source, size_t truth);

  // One for each threshold; none for a source without points.
  std::vector<SurfaceScore> Score(size_t source) const;

 private:
  struct OfSource {
    explicit OfSource(double cell_size);
    ThinnedCloud cloud;
    std::vector<float> from_truth;  // of each of samples_, to the nearest point so far
  };

  std::vector<double> thresholds_;
  int threads_;
  SurfaceTree surface_;
  std::vector<Eigen::Vector3d> samples_;  // of the truth
  std::vector<OfSource> sources_;
};

// The pixel centers of every few pixels that surfaces are scored by.
std::vector<Eigen::Vector2d> ScoredPixels(const Camera& camera);

}  // namespace raylift
