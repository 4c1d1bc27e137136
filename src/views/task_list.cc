#include "views/task_list.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>
#include <unordered_set>

#include "lifting/depth_convention.h"
#include <fmt/format.h>
#include <fnmatch.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/io/query_list.h"

namespace raylift {
namespace {

constexpr int kMaxSide = 1 << 16;

void KeepListed(const std::filesystem::path& list, std::vector<PosedImage>& views) {
  const std::vector<std::string> names = ReadImageList(list);
  const std::unordered_set<std::string> wanted(names.begin(), names.end());
  std::erase_if(views, [&wanted](const PosedImage& view) { return !wanted.contains(view.name); });
  if (views.size() == wanted.size()) return;
  for (const std::string& name : names) {
    if (std::none_of(views.begin(), views.end(),
                     [&name](const PosedImage& view) { return view.name == name; })) {
      throw InputError(list, fmt::format("\"{}\" is not among the images of the model", name));
    }
  }
}

void KeepMatching(const std::string& glob, std::vector<PosedImage>& views) {
  std::erase_if(views, [&glob](const PosedImage& view) {
    return fnmatch(glob.c_str(), view.name.c_str(), 0) != 0;
  });
}

void Thin(const Subsampling& subsampling, std::vector<PosedImage>& views) {
  std::vector<std::string> cameras;
  cameras.reserve(views.size());
  for (const PosedImage& view : views) cameras.push_back(view.camera.ToString());
  std::vector<PosedImage> kept;
  for (const size_t i : KeptIndices(cameras, subsampling)) kept.push_back(std::move(views[i]));
  views = std::move(kept);
}

void SortByName(std::vector<PosedImage>& views) {
  std::sort(views.begin(), views.end(),
            [](const PosedImage& a, const PosedImage& b) { return a.name < b.name; });
}

std::vector<PosedImage> AllCubeFaces(const std::vector<PosedImage>& views, int side_px) {
  std::vector<PosedImage> all;
  for (const PosedImage& view : views) {
    for (PosedImage& face : CubeFaces(view, side_px)) all.push_back(std::move(face));
  }
  SortByName(all);
  return all;
}

int ScaledSide(const std::string& name, int side, double scale) {
  const double scaled = std::round(side * scale);
  if (!(scaled >= 1 && scaled <= kMaxSide)) {
    throw InputError(fmt::format("{}: {} pixels times {} make no picture of 1 to {} pixels", name,
                                 side, scale, kMaxSide));
  }
  return static_cast<int>(scaled);
}

Camera CameraOf(const PosedImage& view, const TaskSelection& selection) {
  if (selection.panorama) {
    return Camera::Panorama(selection.panorama->width_px, selection.panorama->height_px);
  }
  const Camera& camera = view.camera;
  if (selection.size) return camera.Scaled(selection.size->width_px, selection.size->height_px);
  if (!selection.scale) return camera;
  return camera.Scaled(ScaledSide(view.name, camera.width_px(), *selection.scale),
                       ScaledSide(view.name, camera.height_px(), *selection.scale));
}

// Returns a relative path without "..", so that nothing is written elsewhere.
std::string StemOf(const std::string& name, size_t index, std::string_view pattern) {
  const std::filesystem::path path =
      std::filesystem::path(ExpandPattern(pattern, name, index)).lexically_normal();
  const bool leaves = path.is_absolute() || path.empty() || *path.begin() == "..";
  if (leaves || !path.has_filename() || path.filename() == ".") {
    throw InputError(fmt::format(
        "the image \"{}\" would be written to \"{}\", which is not below the output folder", name,
        path.string()));
  }
  return path.generic_string();
}

}  // namespace

int ParseSide(std::string_view option, const std::string& text) {
  const auto side = ParseInt(text);
  if (!side || *side < 1 || *side > kMaxSide) {
    throw OptionError(option, text, fmt::format("expected pixels, of 1 to {}", kMaxSide));
  }
  return static_cast<int>(*side);
}

PlaneSize ParseSize(std::string_view option, const std::string& text) {
  const auto sides = SplitBy(text, 'x');
  const auto width = ParseInt(sides.front());
  const auto height = ParseInt(sides.back());
  if (sides.size() != 2 || !width || !height || *width < 1 || *height < 1 || *width > kMaxSide ||
      *height > kMaxSide) {
    throw OptionError(option, text, fmt::format("expected WIDTHxHEIGHT of 1 to {}", kMaxSide));
  }
  return {static_cast<int>(*width), static_cast<int>(*height)};
}

std::vector<PosedImage> CubeFaces(const PosedImage& view, int side_px) {
  struct Face {
    const char* name;
    Eigen::Vector3d right_in_cam, down_in_cam;
  };
  const Eigen::Vector3d x = Eigen::Vector3d::UnitX(), y = Eigen::Vector3d::UnitY(),
                        z = Eigen::Vector3d::UnitZ();
  const Face faces[] = {{"front", x, y}, {"right", -z, y}, {"back", -x, y},
                        {"left", z, y},  {"up", x, z},     {"down", x, -z}};
  const double half = 0.5 * side_px;
  const double params[] = {half, half, half};
  const Camera lens(CameraModel::kSimplePinhole, side_px, side_px, params);
  const std::filesystem::path name(view.name);
  std::vector<PosedImage> views;
  for (const Face& face : faces) {
    Eigen::Matrix3d face_from_cam;
    face_from_cam << face.right_in_cam.transpose(), face.down_in_cam.transpose(),
        face.right_in_cam.cross(face.down_in_cam).transpose();
    const auto file = name.parent_path() / name.stem() / (face.name + name.extension().string());
    views.push_back(
        {file.generic_string(), lens,
         Rigid3(Eigen::Quaterniond(face_from_cam), Eigen::Vector3d::Zero()) * view.cam_from_world});
  }
  return views;
}

std::vector<PosedImage> ReadModelViews(const std::filesystem::path& model,
                                       std::vector<std::string>& warnings) {
  const ColmapModel read = ReadColmapModel(model);
  warnings.insert(warnings.end(), read.warnings.begin(), read.warnings.end());
  return read.PosedImages();
}

std::optional<std::string> StretchWarning(const std::vector<PosedImage>& views,
                                          const TaskSelection& selection) {
  if (!selection.size) return std::nullopt;
  TaskSelection unscaled = selection;
  unscaled.size.reset();
  const std::vector<RenderTask> tasks = SelectTasks(views, unscaled);
  const auto is_stretched = [&size = *selection.size](const RenderTask& task) {
    const int64_t width = task.view.camera.width_px(), height = task.view.camera.height_px();
    // The right shape with both sides rounded is within half a pixel of it.
    return 2 * std::abs(size.width_px * height - size.height_px * width) > width + height;
  };
  const auto count = std::count_if(tasks.begin(), tasks.end(), is_stretched);
  if (count == 0) return std::nullopt;
  const PosedImage& first = std::find_if(tasks.begin(), tasks.end(), is_stretched)->view;
  return fmt::format(
      "{}x{} is of another shape than {} of {} images ({}: {}x{}): they are stretched",
      selection.size->width_px, selection.size->height_px, count, tasks.size(), first.name,
      first.camera.width_px(), first.camera.height_px());
}

std::vector<RenderTask> SelectTasks(std::vector<PosedImage> views, const TaskSelection& selection) {
  SortByName(views);
  if (!selection.list.empty()) KeepListed(selection.list, views);
  if (!selection.glob.empty()) KeepMatching(selection.glob, views);
  if (!selection.subsampling.KeepsAll()) Thin(selection.subsampling, views);
  if (views.empty()) throw InputError("there are no images to render");
  if (selection.cubemap) views = AllCubeFaces(views, *selection.cubemap);
  std::vector<RenderTask> tasks;
  std::unordered_map<std::string, std::string> name_of_stem;
  for (PosedImage& view : views) {
    std::string stem = StemOf(view.name, tasks.size(), selection.pattern);
    const auto [other, is_new] = name_of_stem.emplace(stem, view.name);
    if (!is_new) {
      throw InputError(fmt::format(
          "the images \"{}\" and \"{}\" would both be written to \"{}\": give a pattern that "
          "tells them apart, for instance {{name}}",
          other->second, view.name, stem));
    }
    view.camera = CameraOf(view, selection);
    tasks.push_back({std::move(view), std::move(stem)});
  }
  return tasks;
}

std::optional<ColmapModel> ModelOf(std::span<const RenderTask> tasks) {
  std::vector<PosedImage> images;
  for (const RenderTask& task : tasks) {
    if (task.view.camera.is_panorama()) return std::nullopt;
    images.push_back(task.view);
  }
  return ModelOfImages(images);
}

}  // namespace raylift
