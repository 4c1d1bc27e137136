#include "io/scene/named_poses.h"

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/query_list.h"

namespace raylift {

using std::filesystem::path;

std::map<std::string, Rigid3> ReadNamedPoses(const path& file) {
  std::map<std::string, Rigid3> poses;
  for (const NamedPose& pose : ReadPoseFile(file)) {
    if (!poses.emplace(pose.name, pose.cam_from_world).second) {
      throw InputError(file, fmt::format("the name {} stands twice", pose.name));
    }
  }
  return poses;
}

std::map<std::string, Rigid3> ReadModelOrPoses(const path& model_or_file) {
  if (!std::filesystem::is_directory(model_or_file)) return ReadNamedPoses(model_or_file);
  std::map<std::string, Rigid3> poses;
  for (const PosedImage& image : ReadColmapModel(model_or_file).PosedImages()) {
    poses.emplace(image.name, image.cam_from_world);
  }
  return poses;
}

}  // namespace raylift
