#include "report/walk_report.h"

#include <algorithm>
#include <vector>

#include "geometry/pose_json.h"
#include "report/query_facts.h"

#include "raylift/base/enum_names.h"

namespace raylift {
namespace {

using Json = nlohmann::ordered_json;

// Inliers and residuals of another pose would lead astray: marks keep their places, [x, y, 0], and
// lines their ends, [x, y, x in the reference, y, 0].
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
  if (walked.role == WalkRole::kAlone || walked.role == WalkRole::kSmoothed) return;
  ForgetInliers(json);
  for (const char* key : {"solver", "rendering", "edges", "references"}) json.erase(key);
  if (mesh == nullptr || !walked.localized.localized()) return;
  json.update(SeenFromPose(query.camera, *walked.localized.estimate.cam_from_world, *mesh));
}

}  // namespace

void TakeWalk(const WalkedQuery& walked, const Query& query, const RayCaster* mesh, Json& part) {
  Json& json = part.at("query");
  for (const char* key : {"solver", "focal_px", "position_sigma", "rotation_sigma_deg"}) {
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
  std::vector<const WalkedQuery*> frames;
  for (const WalkedQuery& query : walked.queries) {
    if (query.time_s && query.localized.localized()) frames.push_back(&query);
  }
  std::sort(frames.begin(), frames.end(),
            [](const WalkedQuery* a, const WalkedQuery* b) { return *a->time_s < *b->time_s; });
  Json json = {{"frames", Json::array()}, {"odometry", nullptr}};
  for (const WalkedQuery* frame : frames) {
    json["frames"].push_back({{"query", frame->localized.name},
                              {"time_s", *frame->time_s},
                              {"role", ToString(frame->role)},
                              {"lost_before", frame->lost_before}});
  }
  if (!walked.walk) return json;
  json["odometry"] = {{"scale", walked.walk->scale},
                      {"step_sigma", walked.walk->step_sigma},
                      {"step_rotation_sigma_deg", walked.walk->step_rotation_sigma_deg}};
  return json;
}

}  // namespace raylift
