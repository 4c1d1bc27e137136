#include "lifting/depth_convention.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "scene/seven_scenes_kinect.h"
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

constexpr double kMillimeter = 0.001;

// COLMAP's maps belong to the undistorted cameras of its dense workspace.
DepthConvention Colmap() {
  return {.unit = 1,
          .patterns = {"stereo/depth_maps/{name}.geometric.bin", "{name}.geometric.bin",
                       "depth_maps/{name}.geometric.bin", "{name}.bin"}};
}

// nerfacto's maps hold the expected distance along the unit ray, already divided by the
// dataparser's scale.
DepthConvention Nerfstudio() {
  return {.kind = DepthKind::kRay,
          .unit = 1,
          .patterns = {"raw-depth/{dir}/{stem}.npy.gz", "raw-depth/{name}.npy.gz",
                       "{dir}/{stem}.npy.gz", "{name}.npy.gz"}};
}

DepthConvention Metric3d() {
  return {.unit = 1, .patterns = {"{dir}/{stem}.npy", "{name}.npy", "{stem}.npy"}};
}

// Returns the convention of the sensor's maps, or of those rendered into the color camera for
// DSAC*, which hloc uses.
DepthConvention SevenScenes() {
  return {.unit = kMillimeter,
          .invalid_values = {65535},
          .max_depth = 1000,
          .patterns = {"{flat7}.pose.depth.tiff", "{dir}/{base}.depth.png"}};
}

// Returns the convention of the depth camera's own maps, which stands beside the camera of the
// photographs.
DepthConvention SevenScenesSensor() {
  DepthConvention convention = SevenScenes();
  convention.patterns = {"{dir}/{base}.depth.png"};
  convention.sensor = DepthSensor{SevenScenesDepthCamera(), SevenScenesColorFromDepth()};
  return convention;
}

DepthConvention TwelveScenes() {
  return {.unit = kMillimeter,
          .patterns = {"{dir}/{base}.depth.png", "data/{base}.depth.png", "{base}.depth.png"}};
}

DepthConvention ScanNet() {
  return {.unit = kMillimeter,
          .patterns = {"{dir}/../depth/{stem}.png", "depth/{stem}.png", "{dir}/{base}.depth.pgm",
                       "{stem}.png"}};
}

DepthConvention Tum() {
  return {.unit = 1.0 / 5000,
          .patterns = {"{dir}/../depth/{time}.png", "depth/{time}.png", "{time}.png"}};
}

// 3dv-tools renders them so; "name" ends at its first dot.
DepthConvention MeshLoc() {
  return {.unit = 1, .patterns = {"{dir}/{base}_depth.npz", "{flat}_depth.npz"}, .layer = "depth"};
}

DepthConvention Lamar() {
  return {.unit = kMillimeter,
          .patterns = {"{name}.png", "{dir}/{stem}.png", "{dir}/{stem}.depth.png"}};
}

// These are of the distorted originals; infinity where the laser saw nothing.
DepthConvention Eth3d() {
  return {.unit = 1,
          .patterns = {"ground_truth_depth/{name}", "{name}", "{dir}/{stem}.JPG"},
          .headerless = true};
}

// Registered maps come first; 65.535 is what became of 7-Scenes' "none" before kapture 1.1.
DepthConvention Kapture() {
  return {
      .unit = 1,
      .invalid_values = {65.535},
      .patterns = {"{dir}/{base}.depth.reg", "{dir}/{base}.depth",
                   "sensors/records_data/{dir}/{base}.depth.reg",
                   "sensors/records_data/{dir}/{base}.depth", "{dir}/{stem}.depth", "{name}.depth",
                   "sensors/records_data/{name}.depth", "sensors/records_data/{dir}/{stem}.depth"},
      .headerless = true};
}

// ByteDance-Seed/Depth-Anything-3, utils/export/npz.py (export_to_npz, export_to_mini_npz) and
// npy.py write z, (N, H, W), at the network's size, and camera from world, (N, 3, 4).
// utils/io/input_processor.py stretches images to multiples of 14 ("upper_bound_resize", the
// default); those of "*_crop" have fit=crop.
DepthConvention DepthAnything3() {
  return {
      .unit = 1,
      .bundle = {.files = {"exports/npz/results.npz", "exports/mini_npz/results.npz", "results.npz",
                           "exports/npy/depth.npy", "exports/mini_npy/depth.npy", "depth.npy"},
                 .poses = "extrinsics"},
      .layer = "depth",
      .confidence_pattern = "conf"};
}

// facebookresearch/vggt, demo_gradio.py (gradio_demo) writes it: z, (N, H, W, 1), camera from world
// (N, 3, 4), images sorted by path; utils/load_fn.py (load_and_preprocess_images, mode "crop")
// makes them 518 wide and multiples of 14 high. Its mode "pad" has fit=pad.
DepthConvention Vggt() {
  return {.unit = 1,
          .bundle = {.files = {"predictions.npz"}, .poses = "extrinsic"},
          .fit = MapFit::kWidth,
          .layer = "depth",
          .confidence_pattern = "depth_conf"};
}

// facebookresearch/map-anything, scripts/gradio_app.py (run_model, gradio_demo) writes it: z,
// (N, H, W, 1), world from camera (N, 4, 4), images sorted by name; utils/image.py (load_images,
// "fixed_mapping") and cropping.py scale images to cover one of its sizes, and cut them.
DepthConvention MapAnything() {
  return {.unit = 1,
          .bundle = {.files = {"predictions.npz"},
                     .poses = "extrinsic",
                     .pose_convention = PoseConvention::kWorldFromCam},
          .fit = MapFit::kCropFloor,
          .layer = "depth",
          .confidence_pattern = "conf"};
}

// naver/mast3r, cloud_opt/sparse_ga.py (get_dense_pts3d, get_im_poses) gives depth, points in its
// world and poses, world from camera, but writes no file: its user names the arrays. dust3r's
// utils/image.py (load_images) scales images to 512 and cuts them to multiples of 16.
DepthConvention Mast3r() {
  return {.unit = 1,
          .bundle = {.pose_convention = PoseConvention::kWorldFromCam},
          .fit = MapFit::kCrop};
}

// microsoft/MoGe, scripts/infer.py (main, --maps), writes z at the photograph's size, infinite
// where there is none. Depth is metric since version 2, and up to a scale in version 1.
DepthConvention Moge() {
  return {.unit = 1, .patterns = {"{dir}/{stem}/depth.exr", "{stem}/depth.exr"}};
}

// lpiccinelli-eth/UniDepth, models/unidepthv2/unidepthv2.py (infer), gives z, (1, 1, H, W), at the
// photograph's size; it writes no file. Its "confidence" grows with the error
// (ops/losses/confidence.py): it is not used.
DepthConvention UniDepth() {
  return {.unit = 1,
          .patterns = {"{dir}/{stem}.npz", "{dir}/{stem}.npy", "{name}.npy", "{stem}.npz",
                       "{stem}.npy"},
          .layer = "depth"};
}

// apple/ml-depth-pro, cli/run.py (run), writes z in meters, at the photograph's size.
DepthConvention DepthPro() {
  return {.unit = 1, .patterns = {"{dir}/{stem}.npz", "{stem}.npz"}, .layer = "depth"};
}

struct Preset {
  std::string_view name;
  DepthConvention (*make)();
};
constexpr std::array<Preset, 19> kPresets = {{{"colmap", &Colmap},
                                              {"nerfstudio", &Nerfstudio},
                                              {"metric3d", &Metric3d},
                                              {"7scenes", &SevenScenes},
                                              {"7scenes_sensor", &SevenScenesSensor},
                                              {"12scenes", &TwelveScenes},
                                              {"scannet", &ScanNet},
                                              {"tum", &Tum},
                                              {"meshloc", &MeshLoc},
                                              {"lamar", &Lamar},
                                              {"eth3d", &Eth3d},
                                              {"kapture", &Kapture},
                                              {"da3", &DepthAnything3},
                                              {"vggt", &Vggt},
                                              {"mapanything", &MapAnything},
                                              {"mast3r", &Mast3r},
                                              {"moge", &Moge},
                                              {"unidepth", &UniDepth},
                                              {"depthpro", &DepthPro}}};

// Reads the stored depth in scene units, 0 where it means none.
class ValueReader {
 public:
  ValueReader(const StoredDepth& stored, const DepthConvention& convention)
      : convention_(convention), factor_(StoredUnit(stored, convention)) {}

  double Read(float stored) const {
    constexpr double kSameValue = 1e-6;  // floats, also where they are written with few digits
    const double value = static_cast<double>(stored);
    if (!(value > 0) || !std::isfinite(value)) return 0;
    for (const double invalid : convention_.invalid_values) {
      if (std::abs(value - invalid) <= kSameValue * std::abs(invalid)) return 0;
    }
    const double depth =
        convention_.kind == DepthKind::kInverse ? 1 / (value * factor_) : value * factor_;
    return depth <= convention_.max_depth ? depth : 0;
  }

 private:
  const DepthConvention& convention_;
  double factor_;
};

bool IsTrusted(const StoredDepth& confidence, const DepthMap& map, int x, int y, double threshold) {
  // The pixel of the confidence map in which this pixel's center lies.
  const auto scaled = [](int at, int size, int other_size) {
    return static_cast<size_t>((2 * int64_t{at} + 1) * other_size / (2 * int64_t{size}));
  };
  const size_t column = scaled(x, map.width_px, confidence.width_px);
  const size_t row = scaled(y, map.height_px, confidence.height_px);
  const float value = confidence.values[row * static_cast<size_t>(confidence.width_px) + column];
  return static_cast<double>(value) >= threshold;
}

void DropUntrusted(const StoredDepth& confidence, double threshold, DepthMap& map) {
  for (int y = 0; y < map.height_px; ++y) {
    for (int x = 0; x < map.width_px; ++x) {
      if (!IsTrusted(confidence, map, x, y, threshold)) {
        map.z[static_cast<size_t>(y) * static_cast<size_t>(map.width_px) + static_cast<size_t>(x)] =
            0;
      }
    }
  }
}

}  // namespace

std::optional<DepthConvention> DepthPreset(std::string_view name) {
  for (const Preset& preset : kPresets) {
    if (preset.name == name) return preset.make();
  }
  return std::nullopt;
}

std::string DepthPresetNames() {
  std::string names;
  for (const Preset& preset : kPresets) {
    names += (names.empty() ? "" : "|") + std::string(preset.name);
  }
  return names;
}

std::string ExpandPattern(std::string_view pattern, std::string_view image_name,
                          std::optional<size_t> index) {
  const size_t slash = image_name.rfind('/');
  const bool has_folder = slash != std::string_view::npos;
  const std::string folder(has_folder ? image_name.substr(0, slash) : std::string_view());
  const std::string_view file = has_folder ? image_name.substr(slash + 1) : image_name;
  const std::string base(file.substr(0, file.find('.')));
  std::string joined = folder;
  std::replace(joined.begin(), joined.end(), '/', '_');
  std::string joined7 = joined;
  std::erase(joined7, '-');
  const std::string separator = has_folder ? "_" : "";

  const std::array<std::pair<std::string_view, std::string>, 7> values = {
      {{"{dir}", folder},
       {"{stem}", std::string(file.substr(0, file.rfind('.')))},
       {"{base}", base},
       {"{flat}", joined + separator + base},
       {"{flat7}", joined7 + separator + base},
       {"{name}", std::string(image_name)},
       {"{index}", index ? fmt::format("{:08}", *index) : "{index}"}}};
  // A pattern without folder must not become an absolute path.
  constexpr std::string_view kFolderOfIt = "{dir}/";
  std::string path;
  while (!pattern.empty()) {
    const auto value = std::ranges::find_if(
        values, [pattern](const auto& known) { return pattern.starts_with(known.first); });
    if (!has_folder && pattern.starts_with(kFolderOfIt)) {
      pattern.remove_prefix(kFolderOfIt.size());
    } else if (value != values.end()) {
      path += value->second;
      pattern.remove_prefix(value->first.size());
    } else {
      path += pattern.front();
      pattern.remove_prefix(1);
    }
  }
  return path;
}

std::vector<float> RayZOfPixels(const Camera& camera) {
  std::vector<float> ray_z;
  ray_z.reserve(static_cast<size_t>(camera.width_px()) * static_cast<size_t>(camera.height_px()));
  for (int y = 0; y < camera.height_px(); ++y) {
    for (int x = 0; x < camera.width_px(); ++x) {
      const auto ray = camera.RayInCam({x + 0.5, y + 0.5});
      ray_z.push_back(ray ? static_cast<float>(camera.DepthOf(*ray)) : 0.0f);
    }
  }
  return ray_z;
}

double StoredUnit(const StoredDepth& stored, const DepthConvention& convention) {
  const bool floats = stored.sample_type.starts_with("float");
  return convention.scale * convention.unit.value_or(floats ? 1 : kMillimeter);
}

StoredDepth Oriented(StoredDepth stored, MapOrientation orientation) {
  using enum MapOrientation;
  if (orientation == kAsStored) return stored;
  const auto width = static_cast<size_t>(stored.width_px);
  const auto height = static_cast<size_t>(stored.height_px);
  const bool flip_x = orientation == kFlippedX || orientation == kHalfTurn;
  const bool flip_y = orientation == kFlippedY || orientation == kHalfTurn;
  std::vector<float> values(stored.values.size());
  for (size_t y = 0; y < height; ++y) {
    for (size_t x = 0; x < width; ++x) {
      const size_t to = orientation == kTransposed
                            ? x * height + y
                            : (flip_y ? height - 1 - y : y) * width + (flip_x ? width - 1 - x : x);
      values[to] = stored.values[y * width + x];
    }
  }
  stored.values = std::move(values);
  if (orientation == kTransposed) std::swap(stored.width_px, stored.height_px);
  return stored;
}

DepthMap ToDepthMap(const StoredDepth& stored, const Camera& camera,
                    const DepthConvention& convention, const StoredDepth* confidence,
                    std::span<const float> ray_z) {
  const Camera& own = convention.sensor ? convention.sensor->camera : camera;
  const ValueReader reader(stored, convention);
  DepthMap map{stored.width_px, stored.height_px, {}};
  map.z.reserve(stored.values.size());
  for (const float value : stored.values) {
    map.z.push_back(static_cast<float>(reader.Read(value)));
  }
  if (convention.kind == DepthKind::kRay) {
    std::vector<float> computed;
    if (ray_z.empty()) {
      computed = RayZOfPixels(own.Scaled(map.width_px, map.height_px));
      ray_z = computed;
    }
    RAYLIFT_CHECK_EQ(ray_z.size(), map.z.size());
    for (size_t i = 0; i < map.z.size(); ++i) map.z[i] *= std::max(ray_z[i], 0.0f);
  }
  if (confidence != nullptr && convention.confidence_threshold) {
    DropUntrusted(*confidence, *convention.confidence_threshold, map);
  }
  if (convention.sensor) {
    return RegisterDepth(map, *convention.sensor, camera.Scaled(map.width_px, map.height_px));
  }
  return map;
}

namespace {

constexpr double kMaxJump = 0.05;

// The position in the photograph of a sample of the sensor's map.
struct Corner {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double z = 0;  // 0: none
};

using Triangle = std::array<const Corner*, 3>;

std::vector<Corner> CornersInImage(const DepthMap& map, const DepthSensor& sensor,
                                   const Camera& image) {
  const Camera camera = sensor.camera.Scaled(map.width_px, map.height_px);
  std::vector<Corner> corners(map.z.size());
  for (int y = 0; y < map.height_px; ++y) {
    for (int x = 0; x < map.width_px; ++x) {
      const double z = static_cast<double>(map.At(x, y));
      const auto ray = z > 0 ? camera.RayInCam({x + 0.5, y + 0.5}) : std::nullopt;
      if (!ray || !(ray->z() > 0)) continue;
      const Eigen::Vector3d point = sensor.image_from_sensor * (*ray * (z / ray->z())).eval();
      const auto pixel = image.ImgFromCam(point);
      if (!pixel || !(point.z() > 0)) continue;
      corners[static_cast<size_t>(y) * static_cast<size_t>(map.width_px) + static_cast<size_t>(x)] =
          {*pixel, point.z()};
    }
  }
  return corners;
}

bool IsSurface(const Triangle& triangle) {
  double nearest = triangle[0]->z, farthest = nearest;
  for (const Corner* corner : triangle) {
    nearest = std::min(nearest, corner->z);
    farthest = std::max(farthest, corner->z);
  }
  return nearest > 0 && farthest <= nearest * (1 + kMaxJump);
}

double Cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

// 1/z is affine in the pixel.
void Draw(const Triangle& triangle, DepthMap& map) {
  const Eigen::Vector2d &a = triangle[0]->pixel, &b = triangle[1]->pixel, &c = triangle[2]->pixel;
  const double area = Cross(b - a, c - a);
  if (area == 0) return;
  const Eigen::Vector2d low = a.cwiseMin(b).cwiseMin(c), high = a.cwiseMax(b).cwiseMax(c);
  const int x0 = static_cast<int>(std::ceil(std::max(low.x() - 0.5, 0.0)));
  const int y0 = static_cast<int>(std::ceil(std::max(low.y() - 0.5, 0.0)));
  const int x1 = static_cast<int>(std::floor(std::min(high.x() - 0.5, map.width_px - 1.0)));
  const int y1 = static_cast<int>(std::floor(std::min(high.y() - 0.5, map.height_px - 1.0)));
  for (int y = y0; y <= y1; ++y) {
    for (int x = x0; x <= x1; ++x) {
      constexpr double kOnEdge = -1e-9;
      const Eigen::Vector2d center(x + 0.5, y + 0.5);
      const double weight_b = Cross(center - a, c - a) / area;
      const double weight_c = Cross(b - a, center - a) / area;
      const double weight_a = 1 - weight_b - weight_c;
      if (weight_a < kOnEdge || weight_b < kOnEdge || weight_c < kOnEdge) continue;
      const double inverse_z =
          weight_a / triangle[0]->z + weight_b / triangle[1]->z + weight_c / triangle[2]->z;
      float& z = map.z[static_cast<size_t>(y) * static_cast<size_t>(map.width_px) +
                       static_cast<size_t>(x)];
      const auto here = static_cast<float>(1 / inverse_z);
      if (z == 0 || here < z) z = here;
    }
  }
}

}  // namespace

DepthMap RegisterDepth(const DepthMap& map, const DepthSensor& sensor, const Camera& image) {
  const std::vector<Corner> corners = CornersInImage(map, sensor, image);
  DepthMap registered{image.width_px(), image.height_px(), {}};
  registered.z.resize(static_cast<size_t>(image.width_px()) *
                      static_cast<size_t>(image.height_px()));
  for (int y = 0; y + 1 < map.height_px; ++y) {
    for (int x = 0; x + 1 < map.width_px; ++x) {
      const Corner* top = &corners[static_cast<size_t>(y) * static_cast<size_t>(map.width_px) +
                                   static_cast<size_t>(x)];
      const Corner* bottom = top + map.width_px;
      for (const Triangle& triangle :
           {Triangle{top, top + 1, bottom}, Triangle{top + 1, bottom + 1, bottom}}) {
        if (IsSurface(triangle)) Draw(triangle, registered);
      }
    }
  }
  return registered;
}

}  // namespace raylift
