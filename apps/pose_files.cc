#include "apps/pose_files.h"

#include <algorithm>
#include <map>

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/query_list.h"
#include "raylift/io/scene_file.h"

namespace raylift {

using std::filesystem::path;

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
  for (const auto& [name, pose] : ReadModelOrPoses(model_or_file)) {
    const auto camera = cameras.find(name);
    if (camera == cameras.end()) {
      throw InputError(query_list, fmt::format("{}, of the ground truth, is missing", name));
    }
    images.push_back({name, camera->second, pose});
  }
  return images;
}

std::vector<TimedName> InOrderOfTime(const PosesByName& poses, const path& times_file) {
  std::vector<std::string> names;
  for (const auto& [name, pose] : poses) names.push_back(name);
  const auto times = times_file.empty() ? PlacesByNumbers(names) : ReadTimes(times_file);
  std::vector<TimedName> order;
  for (const std::string& name : names) {
    const auto time = times.find(name);
    if (time == times.end()) {
      throw InputError(times_file, fmt::format("the time of {} is missing", name));
    }
    order.push_back({time->second, name});
  }
  std::stable_sort(order.begin(), order.end(),
                   [](const TimedName& a, const TimedName& b) { return a.time_s < b.time_s; });
  return order;
}

std::string ResultName(const path& file) {
  const std::string stem = file.stem().string();
  const std::string folder = file.parent_path().filename().string();
  return stem == "poses" && !folder.empty() ? folder : stem;
}

}  // namespace raylift
