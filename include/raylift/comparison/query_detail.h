// What one method made of one query, for people who want to know why.

#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "raylift/estimation/options.h"
#include "raylift/estimation/pose_estimate.h"
#include "raylift/evaluation/pose_errors.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

struct QueryDetail {
  size_t retrieved = 0, matched = 0, hit = 0, consistent = 0;
  size_t inliers_2d3d = 0, inliers_2d2d = 0;
  std::string solver;  // that the pose comes from; empty without a pose
  std::optional<Rigid3> cam_from_world;
  // Select's two poses.
  struct Candidate {
    std::string solver;
    PoseError error;
    size_t inliers_2d2d = 0;  // what Select decides by
    bool chosen = false;
  };
  std::vector<Candidate> candidates;
  // Lifted keypoints of the query, evenly thinned.
  struct Keypoint {
    Eigen::Vector2d pixel;
    bool is_inlier = false;
  };
  std::vector<Keypoint> keypoints;
};

// `problem` is what was estimated, `hit` how many matches were lifted before filtering.
QueryDetail DescribeQuery(const PoseProblem& problem, size_t hit, const PoseEstimate& estimate,
                          const EstimatorOptions& options, const Rigid3& true_cam_from_world,
                          size_t max_keypoints);

}  // namespace raylift
