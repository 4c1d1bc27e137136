// All that is known of each query keypoint, together: where references show it, how deep the
// geometry has it there, and 3D points that come from elsewhere.

#pragma once

#include <span>
#include <vector>

#include "estimation/prepared_problem.h"
#include "estimation/solvers/p3p.h"
#include <Eigen/Core>

namespace raylift {

// A reference shows the keypoint (a 2D-2D match), and the geometry may say how far away.
struct Sighting {
  // n = image_from_ray (P - center), P in the local frame: the residual n.xy / n.z is in pixels.
  Eigen::Matrix3d image_from_ray;
  Eigen::Vector3d center;
  Eigen::Vector3d ray;        // unit
  double extra_variance_px2;  // of the reference's pixel, beyond a keypoint's own
  double log_distance;        // of the lifted point from the center, where there is one
  double depth_variance;      // that the lifted point's match carries, of log_distance
  int reference;
  bool has_depth;
};

// A 3D point that lies on no sighting's ray: of SfM, merged, or given without 2D-2D matches.
struct LoosePoint {
  Eigen::Vector3d point;  // local frame
  double variance;        // that the match carries, local units squared
};

// Each of the query's images in 4 x 4 parts.
inline constexpr int kPartsPerSide = 4;

// One keypoint; its parts are ranges of KeypointEvidence's lists.
struct KeypointParts {
  Eigen::Matrix3d image_from_cam;  // pixels, as a sighting's; axes of the query's own camera
  Eigen::Vector3d camera_center;   // of the camera that it is seen by, from the query's own
  int camera;
  Eigen::Vector2d px_by_log_focal;  // how what it sees moves with the focal length's logarithm
  int part_of_image;                // of the query's, below KeypointEvidence::num_parts
  int first_sighting, end_sighting;
  int first_loose, end_loose;

  // Of the camera that it is seen by, and a point as that camera sees it, at a pose of the query.
  Eigen::Vector3d CenterOfCamera(const SolverPose& pose) const {
    return pose.rotation.transpose() * (camera_center - pose.translation);
  }
  Eigen::Vector3d PointInCamera(const SolverPose& pose, const Eigen::Vector3d& point) const {
    return pose.rotation * point + pose.translation - camera_center;
  }
};

struct KeypointEvidence {
  std::vector<KeypointParts> keypoints;
  std::vector<Sighting> sightings;
  std::vector<LoosePoint> loose;
  // Of the references, local frame; and after them the middle of the loose points, which may be off
  // as a whole as a reference may.
  std::vector<Eigen::Vector3d> centers;
  double query_area_px2 = 1;
  int num_parts = kPartsPerSide * kPartsPerSide;  // of all images of the query
  double focal_px = 1000;

  size_t num_references() const { return centers.size() - 1; }
  std::span<const Sighting> SightingsOf(const KeypointParts& keypoint) const {
    return std::span(sightings).subspan(
        static_cast<size_t>(keypoint.first_sighting),
        static_cast<size_t>(keypoint.end_sighting - keypoint.first_sighting));
  }
  std::span<const LoosePoint> LooseOf(const KeypointParts& keypoint) const {
    return std::span(loose).subspan(static_cast<size_t>(keypoint.first_loose),
                                    static_cast<size_t>(keypoint.end_loose - keypoint.first_loose));
  }
};

KeypointEvidence GatherEvidence(const PoseProblem& original, const PreparedProblem& problem);

}  // namespace raylift
