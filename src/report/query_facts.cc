#include "report/query_facts.h"

#include <algorithm>
#include <cmath>

#include "report/page.h"

#include "raylift/base/enum_names.h"
#include "raylift/renderers/frame_renderer.h"
#include "raylift/scene/image.h"

namespace raylift {
namespace {

using Json = nlohmann::ordered_json;

// Inverse depth of a plane is linear in the image: what its second difference is against its value
// tells an edge or a crease from a slanted surface.
constexpr double kLeastCrease = 0.01;

// Transparent but for edges and creases.
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
  }
  return json;
}

Json SeenFromPose(const Camera& camera, const Rigid3& cam_from_world, const RayCaster& mesh) {
  const int width = std::min(kPagePictureWidthPx, camera.width_px());
  const int height = std::max(1, camera.height_px() * width / camera.width_px());
  const Camera small = camera.Scaled(width, height);
  ColorOptions colors;
  colors.background_rgb = {222, 226, 232};
  if (!mesh.HasColors()) colors.shading = ColorOptions::Shading::kHeadlight;
  return {{"rendering", JpegDataUri(RenderColor(mesh, small, cam_from_world, colors, 1), width)},
          {"edges", PngDataUri(EdgesOf(RenderDepth(mesh, small, cam_from_world, 1)))}};
}

}  // namespace raylift
