// The files of a COLMAP model.

#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string_view>
#include <unordered_set>
#include <vector>

#include "raylift/io/colmap_model.h"

namespace raylift::colmap {

inline constexpr std::string_view kCameras = "cameras";
inline constexpr std::string_view kImages = "images";
inline constexpr std::string_view kPoints3D = "points3D";
inline constexpr std::string_view kRigs = "rigs";
inline constexpr std::string_view kFrames = "frames";

std::filesystem::path FilePath(const std::filesystem::path& folder, std::string_view file,
                               ColmapForm form);

// Read and write the records of one of these files; all but the relations between files is checked.
void ReadRecords(std::string_view file, const std::filesystem::path& path, ColmapForm form,
                 ColmapModel& model);
void WriteRecords(std::string_view file, const std::filesystem::path& path, ColmapForm form,
                  const ColmapModel& model);

// Computes the poses of images of rigs as sensor_from_rig * rig_from_world, as COLMAP does. Adds a
// warning where they differ from those of the images file.
void ComposePosesOfFrames(const std::filesystem::path& folder, ColmapForm form, ColmapModel* model);

// The type by which ColmapSensor names a camera.
inline constexpr int32_t kCameraSensor = 0;

// Returns nullopt if the rig does not know the sensor's pose. Throws InputError where it lacks the
// sensor.
std::optional<Rigid3> SensorFromRig(const ColmapRig& rig, const ColmapSensor& sensor);

// Returns the ids in the order of writing: those of `order` that still exist, then all others by
// id.
template <typename Id, typename Record>
std::vector<Id> IdsInOrder(const std::map<Id, Record>& records, const std::vector<Id>& order) {
  std::vector<Id> ids;
  ids.reserve(records.size());
  std::unordered_set<Id> written;
  for (const Id id : order) {
    if (records.contains(id) && written.insert(id).second) {
      ids.push_back(id);
    }
  }
  if (ids.size() == records.size()) {
    return ids;
  }
  for (const auto& [id, record] : records) {
    if (!written.contains(id)) {
      ids.push_back(id);
    }
  }
  return ids;
}

}  // namespace raylift::colmap
