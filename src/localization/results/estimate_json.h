// A pose estimate in JSON, as `queries.jsonl` and `raylift estimate` hold it, but for the pose
// itself: how sure it is, what it rests on, its covariance.

#pragma once

#include <utility>
#include <vector>

#include "estimation/fields.h"

#include "raylift/estimation/pose_estimate.h"

namespace raylift {

// Gives the estimate's members to `json`, nlohmann's json or ordered_json.
template <typename Json>
void AddEstimate(const PoseEstimate& estimate, Json& json) {
  json["keypoints"] = estimate.num_keypoints;
  json["inlier_keypoints"] = estimate.inlier_keypoints;
  json["iterations"] = estimate.iterations;
  if (estimate.cam_from_world) {
    const auto score = [](const MatchSetScore& of_kind) {
      return Json{{"matches", of_kind.num_matches},
                  {"inliers", of_kind.num_inliers},
                  {"msac_cost", of_kind.msac_cost}};
    };
    json["solver"] = ToString(estimate.solver);
    json["score_2d3d"] = score(estimate.score_2d3d);
    json["score_2d2d"] = score(estimate.score_2d2d);
    json["ransac_value"] = estimate.ransac_value;
    json["refined_value"] = estimate.refined_value;
  }
  if (estimate.noise) {
    Json& noise = json["noise"];
    ForEachNumber<double>(ConstFieldsOf(*estimate.noise),
                          [&](const std::string& name, double value) { noise[name] = value; });
  }
  if (estimate.refined_camera) {
    json["refined_camera"] = estimate.refined_camera->ToString();
  }
  if (estimate.covariance) {
    json["rotation_sigma_deg"] = estimate.rotation_sigma_deg;
    json["position_sigma"] = estimate.position_sigma;
    Json rows = Json::array();
    for (int r = 0; r < 6; ++r) {
      const Eigen::Matrix<double, 1, 6> row = estimate.covariance->row(r);
      rows.push_back(std::vector<double>(row.data(), row.data() + 6));
    }
    json["covariance"] = std::move(rows);
  }
}

}  // namespace raylift
