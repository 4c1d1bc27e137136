// COLMAP's sparse model (cameras, images, points3D, and since 3.12 rigs and frames), in text and
// binary form, read and written without loss. Format: COLMAP's doc/format.rst and
// src/colmap/scene/reconstruction_io_binary.cc.

#pragma once

#include <array>
#include <compare>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/scene/photographs.h"

namespace raylift {

struct ColmapPose {
  // It is kept as read, not normalized, so that a model writes back the same bytes.
  Eigen::Vector4d qvec_wxyz{1, 0, 0, 0};
  Eigen::Vector3d tvec = Eigen::Vector3d::Zero();

  static ColmapPose Of(const Rigid3& pose);
  Rigid3 ToRigid3() const;  // with the quaternion normalized
};

struct ColmapImage {
  struct Point2D {
    Eigen::Vector2d pixel;
    std::optional<uint64_t> point3d_id;
  };
  std::string name;
  uint32_t camera_id = 0;
  ColmapPose pose;
  std::vector<Point2D> points2d;

  Rigid3 CamFromWorld() const { return pose.ToRigid3(); }
  void SetCamFromWorld(const Rigid3& cam_from_world) { pose = ColmapPose::Of(cam_from_world); }
};

struct ColmapPoint3D {
  struct Observation {
    uint32_t image_id;
    uint32_t point2d_index;
  };
  Eigen::Vector3d position_in_world;
  std::array<uint8_t, 3> color_rgb{};
  double error_px = -1;
  std::vector<Observation> track;
};

// A sensor of a rig: COLMAP knows cameras (0) and IMUs (1).
struct ColmapSensor {
  int32_t type = 0;
  uint32_t id = 0;
  auto operator<=>(const ColmapSensor&) const = default;
};

struct ColmapRig {
  std::optional<ColmapSensor> reference_sensor;
  // The other sensors, in file order, with sensor_from_rig where known.
  std::vector<std::pair<ColmapSensor, std::optional<ColmapPose>>> sensors;
};

struct ColmapFrame {
  struct Data {
    ColmapSensor sensor;
    uint64_t data_id;  // of a camera: the image id
  };
  uint32_t rig_id = 0;
  ColmapPose rig_from_world;
  std::vector<Data> data;
};

struct ColmapModel {
  // All are keyed by id; ids need not be contiguous. They are written in the order of `*_order`
  // (that of the file that was read, empty where it is that of the ids), then whatever it does not
  // list, by id.
  std::map<uint32_t, Camera> cameras;
  std::map<uint32_t, ColmapImage> images;
  std::map<uint64_t, ColmapPoint3D> points3d;
  std::map<uint32_t, ColmapRig> rigs;
  std::map<uint32_t, ColmapFrame> frames;
  std::vector<uint32_t> camera_order, image_order, rig_order, frame_order;
  std::vector<uint64_t> point3d_order;

  // The reader's messages for the user, one line each (for instance that the poses composed from
  // rigs and frames, which are used, differ from those of the images file).
  std::vector<std::string> warnings;

  // Returns the images with their cameras, sorted by name.
  std::vector<PosedImage> PosedImages() const;
};

// Makes a model of images; those of equal cameras share one. Ids count from 1.
ColmapModel ModelOfImages(std::span<const PosedImage> images);

// Removes images from a model together with their observations; points that lose some and keep
// fewer than two are removed, too. All other points keep their positions. Names that are not in the
// model are ignored.
void RemoveImages(ColmapModel& model, std::span<const std::string> names);

enum class ColmapForm { kText, kBinary };

// Returns the form that a folder holds: binary where it holds both, as COLMAP does; nullopt where
// it holds neither.
std::optional<ColmapForm> DetectColmapForm(const std::filesystem::path& folder);

// Reads a folder in either form. points3D.* may be absent (then there are none). Throws InputError
// naming the file and the record for anything wrong. Tracks and the points' ids in images may point
// to records that are not there, as in models that were cut down.
ColmapModel ReadColmapModel(const std::filesystem::path& folder);
ColmapModel ReadColmapModel(const std::filesystem::path& folder, ColmapForm form);

// Writes all files of the form; rigs and frames only if the model has frames (else those that a
// former model left in the folder are removed, as they would override its poses).
void WriteColmapModel(const std::filesystem::path& folder, const ColmapModel& model,
                      ColmapForm form);

}  // namespace raylift
