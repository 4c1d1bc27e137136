#include "raylift/views/sampled_model.h"

#include <numbers>

#include <Eigen/Geometry>
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

ColmapPose ToColmap(const Rigid3& pose) {
  const Eigen::Quaterniond& q = pose.rotation;
  return {{q.w(), q.x(), q.y(), q.z()}, pose.translation};
}

// The k-th of `count` cameras, turned to the right.
Rigid3 CamFromRig(int k, int count) {
  const double angle = 2 * std::numbers::pi * k / count;
  // Image down is y; a turn to the right is positive about it, and the scene turns the other way.
  return {Eigen::Quaterniond(Eigen::AngleAxisd(-angle, Eigen::Vector3d::UnitY())),
          Eigen::Vector3d::Zero()};
}

ColmapSensor CameraSensor(int k) { return {0, static_cast<uint32_t>(k + 1)}; }

ColmapRig MakeRig(int rig_cameras) {
  ColmapRig rig;
  rig.reference_sensor = CameraSensor(0);
  for (int k = 1; k < rig_cameras; ++k) {
    rig.sensors.emplace_back(CameraSensor(k), ToColmap(CamFromRig(k, rig_cameras)));
  }
  return rig;
}

}  // namespace

ColmapModel MakeSampledModel(const Camera& camera, std::span<const Rigid3> cam_from_world,
                             int rig_cameras) {
  RAYLIFT_CHECK(rig_cameras >= 1);
  const bool has_rig = rig_cameras > 1;
  ColmapModel model;
  for (int k = 0; k < rig_cameras; ++k) model.cameras.emplace(CameraSensor(k).id, camera);
  if (has_rig) model.rigs.emplace(1, MakeRig(rig_cameras));
  uint32_t image_id = 0;
  for (size_t i = 0; i < cam_from_world.size(); ++i) {
    ColmapFrame frame{.rig_id = 1, .rig_from_world = ToColmap(cam_from_world[i]), .data = {}};
    for (int k = 0; k < rig_cameras; ++k) {
      ColmapImage image;
      image.name = has_rig ? fmt::format("camera{}/{:04}.jpg", k, i) : fmt::format("{:04}.jpg", i);
      image.camera_id = CameraSensor(k).id;
      image.SetCamFromWorld(CamFromRig(k, rig_cameras) * cam_from_world[i]);
      model.images.emplace(++image_id, std::move(image));
      frame.data.push_back({CameraSensor(k), image_id});
    }
    if (has_rig) model.frames.emplace(static_cast<uint32_t>(i + 1), std::move(frame));
  }
  return model;
}

}  // namespace raylift
