// The input of a pose estimator for one query, between lifting and estimation. It holds no ground
// truth, so no estimator can use it. On disk it is the JSON format pose-problem/2 (io).

#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "raylift/geometry/camera.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// A query pixel and a reference pixel that show the same point.
struct Match2D2D {
  int reference = 0;  // index into PoseProblem::references
  Eigen::Vector2d query_px;
  Eigen::Vector2d reference_px;
  // Standard deviation (isotropic) of the reference pixel beyond a keypoint's own noise, where the
  // reference's pose is uncertain: that of the point's projection by the uncertain pose.
  std::optional<double> reference_sigma_px = std::nullopt;
  // The keypoint's index in the query and in the reference's image: matches of one keypoint have
  // equal indices. With matches from features these are the features' own. With nullopt it is not
  // known; equal pixels are one keypoint then (keypoints.h).
  std::optional<int> query_keypoint = std::nullopt;
  std::optional<int> reference_keypoint = std::nullopt;
  int camera = 0;  // index into the query's cameras: PoseProblem::CameraAt()
};

// A query pixel that shows a point of the scene.
struct Match2D3D {
  Eigen::Vector2d query_px;
  Eigen::Vector3d point_in_world;
  // The reference that it was lifted from; nullopt where there is none.
  std::optional<int> reference = std::nullopt;
  // Standard deviation of the point in scene units (isotropic), where the geometry source knows it.
  std::optional<double> point_sigma = std::nullopt;
  std::optional<int> query_keypoint = std::nullopt;  // as in Match2D2D
  // The 2D-2D match that it was lifted from, an index into PoseProblem::matches_2d2d; nullopt where
  // there is none.
  std::optional<size_t> match_2d2d = std::nullopt;
  int camera = 0;  // as in Match2D2D
  // Standard deviation of ln(distance) along the reference's ray; nullopt where it was not learned.
  std::optional<double> log_depth_sigma = std::nullopt;
};

// One more camera of a query that is a rig: photographs of one moment whose cameras' relative poses
// are known. They have one unknown pose together, that of the query's own camera.
struct RigCamera {
  std::string name = {};  // of its photograph
  Camera camera;
  Rigid3 cam_from_query;
};

// Standard deviations of the errors that all matches with a reference share, 0 being exact; nullopt
// where not known: estimated then, where references disagree.
struct ReferenceSigmas {
  // Sigma of the common factor of a reference's depths, as a share: single-image depth has a scale
  // known to some 10 %.
  std::optional<double> factor = std::nullopt;
  // Sigmas of a reference's pose, about and along each axis.
  std::optional<double> rotation_deg = std::nullopt;
  std::optional<double> position = std::nullopt;  // scene units
};

struct PoseProblem {
  std::string name;  // the query's
  Camera query_camera;
  std::vector<RigCamera> other_cameras;  // where the query is a rig
  std::vector<PosedImage> references;
  // The covisibility cluster of each reference, numbered from 0; empty where it is not known.
  std::vector<int> reference_clusters;
  std::vector<Match2D2D> matches_2d2d;
  std::vector<Match2D3D> matches_2d3d;
  PosePriors priors;
  ReferenceSigmas reference_sigmas = {};
  // The area of the query in which each match was looked for, and where wrong ones fall; nullopt
  // where that is what the matches cover.
  std::optional<double> search_area_px2 = std::nullopt;

  // Counts the cameras: the query's own camera is 0, the others follow.
  int num_cameras() const { return 1 + static_cast<int>(other_cameras.size()); }
  bool HasCamera(int index) const { return index >= 0 && index < num_cameras(); }
  const Camera& CameraAt(int index) const {
    return index == 0 ? query_camera : other_cameras[static_cast<size_t>(index - 1)].camera;
  }
};

}  // namespace raylift
