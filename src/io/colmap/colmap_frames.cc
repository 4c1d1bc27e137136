// Composes the poses of images that belong to rigs (COLMAP >= 3.12).

#include <algorithm>
#include <optional>

#include "io/colmap/colmap_files.h"
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift::colmap {
namespace {

// Poses nearer than this are the same pose, rounded differently.
constexpr double kSamePose = 1e-6;

double LargestDifference(const Rigid3& a, const Rigid3& b) {
  const Eigen::Vector4d& q = a.rotation.coeffs();
  const Eigen::Vector4d& p = b.rotation.coeffs();  // q and -q are the same rotation
  const double rotation =
      std::min((q - p).lpNorm<Eigen::Infinity>(), (q + p).lpNorm<Eigen::Infinity>());
  return std::max(rotation, (a.translation - b.translation).lpNorm<Eigen::Infinity>());
}

struct Composition {
  size_t num_composed = 0;
  size_t num_different = 0;
  double largest_difference = 0;
  std::string name_of_largest;
};

void PoseImageOfFrame(const Rigid3& cam_from_world, ColmapImage* image, Composition* result) {
  const double difference = LargestDifference(image->CamFromWorld(), cam_from_world);
  result->num_composed++;
  if (difference <= kSamePose) {
    return;  // stays as read, so that it is written back as it was
  }
  result->num_different++;
  if (difference > result->largest_difference) {
    result->largest_difference = difference;
    result->name_of_largest = image->name;
  }
  image->SetCamFromWorld(cam_from_world);
}

void PoseImagesOfFrame(const ColmapFrame& frame, ColmapModel* model, Composition* result) {
  const auto rig = model->rigs.find(frame.rig_id);
  if (rig == model->rigs.end()) {
    throw InputError(fmt::format("refers to rig {}, which is not in the rigs file", frame.rig_id));
  }
  const Rigid3 rig_from_world = frame.rig_from_world.ToRigid3();
  for (const ColmapFrame::Data& data : frame.data) {
    const auto sensor_from_rig = SensorFromRig(rig->second, data.sensor);
    if (data.sensor.type != kCameraSensor || data.data_id > UINT32_MAX || !sensor_from_rig) {
      continue;
    }
    const auto image = model->images.find(static_cast<uint32_t>(data.data_id));
    if (image != model->images.end()) {
      PoseImageOfFrame(*sensor_from_rig * rig_from_world, &image->second, result);
    }
  }
}

}  // namespace

std::optional<Rigid3> SensorFromRig(const ColmapRig& rig, const ColmapSensor& sensor) {
  if (rig.reference_sensor == sensor) {
    return Rigid3();
  }
  for (const auto& [other, sensor_from_rig] : rig.sensors) {
    if (other == sensor) {
      return sensor_from_rig ? std::optional(sensor_from_rig->ToRigid3()) : std::nullopt;
    }
  }
  throw InputError(fmt::format("sensor {} of type {} is not in its rig", sensor.id, sensor.type));
}

void ComposePosesOfFrames(const std::filesystem::path& folder, ColmapForm form,
                          ColmapModel* model) {
  if (model->frames.empty()) {
    return;
  }
  Composition result;
  for (const auto& [id, frame] : model->frames) {
    try {
      PoseImagesOfFrame(frame, model, &result);
    } catch (const InputError& error) {
      throw InputError(FilePath(folder, kFrames, form), fmt::format("frame {}", id), error.what());
    }
  }
  if (result.num_different > 0) {
    model->warnings.push_back(fmt::format(
        "{}: the poses of {} of {} images differ from those of their rigs and frames, which are "
        "used; the largest difference is {:.3g} (\"{}\")",
        FilePath(folder, kImages, form).string(), result.num_different, model->images.size(),
        result.largest_difference, result.name_of_largest));
  }
  if (result.num_composed < model->images.size()) {
    model->warnings.push_back(
        fmt::format("{}: {} of {} images have no frame or no pose in their rig; the poses of the "
                    "images file are used for them",
                    FilePath(folder, kFrames, form).string(),
                    model->images.size() - result.num_composed, model->images.size()));
  }
}

}  // namespace raylift::colmap
