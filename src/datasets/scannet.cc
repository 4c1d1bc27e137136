#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "base/read_limits.h"
#include "datasets/importers.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/io/image_file.h"

namespace raylift {
namespace {

using std::filesystem::path;

// Reads lines "key = value".
class Info {
 public:
  explicit Info(const path& file) : file_(file) {
    LineReader lines(file);
    while (const auto line = lines.NextContent()) {
      const size_t equals = line->find('=');
      if (equals == std::string_view::npos) continue;
      values_[std::string(Trim(line->substr(0, equals)))] = Trim(line->substr(equals + 1));
    }
  }

  // Returns the numbers of a value; at least `count`.
  std::vector<double> Numbers(const std::string& key, size_t count) const {
    const auto value = values_.find(key);
    if (value == values_.end()) throw InputError(file_, key, "the value is missing");
    std::vector<double> numbers;
    for (const std::string_view token : SplitTokens(value->second)) {
      const auto number = ParseDouble(token);
      if (!number || !std::isfinite(*number)) {
        throw InputError(file_, key, fmt::format("expected numbers, found \"{}\"", token));
      }
      numbers.push_back(*number);
    }
    if (numbers.size() < count) {
      throw InputError(file_, key,
                       fmt::format("expected {} numbers, found {}", count, numbers.size()));
    }
    return numbers;
  }

  int Side(const std::string& key) const {
    const double side = Numbers(key, 1)[0];
    if (!(side >= 1 && side <= kMaxImageSidePx))
      throw InputError(file_, key, "expected a size in pixels");
    return static_cast<int>(side);
  }

 private:
  path file_;
  std::map<std::string, std::string> values_;
};

// Returns a PINHOLE camera. Its center is counted from the center of the first pixel, as SensReader
// does (sensorData.h projects to whole pixels): half a pixel more here.
Camera CameraOfSensor(int width_px, int height_px, double fx, double fy, double cx, double cy) {
  return Camera(CameraModel::kPinhole, width_px, height_px,
                std::vector<double>{fx, fy, cx + 0.5, cy + 0.5});
}

}  // namespace

Camera ReadColorCamera(const path& file) {
  const Info info(file);
  const std::vector<double> k = info.Numbers("m_calibrationColorIntrinsic", 7);  // rows of four
  const int width_px = info.Side("m_colorWidth"), height_px = info.Side("m_colorHeight");
  try {
    return CameraOfSensor(width_px, height_px, k[0], k[5], k[2], k[6]);
  } catch (const InputError& error) {
    throw InputError(file, "m_calibrationColorIntrinsic", error.what());
  }
}

// ScanNet (Dai et al., CVPR 2017), as either of its SensReaders exports a scene. Python's: color/
// N.jpg, depth/N.png, pose/N.txt and intrinsic/intrinsic_color.txt. C++'s: frame-NNNNNN.{color.jpg,
// depth.pgm,pose.txt} and _info.txt. Poses are camera to world, -inf where it was not tracked.

namespace {

// The layout of an export.
struct Export {
  path poses;
  std::string pose_suffix;
  // Takes a pose file's name without the suffix.
  std::string (*photograph)(const std::string& stem);
  Camera (*read_camera)(const path& folder, const path& photograph);
};

Camera ReadIntrinsics(const path& folder, const path& photograph) {
  const path file = folder / "intrinsic" / "intrinsic_color.txt";
  const Eigen::Matrix4d k = ReadMatrix(file);
  const PlaneSize size = ReadImageSize(photograph);
  try {
    return CameraOfSensor(size.width_px, size.height_px, k(0, 0), k(1, 1), k(0, 2), k(1, 2));
  } catch (const InputError& error) {
    throw InputError(file, error.what());
  }
}

Export FindExport(const path& folder) {
  if (std::filesystem::exists(folder / "_info.txt")) {
    return {folder, ".pose.txt", [](const std::string& stem) { return stem + ".color.jpg"; },
            [](const path& scene, const path& photograph) {
              return FitToPhotograph(ReadColorCamera(scene / "_info.txt"), photograph);
            }};
  }
  return {folder / "pose", ".txt", [](const std::string& stem) { return "color/" + stem + ".jpg"; },
          &ReadIntrinsics};
}

// Warns of resized pictures: SensReader can write smaller ones, but not their intrinsics.
void WarnOfResizedPictures(ImportedScene& scene) {
  constexpr double kFarFromMiddle = 0.1;
  const Camera& camera = scene.references.front().camera;
  const Eigen::Vector2d size(camera.width_px(), camera.height_px());
  const Eigen::Vector2d center = camera.principal_point_px().cwiseQuotient(size);
  if ((center.array() - 0.5).abs().maxCoeff() < kFarFromMiddle) return;
  scene.warnings.push_back(fmt::format(
      "the camera's axis is at ({:.0f}, {:.0f}) of {} x {} pixels: where the photographs were "
      "resized, the intrinsics are of another size: give the camera",
      camera.principal_point_px().x(), camera.principal_point_px().y(), camera.width_px(),
      camera.height_px()));
}

}  // namespace

ImportedScenes ImportScanNet(const path& folder, const ImportOptions& options) {
  ImportedScene scene = SceneOfFolder(folder);
  const Export layout = FindExport(folder);
  SharedCamera camera(options);
  std::vector<PosedImage> frames;
  Skipped skipped;
  for (const std::string& file : ListFiles(layout.poses, layout.pose_suffix)) {
    const std::string name =
        layout.photograph(file.substr(0, file.size() - layout.pose_suffix.size()));
    const auto world_from_cam = ReadWorldFromCam(layout.poses / file);
    if (!world_from_cam) {
      skipped.Add("the pose is not finite", name);
      continue;
    }
    if (!skipped.HasPhotograph(folder, name)) continue;
    const Camera& of_all = camera.Get([&] { return layout.read_camera(folder, folder / name); });
    frames.push_back({name, of_all, world_from_cam->Inverse()});
  }
  skipped.AddWarnings(scene.warnings);
  SplitFrames(frames, options.query_every, folder, scene);
  if (!options.camera) WarnOfResizedPictures(scene);
  scene.thresholds = "0.05,5:0.1,1:0.25,2";
  if (std::filesystem::is_directory(folder / "depth") ||
      std::filesystem::exists(folder / "frame-000000.depth.pgm")) {
    scene.geometries.push_back({"sensor", "depth:" + folder.string() + ",preset=scannet"});
  }
  const path mesh = folder / (scene.name + "_vh_clean_2.ply");
  if (std::filesystem::exists(mesh)) {
    scene.geometries.push_back({"mesh", "mesh:" + mesh.string()});
  }
  return {std::move(scene)};
}

}  // namespace raylift
