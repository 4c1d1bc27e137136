// The evidence of each query keypoint, gathered: where references show it, how deep the geometry
// has it there, and 3D points that come from elsewhere.

#pragma once

#include <algorithm>
#include <span>
#include <vector>

#include "estimation/problem/normalized_problem.h"
#include <Eigen/Core>

#include "raylift/geometry/camera.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

// An observation of a keypoint in a reference (a 2D-2D match), and its distance if the geometry has
// one.
struct Observation {
  // The residual n.xy / n.z with n = image_from_ray (P - center), P in the local frame, is in
  // pixels.
  Eigen::Matrix3d image_from_ray;
  Eigen::Vector3d center;
  Eigen::Vector3d ray;        // unit
  double extra_variance_px2;  // of the reference's pixel, beyond a keypoint's own
  double log_distance;        // of the lifted point from the center, where there is one
  double depth_variance;      // that the lifted point's match carries, of log_distance
  int reference;
  bool has_depth;
};

// Returns whether a reference shows a point within `within_px` of where its observation is.
inline bool IsShownBy(const Observation& observation, const Eigen::Vector3d& point,
                      double within_px) {
  const Eigen::Vector3d n = observation.image_from_ray * (point - observation.center);
  return n.z() > 0 && n.head<2>().norm() < within_px * n.z();
}

// A 3D point that lies on no observation's ray: of SfM, merged, or given without 2D-2D matches.
struct UnanchoredPoint {
  Eigen::Vector3d point;  // local frame
  double variance;        // that the match carries, local units squared
};

// Each of the query's images is divided into 4 x 4 cells.
inline constexpr int kImageCellsPerSide = 4;

// One keypoint; its parts are ranges of KeypointEvidence's lists.
struct KeypointObservations {
  Eigen::Matrix3d image_from_cam;  // pixels, as an observation's; axes of the query's own camera
  Eigen::Vector3d camera_center;   // of the camera that it is seen by, from the query's own
  int camera;
  Eigen::Vector2d px_by_log_focal;  // of its pixel by the focal length's logarithm
  int image_cell;                   // of the query's, below KeypointEvidence::num_image_cells
  int first_observation, end_observation;
  int first_unanchored, end_unanchored;

  // Return the center of the camera that the keypoint is seen by, and a point in that camera (the
  // query's axes), at a pose of the query.
  Eigen::Vector3d CenterOfCamera(const CamFromLocal& pose) const {
    return pose.rotation.transpose() * (camera_center - pose.translation);
  }
  Eigen::Vector3d PointInCamera(const CamFromLocal& pose, const Eigen::Vector3d& point) const {
    return pose.rotation * point + pose.translation - camera_center;
  }
};

struct KeypointEvidence {
  std::vector<KeypointObservations> keypoints;
  std::vector<Observation> observations;
  std::vector<UnanchoredPoint> unanchored;
  // Holds the references' centers in the local frame, then the middle of the unanchored points,
  // which may be off as a whole as a reference may.
  std::vector<Eigen::Vector3d> centers;
  double matched_area_px2 = 1;
  int num_image_cells = kImageCellsPerSide * kImageCellsPerSide;  // of all images of the query
  double focal_px = 1000;

  size_t num_references() const { return centers.size() - 1; }
  std::span<const Observation> ObservationsOf(const KeypointObservations& keypoint) const {
    return std::span(observations)
        .subspan(static_cast<size_t>(keypoint.first_observation),
                 static_cast<size_t>(keypoint.end_observation - keypoint.first_observation));
  }
  std::span<const UnanchoredPoint> UnanchoredOf(const KeypointObservations& keypoint) const {
    return std::span(unanchored)
        .subspan(static_cast<size_t>(keypoint.first_unanchored),
                 static_cast<size_t>(keypoint.end_unanchored - keypoint.first_unanchored));
  }
};

// Returns the standard deviation of ln(distance) that was learned of a lifted point; 0 where none
// was.
double LearnedDepthSigma(const PoseProblem& original, const NormalizedMatch2D3D& match);

KeypointEvidence GatherEvidence(const PoseProblem& original, const NormalizedProblem& problem);

// Cells are the n x n equal parts of an image, to tell what lies together from what is spread over
// it; those of a rig's images are numbered one image after the other.

// Returns a pixel's cell, below cells_per_side^2, row by row; pixels outside of the image are in
// the nearest cell.
inline int ImageCell(const Camera& camera, const Eigen::Vector2d& pixel, int cells_per_side) {
  const auto along = [&](double at, int size) {
    return static_cast<int>(std::clamp(at / size * cells_per_side, 0.0, cells_per_side - 1.0));
  };
  return along(pixel.y(), camera.height_px()) * cells_per_side +
         along(pixel.x(), camera.width_px());
}

// Returns the cell of a match's query pixel, below num_cameras() * cells_per_side^2.
template <typename Match>
int QueryImageCell(const PoseProblem& problem, const Match& match, int cells_per_side) {
  return match.camera * cells_per_side * cells_per_side +
         ImageCell(problem.CameraAt(match.camera), match.query_px, cells_per_side);
}

// Returns the area of the query's images over which its matches are spread, and wrong ones fall:
// that of a rectangle in which uniform pixels would have their covariance, of one image on average
// and no larger than it.
double MatchedAreaPx2(const PoseProblem& problem);

}  // namespace raylift
