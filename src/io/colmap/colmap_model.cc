// Reads and writes COLMAP models as a whole: detects the form of a folder, and checks the files
// against each other.

#include "raylift/io/colmap_model.h"

#include <algorithm>
#include <set>
#include <unordered_map>
#include <utility>

#include "io/colmap/colmap_files.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {
namespace {

using colmap::FilePath;

bool HasFile(const std::filesystem::path& folder, std::string_view file, ColmapForm form) {
  return Exists(FilePath(folder, file, form));
}

void ReadFiles(const std::filesystem::path& folder, ColmapForm form, ColmapModel* model) {
  using namespace colmap;
  for (const std::string_view file : {kCameras, kImages, kPoints3D, kRigs, kFrames}) {
    const bool is_required = file == kCameras || file == kImages;
    if (!is_required && !HasFile(folder, file, form)) continue;
    ReadRecords(file, FilePath(folder, file, form), form, *model);
  }
}

void CheckImages(const std::filesystem::path& path, const ColmapModel& model) {
  std::unordered_map<std::string_view, uint32_t> id_of_name;
  for (const auto& [id, image] : model.images) {
    const std::string place = fmt::format("image {} (\"{}\")", id, image.name);
    if (!model.cameras.contains(image.camera_id)) {
      throw InputError(
          path, place,
          fmt::format("refers to camera {}, which is not in the cameras file", image.camera_id));
    }
    const auto [other, is_new] = id_of_name.emplace(image.name, id);
    if (!is_new) {
      throw InputError(path, place, fmt::format("image {} has the same name", other->second));
    }
  }
}

// Removes all observations of points that lose some and keep fewer than two.
void RemoveObservations(const std::set<uint32_t>& image_ids, ColmapPoint3D& point) {
  const size_t lost = std::erase_if(point.track, [&](const ColmapPoint3D::Observation& seen) {
    return image_ids.contains(seen.image_id);
  });
  if (lost > 0 && point.track.size() < 2) point.track.clear();
}

void RemoveFromFrames(const std::set<uint32_t>& image_ids, ColmapModel& model) {
  constexpr int32_t kCamera = 0;
  for (auto& [id, frame] : model.frames) {
    std::erase_if(frame.data, [&](const ColmapFrame::Data& data) {
      return data.sensor.type == kCamera && data.data_id <= UINT32_MAX &&
             image_ids.contains(static_cast<uint32_t>(data.data_id));
    });
  }
  std::erase_if(model.frames, [](const auto& entry) { return entry.second.data.empty(); });
  std::erase_if(model.frame_order, [&](uint32_t id) { return !model.frames.contains(id); });
}

}  // namespace

std::filesystem::path colmap::FilePath(const std::filesystem::path& folder, std::string_view file,
                                       ColmapForm form) {
  return folder / fmt::format("{}.{}", file, form == ColmapForm::kText ? "txt" : "bin");
}

ColmapPose ColmapPose::Of(const Rigid3& pose) {
  const Eigen::Quaterniond& q = pose.rotation;
  return {{q.w(), q.x(), q.y(), q.z()}, pose.translation};
}

Rigid3 ColmapPose::ToRigid3() const {
  const Eigen::Vector4d& q = qvec_wxyz;
  return {Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized(), tvec};
}

std::vector<PosedImage> ColmapModel::PosedImages() const {
  std::vector<PosedImage> posed;
  posed.reserve(images.size());
  for (const auto& [id, image] : images) {
    posed.push_back({image.name, cameras.at(image.camera_id), image.CamFromWorld()});
  }
  std::sort(posed.begin(), posed.end(),
            [](const PosedImage& a, const PosedImage& b) { return a.name < b.name; });
  return posed;
}

ColmapModel ModelOfImages(std::span<const PosedImage> images) {
  ColmapModel model;
  std::map<std::string, uint32_t> id_of_camera;
  for (const PosedImage& image : images) {
    const auto [camera, is_new] = id_of_camera.emplace(
        image.camera.ToString(), static_cast<uint32_t>(id_of_camera.size() + 1));
    if (is_new) model.cameras.emplace(camera->second, image.camera);
    ColmapImage stored;
    stored.name = image.name;
    stored.camera_id = camera->second;
    stored.SetCamFromWorld(image.cam_from_world);
    model.images.emplace(static_cast<uint32_t>(model.images.size() + 1), std::move(stored));
  }
  return model;
}

std::optional<ColmapForm> DetectColmapForm(const std::filesystem::path& folder) {
  for (const ColmapForm form : {ColmapForm::kBinary, ColmapForm::kText}) {
    if (HasFile(folder, colmap::kCameras, form) && HasFile(folder, colmap::kImages, form)) {
      return form;
    }
  }
  return std::nullopt;
}

ColmapModel ReadColmapModel(const std::filesystem::path& folder) {
  const auto form = DetectColmapForm(folder);
  if (!form) {
    throw InputError(
        folder,
        "no COLMAP model: expected cameras.bin and images.bin, or cameras.txt and images.txt");
  }
  return ReadColmapModel(folder, *form);
}

ColmapModel ReadColmapModel(const std::filesystem::path& folder, ColmapForm form) {
  ColmapModel model;
  ReadFiles(folder, form, &model);
  CheckImages(FilePath(folder, colmap::kImages, form), model);
  colmap::ComposePosesOfFrames(folder, form, &model);
  return model;
}

void WriteColmapModel(const std::filesystem::path& folder, const ColmapModel& model,
                      ColmapForm form) {
  using namespace colmap;
  std::vector<std::string_view> files = {kCameras, kPoints3D};
  if (!model.frames.empty()) files.insert(files.end(), {kRigs, kFrames});
  files.push_back(kImages);  // the last: without images nothing is taken for a model that is whole
  for (const std::string_view file : files) {
    WriteRecords(file, FilePath(folder, file, form), form, model);
  }
  if (!model.frames.empty()) return;
  // The files of a former model would override the poses of this one.
  for (const std::string_view file : {kRigs, kFrames}) {
    std::error_code ignored;
    std::filesystem::remove(FilePath(folder, file, form), ignored);
  }
}

void RemoveImages(ColmapModel& model, std::span<const std::string> names) {
  const std::set<std::string, std::less<>> removed(names.begin(), names.end());
  std::set<uint32_t> image_ids;
  for (const auto& [id, image] : model.images) {
    if (removed.contains(image.name)) image_ids.insert(id);
  }
  if (image_ids.empty()) return;
  for (const uint32_t id : image_ids) model.images.erase(id);
  std::erase_if(model.image_order, [&](uint32_t id) { return image_ids.contains(id); });
  RemoveFromFrames(image_ids, model);

  for (auto& [id, point] : model.points3d) RemoveObservations(image_ids, point);
  std::erase_if(model.points3d, [](const auto& entry) { return entry.second.track.empty(); });
  std::erase_if(model.point3d_order, [&](uint64_t id) { return !model.points3d.contains(id); });
  for (auto& [id, image] : model.images) {
    for (ColmapImage::Point2D& keypoint : image.points2d) {
      if (keypoint.point3d_id && !model.points3d.contains(*keypoint.point3d_id)) {
        keypoint.point3d_id.reset();
      }
    }
  }
}

}  // namespace raylift
