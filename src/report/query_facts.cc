#include "report/query_facts.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "geometry/pose_json.h"
#include "report/page.h"

#include "raylift/base/enum_names.h"
#include "raylift/renderers/frame_renderer.h"
#include "raylift/scene/image.h"

namespace raylift {
namespace {

using Json = nlohmann::ordered_json;

// The least ratio of the second difference of inverse depth to its value at an edge or a crease:
// inverse depth of a plane, also of a slanted one, is linear in the image.
constexpr double kLeastCrease = 0.01;

// Returns a picture that is transparent but for edges and creases.
Image EdgesOf(const DepthMap& map) {
  Image edges{map.width_px, map.height_px, 4, {}};
  edges.data.resize(static_cast<size_t>(4) * map.width_px * map.height_px);
  const auto inverse = [&map](int x, int y) {
    const float depth = map.At(x, y);
    return depth > 0 ? 1 / static_cast<double>(depth) : 0;
  };
  for (int y = 1; y + 1 < map.height_px; ++y) {
    for (int x = 1; x + 1 < map.width_px; ++x) {
      const double here = inverse(x, y);
      const double bend = std::max(std::abs(inverse(x - 1, y) - 2 * here + inverse(x + 1, y)),
                                   std::abs(inverse(x, y - 1) - 2 * here + inverse(x, y + 1)));
      if (!(bend > kLeastCrease * here) || here == 0) continue;
      uint8_t* pixel = &edges.data[4 * (static_cast<size_t>(y) * map.width_px + x)];
      pixel[0] = 255;
      pixel[1] = 64;
      pixel[2] = 160;
      pixel[3] = 255;
    }
  }
  return edges;
}

}  // namespace

Json QueryFacts(const LocalizedQuery& query) {
  const StageCounts& counts = query.counts;
  const PoseEstimate& estimate = query.estimate;
  Json json = {{"query", query.name},
               {"reason", query.reason},
               {"verdict", ToString(query.verdict())},
               {"confidence", query.confidence()},
               {"position", nullptr},
               {"rotation_deg", nullptr},
               {"retrieved", counts.retrieved},
               {"matched", counts.matched},
               {"hit", counts.hit},
               {"consistent", counts.filter.consistent},
               {"inliers_2d3d", counts.inliers_2d3d},
               {"inliers_2d2d", counts.inliers_2d2d},
               {"keypoints", estimate.num_keypoints},
               {"inlier_keypoints", estimate.inlier_keypoints}};
  if (query.localized()) {
    json["solver"] = ToString(estimate.solver);
    if (estimate.refined_camera) json["focal_px"] = estimate.refined_camera->MeanFocalPx();
    if (estimate.covariance) {
      json["position_sigma"] = estimate.position_sigma;
      json["rotation_sigma_deg"] = estimate.rotation_sigma_deg;
    }
    const Eigen::Vector3d center = estimate.cam_from_world->OriginInSource();
    for (const AlternativePose& other : estimate.alternatives) {
      json["alternatives"].push_back(
          {{"probability", other.probability},
           {"distance", (other.cam_from_world.OriginInSource() - center).norm()}});
    }
  }
  return json;
}

Json SeenFromPose(const Camera& camera, const Rigid3& cam_from_world, const RayCaster& mesh) {
  const int width = std::min(kPagePictureWidthPx, camera.width_px());
  const int height = std::max(1, camera.height_px() * width / camera.width_px());
  const Camera small = camera.Scaled(width, height);
  const Image rendering = RenderColor(mesh, small, cam_from_world, PictureColors(mesh), 1);
  return {{"rendering", JpegDataUri(rendering, width)},
          {"edges", PngDataUri(EdgesOf(RenderDepth(mesh, small, cam_from_world, 1)))}};
}

namespace {

// Removes inliers and residuals of another pose, which would lead astray: marks keep their places,
// [x, y, 0], and lines their ends, [x, y, x in the reference, y, 0].
void ForgetInliers(Json& query) {
  for (const char* kind : {"points", "pairs"}) {
    if (!query.contains(kind)) continue;
    for (Json& mark : query[kind]) mark = {mark[0], mark[1], 0};
  }
  if (!query.contains("reference")) return;
  for (Json& line : query["reference"]["lines"]) line[4] = 0;
}

void TakePictures(const WalkedQuery& walked, const Query& query, const RayCaster* mesh,
                  Json& json) {
  if (walked.role == WalkRole::kAlone || walked.role == WalkRole::kSmoothed ||
      walked.role == WalkRole::kDisputed) {
    return;
  }
  ForgetInliers(json);
  for (const char* key : {"solver", "rendering", "edges", "references"}) json.erase(key);
  if (mesh == nullptr || !walked.localized.localized()) return;
  json.update(SeenFromPose(query.camera, *walked.localized.estimate.cam_from_world, *mesh));
}

}  // namespace

void TakeWalk(const WalkedQuery& walked, const Query& query, const RayCaster* mesh, Json& part) {
  Json& json = part.at("query");
  for (const char* key :
       {"solver", "focal_px", "position_sigma", "rotation_sigma_deg", "alternatives"}) {
    json.erase(key);
  }
  json.update(QueryFacts(walked.localized));
  json["walk"] = {{"role", ToString(walked.role)}, {"means", TitleOf(walked.role)}};
  if (walked.time_s) json["walk"]["time_s"] = *walked.time_s;
  if (walked.single_cam_from_world) json["walk"]["single_confidence"] = walked.single_confidence;
  TakePictures(walked, query, mesh, json);
  Json& scene = part.at("scene");
  scene.erase("cam_from_world");
  scene["camera"] = query.camera.ToString();
  if (!walked.localized.localized()) return;
  scene["cam_from_world"] = ToJson(*walked.localized.estimate.cam_from_world);
}

void AddSinglePose(const WalkedQuery& walked, SceneJson& scene) {
  if (!walked.single_cam_from_world) return;
  scene.AddCamera("single", walked.localized.name, *walked.single_cam_from_world);
}

Json WalkJson(const WalkedQueries& walked) {
  Json json = {{"frames", Json::array()}, {"odometry", Json::array()}};
  for (size_t i = 0; i < walked.walks.size(); ++i) {
    const ToldWalk& walk = walked.walks[i];
    for (const size_t query : walk.queries) {
      const WalkedQuery& frame = walked.queries[query];
      if (!frame.localized.localized()) continue;
      json["frames"].push_back({{"query", frame.localized.name},
                                {"walk", i},
                                {"time_s", *frame.time_s},
                                {"role", ToString(frame.role)},
                                {"lost_before", frame.lost_before}});
    }
    Json& odometry = json["odometry"].emplace_back(Json{{"folder", walk.folder}});
    if (!walk.odometry) continue;
    odometry["scale"] = walk.odometry->scale;
    odometry["step_sigma"] = walk.odometry->step_sigma;
    odometry["step_rotation_sigma_deg"] = walk.odometry->step_rotation_sigma_deg;
  }
  return json;
}

}  // namespace raylift
