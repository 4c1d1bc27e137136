#include "apps/pose_files.h"

#include <algorithm>
#include <map>

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/query_list.h"
#include "raylift/io/scene_file.h"

namespace raylift {

using std::filesystem::path;

PosesByName ReadPoses(const path& file) {
  PosesByName poses;
  for (const NamedPose& pose : ReadPoseFile(file)) {
    if (!poses.emplace(pose.name, pose.cam_from_world).second) {
      throw InputError(file, fmt::format("the name {} stands twice", pose.name));
    }
  }
  return poses;
}

PosesByName ReadGroundTruth(const path& model_or_file) {
  if (!std::filesystem::is_directory(model_or_file)) {
    return ReadPoses(model_or_file);
  }
  PosesByName poses;
  for (const PosedImage& image : ReadColmapModel(model_or_file).PosedImages()) {
    poses.emplace(image.name, image.cam_from_world);
  }
  return poses;
}

std::vector<PosedImage> ReadPosedQueries(const path& model_or_file, const path& query_list) {
  if (query_list.empty()) {
    if (!std::filesystem::is_directory(model_or_file)) {
      throw OptionError("--queries is required where the ground truth is a pose file");
    }
    return ReadColmapModel(model_or_file).PosedImages();
  }
  std::map<std::string, Camera> cameras;
  for (const Query& query : ReadQueryList(query_list)) cameras.emplace(query.name, query.camera);
  std::vector<PosedImage> images;
  for (const auto& [name, pose] : ReadGroundTruth(model_or_file)) {
    const auto camera = cameras.find(name);
    if (camera == cameras.end()) {
      throw InputError(query_list, fmt::format("{}, of the ground truth, is missing", name));
    }
    images.push_back({name, camera->second, pose});
  }
  return images;
}

std::vector<TimedName> InOrderOfTime(const PosesByName& poses, const path& times_file) {
  std::map<std::string, double> times;
  if (!times_file.empty()) times = ReadTimes(times_file);
  std::vector<TimedName> names;
  for (const auto& [name, pose] : poses) {
    const auto time = times.find(name);
    if (time == times.end() && !times_file.empty()) {
      throw InputError(times_file, fmt::format("the time of {} is missing", name));
    }
    names.push_back({times_file.empty() ? static_cast<double>(names.size()) : time->second, name});
  }
  std::stable_sort(names.begin(), names.end(),
                   [](const TimedName& a, const TimedName& b) { return a.time_s < b.time_s; });
  return names;
}

std::string ResultName(const path& file) {
  const std::string stem = file.stem().string();
  const std::string folder = file.parent_path().filename().string();
  return stem == "poses" && !folder.empty() ? folder : stem;
}

}  // namespace raylift
