#include "raylift/io/rig_list.h"

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "io/colmap/colmap_files.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/json_document.h"
#include "raylift/io/unit_quaternion.h"

namespace raylift {
namespace {

using std::filesystem::path;

template <int N>
Eigen::Matrix<double, N, 1> ReadVector(const JsonPlace& place) {
  place.ExpectArraySize(N);
  Eigen::Matrix<double, N, 1> vector;
  for (int i = 0; i < N; ++i) vector[i] = place.At(static_cast<size_t>(i)).Number();
  return vector;
}

// A camera of a rig, by how its photographs' names begin.
struct PrefixedCamera {
  size_t rig = 0;
  int sensor = 0;
  Rigid3 cam_from_rig = {};
};
using CamerasByPrefix = std::map<std::string, PrefixedCamera>;

bool IsReference(const JsonPlace& camera) {
  return camera.Has("ref_sensor") && camera.Member("ref_sensor").Bool();
}

Rigid3 ReadCamFromRig(const JsonPlace& camera) {
  const JsonPlace rotation_place = camera.Member("cam_from_rig_rotation");
  const Eigen::Vector4d qvec_wxyz = ReadVector<4>(rotation_place);
  const auto rotation = UnitQuaternion(qvec_wxyz);
  if (!rotation) {
    rotation_place.Fail(fmt::format("expected a quaternion of length 1, found one of length {:.6g}",
                                    qvec_wxyz.norm()));
  }
  return {*rotation, ReadVector<3>(camera.Member("cam_from_rig_translation"))};
}

void ReadRig(const JsonPlace& cameras, size_t rig, CamerasByPrefix& by_prefix) {
  int num_references = 0;
  for (size_t i = 0; i < cameras.ArraySize(); ++i) {
    const JsonPlace camera = cameras.At(i);
    const JsonPlace prefix = camera.Member("image_prefix");
    const bool is_reference = IsReference(camera);
    // The reference is the first, wherever it stands.
    PrefixedCamera read = {.rig = rig, .sensor = is_reference ? 0 : static_cast<int>(i) + 1};
    if (!is_reference) read.cam_from_rig = ReadCamFromRig(camera);
    num_references += is_reference ? 1 : 0;
    if (!by_prefix.emplace(prefix.String(), read).second) {
      prefix.Fail(fmt::format("\"{}\" stands twice", prefix.String()));
    }
  }
  if (num_references != 1) {
    cameras.Fail(
        fmt::format("expected one camera with \"ref_sensor\": true, found {}", num_references));
  }
}

CamerasByPrefix ReadRigConfig(const path& file) {
  const std::string text = ReadFile(file);
  const JsonDocument document(text, file);
  const JsonPlace root = document.Root();
  CamerasByPrefix by_prefix;
  for (size_t i = 0; i < root.ArraySize(); ++i) {
    const JsonPlace rig = root.At(i);
    const JsonPlace cameras = rig.Member("cameras");
    ReadRig(cameras, i, by_prefix);
  }
  return by_prefix;
}

// By the longest prefix that the name has.
std::optional<RigMount> MountOf(const std::string& name, const CamerasByPrefix& by_prefix) {
  const std::pair<const std::string, PrefixedCamera>* best = nullptr;
  for (const auto& camera : by_prefix) {
    const bool fits = std::string_view(name).starts_with(camera.first);
    if (fits && (best == nullptr || camera.first.size() > best->first.size())) best = &camera;
  }
  if (best == nullptr) return std::nullopt;
  const auto& [prefix, camera] = *best;
  return RigMount{.frame = fmt::format("{}: {}", camera.rig, name.substr(prefix.size())),
                  .sensor = camera.sensor,
                  .cam_from_rig = camera.cam_from_rig};
}

// The places of a model's images, by their names.
std::map<std::string, RigMount> ReadMounts(const path& folder) {
  const ColmapModel model = ReadColmapModel(folder);
  if (model.frames.empty()) {
    throw InputError(folder, "expected a model with rigs and frames, found none of them");
  }
  std::map<std::string, RigMount> mounts;
  for (const auto& [frame_id, frame] : model.frames) {
    const ColmapRig& rig = model.rigs.at(frame.rig_id);
    for (const ColmapFrame::Data& data : frame.data) {
      if (data.sensor.type != colmap::kCameraSensor || data.data_id > UINT32_MAX) continue;
      const auto image = model.images.find(static_cast<uint32_t>(data.data_id));
      if (image == model.images.end()) continue;
      const std::optional<Rigid3> cam_from_rig = colmap::SensorFromRig(rig, data.sensor);
      if (!cam_from_rig) {
        throw InputError(folder, fmt::format("rig {}: the pose of camera {} is not known",
                                             frame.rig_id, data.sensor.id));
      }
      const bool is_reference = rig.reference_sensor == data.sensor;
      mounts[image->second.name] = {.frame = std::to_string(frame_id),
                                    .sensor = is_reference ? -1 : static_cast<int>(data.sensor.id),
                                    .cam_from_rig = *cam_from_rig};
    }
  }
  return mounts;
}

}  // namespace

void TakeRigs(const path& file_or_model, std::span<Query> queries) {
  bool any = false;
  if (std::filesystem::is_directory(file_or_model)) {
    const std::map<std::string, RigMount> mounts = ReadMounts(file_or_model);
    for (Query& query : queries) {
      const auto mount = mounts.find(query.name);
      if (mount != mounts.end()) query.rig = mount->second;
      any = any || query.rig;
    }
  } else {
    const CamerasByPrefix by_prefix = ReadRigConfig(file_or_model);
    for (Query& query : queries) {
      query.rig = MountOf(query.name, by_prefix);
      any = any || query.rig;
    }
  }
  if (!any) {
    throw InputError(file_or_model,
                     fmt::format("knows none of the {} queries by name", queries.size()));
  }
  std::map<std::string, int> photographs_of_frame;
  for (const Query& query : queries) {
    if (query.rig) ++photographs_of_frame[query.rig->frame];
  }
  for (Query& query : queries) {
    if (query.rig && photographs_of_frame[query.rig->frame] == 1) query.rig.reset();
  }
}

}  // namespace raylift
