// Taking images out of COLMAP models.

#include <algorithm>
#include <set>

#include "raylift/io/colmap_model.h"

namespace raylift {
namespace {

// Of points that lose some and keep fewer than two, all.
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
