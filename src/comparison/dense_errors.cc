#include "raylift/comparison/dense_errors.h"

#include "raylift/base/parallel.h"
#include "raylift/comparison/source_view.h"

namespace raylift {

std::vector<DensePoint> SeenPoints(const GeometrySource& source, const PosedImage& true_view,
                                   int count) {
  const auto pixels = GridPixels(true_view.camera, count);
  const auto points = source.Lift(true_view, pixels);
  std::vector<DensePoint> seen;
  for (size_t i = 0; i < pixels.size(); ++i) {
    const auto ray = true_view.camera.RayInCam(pixels[i]);
    if (!points[i] || !ray || !(ray->z() > 0) || !(points[i]->depth_z > 0)) continue;
    seen.push_back({pixels[i], *ray * (points[i]->depth_z / ray->z())});
  }
  return seen;
}

std::vector<std::vector<DcreQuery>> MeasureDcre(const GeometrySource& source,
                                                std::span<const PosedImage> true_views,
                                                std::span<const PosesByName> matched_poses,
                                                int count, int threads) {
  std::vector<std::vector<DcreQuery>> results(matched_poses.size(),
                                              std::vector<DcreQuery>(true_views.size()));
  ParallelFor(true_views.size(), threads, [&](size_t i) {
    const PosedImage& view = true_views[i];
    const auto points = SeenPoints(source, view, count);
    for (size_t r = 0; r < matched_poses.size(); ++r) {
      DcreQuery& query = results[r][i];
      query.name = view.name;
      query.has_depth = !points.empty();
      const auto pose = matched_poses[r].find(view.name);
      if (pose != matched_poses[r].end() && pose->second.IsFinite()) {
        query.dcre = ComputeDcre(view.camera, view.cam_from_world, pose->second, points);
      }
    }
  });
  return results;
}

}  // namespace raylift
