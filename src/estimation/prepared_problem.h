// A pose problem made ready for estimation: checked once, in a frame of its own, and laid out for
// the kernels.
//
// The local frame is centered on the references and scaled by their spread, so that nothing that
// follows depends on the scene's unit or origin: local = (world - origin) / scale, axes unchanged.
//
// All cameras of a query that is a rig are turned into the axes of the query's own, so that they
// differ by their centers alone: camera k sees a point p of the query's frame at p - center_k. A pose
// is that of the query's own camera; PoseOfCamera() is another one's.

#pragma once

#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

#include "base/rng.h"
#include "estimation/kernels/blocks.h"
#include "estimation/prepared_priors.h"
#include "estimation/sigmas_of_threshold.h"
#include "estimation/solvers/p3p.h"
#include <Eigen/Core>

#include "raylift/geometry/rigid3.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

// By which factor an uncertain reference's pixel spreads more than a certain one's.
inline double SpreadOfReference(double reference_sigma_px, double threshold_px) {
  return std::hypot(1, kSigmasOfThreshold * reference_sigma_px / threshold_px);
}

struct PreparedPoint {
  Eigen::Vector3d ray;             // unit, axes of the query's own camera
  Eigen::Matrix3d image_from_ray;  // PixelFrame's, its pixel rows over the threshold
  Eigen::Vector3d point;           // local frame
  double sigma;                    // standard deviation that is known of it, local units
  double spread;                   // see kernels::PointBlock
  int match;                       // index into PoseProblem::matches_2d3d
  int camera = 0;                  // of the query's
  size_t keypoint = 0;             // of the query, below PreparedProblem::num_keypoints
};

struct PreparedPair {
  Eigen::Vector3d query_ray;                       // unit, axes of the query's own camera
  Eigen::Vector3d reference_ray;                   // unit, local (= world) axes
  Eigen::Matrix<double, 3, 2> query_gradient;      // d ray / d pixel times the threshold
  Eigen::Matrix<double, 3, 2> reference_gradient;  // the same, in local axes
  double reference_sigma_px;  // of the reference's pixel, beyond a keypoint's own
  double parallax;  // the angle between the rays that an error of one threshold can make, radians
  int reference;    // index into PoseProblem::references
  int match;        // index into PoseProblem::matches_2d2d
  int camera = 0;   // of the query's
  int view = 0;     // PreparedProblem::ViewOf() its camera and reference
  size_t keypoint = 0;  // of the query, below PreparedProblem::num_keypoints
};

// A run of `pairs` that belong to one reference and one camera of the query.
struct ReferenceRun {
  int reference;
  int camera;
  int view;
  int begin, end;
  int size() const { return end - begin; }
};

struct PreparedProblem {
  // `rng` shuffles the matches, so that any prefix of the blocks is a fair sample. `point_sigma`
  // (scene units) is the standard deviation of 3D points that carry none.
  PreparedProblem(const PoseProblem& problem, double point_threshold_px, double pair_threshold_px,
                  Rng& rng, double point_sigma = 0);

  Eigen::Vector3d origin_in_world;
  double scale;
  double reprojection_threshold_px;
  double sampson_threshold_px;

  // The matches that can count; matches that are not finite or have no ray are left out here but
  // stay in the totals.
  std::vector<PreparedPoint> points;  // grouped by camera
  std::vector<PreparedPair> pairs;    // grouped by reference, and by camera
  int num_matches_2d3d;
  int num_matches_2d2d;
  size_t num_keypoints;  // of the query, that matches are of (scene/keypoints.h)

  std::vector<Eigen::Vector3d> centers;  // of all references, local frame
  // Of the query's cameras, in the axes of its own and from its center: the first is zero.
  std::vector<Eigen::Vector3d> camera_centers;
  PreparedPriors priors;
  std::vector<ReferenceRun> runs;  // that have pairs

  std::vector<kernels::PointBlock<float>> point_blocks;
  std::vector<int> point_block_camera;
  std::vector<kernels::PairBlock<float>> pair_blocks;
  std::vector<int> pair_block_view;

  // What one camera of the query has in common with one reference; all views are below num_views().
  int ViewOf(int camera, int reference) const {
    return camera * static_cast<int>(centers.size()) + reference;
  }
  int CameraOf(int view) const { return view / static_cast<int>(centers.size()); }
  size_t num_views() const { return camera_centers.size() * centers.size(); }

  SolverPose PoseOfCamera(const SolverPose& pose, int camera) const {
    return {pose.rotation, pose.translation - camera_centers[static_cast<size_t>(camera)]};
  }

  SolverPose CamFromLocal(const Rigid3& cam_from_world) const;
  Rigid3 CamFromWorld(const SolverPose& cam_from_local) const;
};

// Fills blocks with some of the matches, in the given order; unused lanes are zero.
template <typename T>
struct PointBlocks {
  std::vector<kernels::PointBlock<T>> blocks;
  std::vector<int> block_camera;
  // The point in each lane, -1 for an unused one.
  std::vector<int> lane_point;
};
// `selection` must list the points of a camera next to each other.
template <typename T>
PointBlocks<T> MakePointBlocks(const std::vector<PreparedPoint>& points,
                               const std::vector<int>& selection);

template <typename T>
struct PairBlocks {
  std::vector<kernels::PairBlock<T>> blocks;
  std::vector<int> block_view;
  std::vector<int> lane_pair;  // as of the points
};
// `selection` must list the pairs of a view next to each other.
template <typename T>
PairBlocks<T> MakePairBlocks(const std::vector<PreparedPair>& pairs,
                             const std::vector<int>& selection);

}  // namespace raylift
