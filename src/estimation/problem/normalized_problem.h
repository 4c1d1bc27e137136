// A pose problem made ready for estimation: checked once, in a frame of its own, and laid out for
// the kernels.
//
// The local frame is centered on the references and scaled by their spread, so that nothing that
// follows depends on the scene's unit or origin: local = (world - origin) / scale, axes unchanged.
//
// All cameras of a query that is a rig are turned into the axes of the query's own, so that they
// differ by their centers alone: camera k sees a point p of the query's frame at p - center_k. A
// pose is that of the query's own camera; PoseOfCamera() is another one's.

#pragma once

#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

#include "base/rng.h"
#include "estimation/kernels/kernels.h"
#include "estimation/problem/cam_from_local.h"
#include "estimation/problem/priors.h"
#include "estimation/problem/repeats.h"
#include <Eigen/Core>

#include "raylift/geometry/rigid3.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

// Returns the standard deviation of an uncertain reference's pixel over that of a certain one's.
inline double ReferenceSigmaFactor(double reference_sigma_px, double threshold_px) {
  return std::hypot(1, kSigmasOfThreshold * reference_sigma_px / threshold_px);
}

struct NormalizedMatch2D3D {
  Eigen::Vector3d ray;             // unit, axes of the query's own camera
  Eigen::Matrix3d image_from_ray;  // PixelFrame's, its pixel rows over the threshold
  Eigen::Vector3d point;           // local frame
  double sigma;                    // standard deviation of the point, local units
  double variance_at_unit_depth;   // see kernels::Block2D3D
  int match;                       // index into PoseProblem::matches_2d3d
  int camera = 0;                  // of the query's
  size_t keypoint = 0;             // of the query, below NormalizedProblem::num_keypoints
};

struct NormalizedMatch2D2D {
  Eigen::Vector3d query_ray;                       // unit, axes of the query's own camera
  Eigen::Vector3d reference_ray;                   // unit, local (= world) axes
  Eigen::Matrix<double, 3, 2> query_gradient;      // d ray / d pixel times the threshold
  Eigen::Matrix<double, 3, 2> reference_gradient;  // the same, in local axes
  double reference_sigma_px;  // of the reference's pixel, beyond a keypoint's own
  double parallax;  // the angle between the rays that an error of one threshold can make, radians
  int reference;    // index into PoseProblem::references
  int match;        // index into PoseProblem::matches_2d2d
  int camera = 0;   // of the query's
  int camera_reference = 0;  // NormalizedProblem::CameraReferenceIndex()
  size_t keypoint = 0;       // of the query, below NormalizedProblem::num_keypoints
};

// The consecutive 2D-2D matches that one camera of the query has with one reference.
struct MatchGroup {
  int reference;
  int camera;
  int camera_reference;
  int begin, end;
  int size() const { return end - begin; }
};

// Returns the derivative of what a camera sees at a pixel by the focal length's logarithm, px; zero
// for a panorama, which has no focal length.
inline Eigen::Vector2d PxByLogFocal(const Camera& camera, const Eigen::Vector2d& pixel) {
  if (camera.is_panorama()) return Eigen::Vector2d::Zero();
  return pixel - camera.principal_point_px();
}

// The uncertainty of the query's focal length, by the same share for all of its cameras.
struct FocalUncertainty {
  double sigma = 0;  // of its logarithm; 0: it is exact, and the lists are empty
  // These are the derivatives of the pixels of the matches in use by that logarithm
  // (PxByLogFocal()).
  std::vector<Eigen::Vector2d> px_2d3d, px_2d2d;
};

// Blocks of selected matches, in the given order; unused lanes are zero.
template <typename T>
struct Blocks2D3D {
  std::vector<kernels::Block2D3D<T>> blocks;
  std::vector<int> block_camera;
  // Holds the index of the point in each lane, -1 for an unused one.
  std::vector<int> lane_match;
};
// Fills blocks with the selected points. `selection` must list the points of a camera next to each
// other.
template <typename T>
Blocks2D3D<T> MakeBlocks2D3D(const std::vector<NormalizedMatch2D3D>& points,
                             const std::vector<int>& selection);

template <typename T>
struct Blocks2D2D {
  std::vector<kernels::Block2D2D<T>> blocks;
  std::vector<int> block_camera_reference;
  std::vector<int> lane_match;  // as of the points
};
// Fills blocks with the selected matches. `selection` must list the matches of a camera-reference
// pair next to each other.
template <typename T>
Blocks2D2D<T> MakeBlocks2D2D(const std::vector<NormalizedMatch2D2D>& pairs,
                             const std::vector<int>& selection);

struct NormalizedProblem {
  // `rng` shuffles the matches, so that any prefix of the blocks is a fair sample. `point_sigma`
  // (scene units) is the standard deviation of 3D points that carry none. Pixels that are no
  // farther apart than `same_within_px` show one feature (repeats.h).
  NormalizedProblem(const PoseProblem& problem, double threshold_2d3d_px, double threshold_2d2d_px,
                    Rng& rng, double point_sigma = 0, double same_within_px = 0);

  Eigen::Vector3d origin_in_world;
  double scale;
  ReferenceSigmas reference_sigmas;
  double reprojection_threshold_px;
  double sampson_threshold_px;

  // The matches that can count; matches that are not finite or have no ray are left out here but
  // stay in the totals. Repeats are in neither.
  std::vector<NormalizedMatch2D3D> matches_2d3d;  // grouped by camera
  std::vector<NormalizedMatch2D2D> matches_2d2d;  // grouped by reference, and by camera
  Repeats repeats;
  int num_matches_2d3d;
  int num_matches_2d2d;
  size_t num_keypoints;  // of the query, that matches are of (scene/keypoints.h)

  std::vector<Eigen::Vector3d> centers;  // of all references, local frame
  // The centers of the query's cameras, in the axes of its own and from its center: the first is
  // zero.
  std::vector<Eigen::Vector3d> camera_centers;
  NormalizedPriors priors;
  FocalUncertainty focal;
  std::vector<MatchGroup> groups_2d2d;  // none is empty

  std::vector<kernels::Block2D3D<float>> blocks_2d3d;
  std::vector<int> block_camera_2d3d;
  std::vector<kernels::Block2D2D<float>> blocks_2d2d;
  std::vector<int> block_camera_reference_2d2d;
  // The same matches in their own order, for exact residuals.
  Blocks2D3D<double> exact_2d3d;
  Blocks2D2D<double> exact_2d2d;

  // Makes the query's focal length uncertain, its logarithm by this standard deviation. `original`
  // is the problem that this one was made of.
  void TakeFocalSigma(const PoseProblem& original, double sigma);
  // Changes the matches to what a focal length longer by this share shows. The focal length must be
  // uncertain. The blocks are then in the order of the matches.
  void TakeFocalError(double share);

  // Numbers the pairs of a camera of the query and a reference, below num_camera_references().
  int CameraReferenceIndex(int camera, int reference) const {
    return camera * static_cast<int>(centers.size()) + reference;
  }
  int CameraOf(int camera_reference) const {
    return camera_reference / static_cast<int>(centers.size());
  }
  size_t num_camera_references() const { return camera_centers.size() * centers.size(); }

  CamFromLocal PoseOfCamera(const CamFromLocal& pose, int camera) const {
    return {pose.rotation, pose.translation - camera_centers[static_cast<size_t>(camera)]};
  }

  CamFromLocal ToLocal(const Rigid3& cam_from_world) const;
  Rigid3 ToWorld(const CamFromLocal& cam_from_local) const;

 private:
  void FillExactBlocks();
};

// ToKernelPose() returns a pose as the kernels take it, CentersInCam() for each camera-reference
// pair the reference's center from the camera's, in the query's axes.
template <typename T>
kernels::KernelPose<T> ToKernelPose(const CamFromLocal& pose);
template <typename T>
std::vector<T> CentersInCam(const NormalizedProblem& problem, const CamFromLocal& pose);

// Calls use(camera, begin, count) for each run of blocks that are of one camera. `camera_of(i)` is
// the camera of block i.
template <typename CameraOf, typename Use>
void ForEachCamera(int begin, int count, const CameraOf& camera_of, const Use& use) {
  for (int i = begin; i < begin + count;) {
    const int camera = camera_of(i);
    int end = i + 1;
    while (end < begin + count && camera_of(end) == camera) ++end;
    use(camera, i, end - i);
    i = end;
  }
}

// The match sets that take part.
enum class MatchSets { k2D3D, k2D2D, kBoth };
constexpr bool Has2D3D(MatchSets sets) { return sets != MatchSets::k2D2D; }
constexpr bool Has2D2D(MatchSets sets) { return sets != MatchSets::k2D3D; }

// Matches with a smaller squared residual than this, three thresholds, may become inliers in a few
// steps of the pose.
inline constexpr double kNearSquared = 9;

// The squared residual over the squared threshold of every match of some sets (the others' lists
// stay empty), in double precision; infinite where a match lies behind a camera.
struct Residuals {
  std::vector<double> of_2d3d;
  std::vector<double> of_2d2d;
};
Residuals ComputeResiduals(const NormalizedProblem& problem, const CamFromLocal& pose,
                           MatchSets sets = MatchSets::kBoth);

}  // namespace raylift
