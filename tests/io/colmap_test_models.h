// Small COLMAP models for the tests.

#pragma once

#include "support/matchers.h"

#include "raylift/io/colmap_model.h"

namespace raylift {

// Three images of two cameras, gaps between the ids, records not in the order of the ids,
// quaternions that are not normalized, an image without points.
inline ColmapModel SmallColmapModel(Rng& rng) {
  ColmapModel model;
  model.cameras[7] =
      Camera(CameraModel::kSimpleRadial, 640, 480, std::vector<double>{500.1, 320.5, 239.25, 0.01});
  model.cameras[2] =
      Camera(CameraModel::kPinhole, 1920, 1080, std::vector<double>{1000, 1001, 960, 540.125});
  model.camera_order = {7, 2};
  for (const uint32_t id : {5u, 1u, 9u}) {
    ColmapImage& image = model.images[id];
    image.name = "query/img " + std::to_string(id) + ".jpg";
    image.camera_id = id == 1 ? 2 : 7;
    image.SetCamFromWorld(RandomRigid3(rng, 10));
    image.pose.qvec_wxyz *= rng.Uniform(0.9, 1.1);
    model.image_order.push_back(id);
  }
  for (const uint32_t id : {5u, 9u}) {
    for (uint64_t point = 0; point < 3; ++point) {
      model.images[id].points2d.push_back({{rng.Uniform(0, 640), rng.Uniform(0, 480)},
                                           point == 1 ? std::nullopt : std::optional(point + 100)});
    }
  }
  for (const uint64_t id : {uint64_t{102}, uint64_t{100}, uint64_t{1} << 40}) {
    ColmapPoint3D& point = model.points3d[id];
    point.position_in_world = {rng.Normal(), rng.Normal(), rng.Normal()};
    point.color_rgb = {1, 128, 255};
    point.error_px = id == 100 ? -1 : rng.Uniform();
    point.track = {{5, static_cast<uint32_t>(id % 3)}, {9, 0}};
    model.point3d_order.push_back(id);
  }
  return model;
}

}  // namespace raylift
