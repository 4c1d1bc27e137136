// Cambridge Landmarks (Kendall et al., ICCV 2015): dataset_{train,test}.txt with three header lines
// and rows `seq/frame.png X Y Z W P Q R`: the camera's center and the quaternion world to camera.
// The focal lengths and the radial distortion are in reconstruction.nvm alone, whose names end in
// .jpg.

#include "datasets/importers.h"
#include "io/text/line_tokens.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/io/image_file.h"

namespace raylift {
namespace {

using std::filesystem::path;

struct Focal {
  double focal_px = 0;
  double radial_distortion = 0;  // VisualSFM's, of the measured pixel
};

std::string WithoutExtension(const std::string& name) {
  return path(name).replace_extension().generic_string();
}

// Reads the lenses of the first model's cameras, by their names without extensions: lines `name f
// qw qx qy qz cx cy cz k 0`, the poses of which are not used. Throws InputError for anything else.
std::map<std::string, Focal> ReadFocals(const path& file) {
  LineReader lines(file);
  const auto header = lines.NextContent();
  if (!header || !header->starts_with("NVM_V3")) lines.Fail("expected NVM_V3");
  const auto count_line = lines.NextContent();
  if (!count_line) lines.Fail("expected the number of cameras, found the end of the file");
  const uint64_t count = lines.Uint(Trim(*count_line), "number of cameras");
  std::map<std::string, Focal> focals;
  for (uint64_t i = 0; i < count; ++i) {
    const auto line = lines.NextContent();
    if (!line) lines.Fail(fmt::format("expected {} cameras, found {}", count, i));
    LineTokens tokens(lines, *line);
    const std::string name(tokens.Token("name"));
    Focal focal{.focal_px = tokens.Double("focal length")};
    if (!(focal.focal_px > 0)) tokens.Fail("focal length: expected a positive number");
    tokens.Quaternion("quaternion");
    tokens.Vector<3>("camera center");
    focal.radial_distortion = tokens.Double("radial distortion");
    focals.emplace(WithoutExtension(name), focal);
  }
  return focals;
}

std::vector<NamedPose> ReadRows(const path& file) {
  std::vector<NamedPose> poses;
  LineReader lines(file);
  for (int i = 0; i < 3; ++i) lines.Next();
  while (const auto line = lines.NextContent()) {
    LineTokens tokens(lines, *line);
    NamedPose& pose = poses.emplace_back();
    pose.name = tokens.Token("name");
    const Eigen::Vector3d center_in_world = tokens.Vector<3>("camera position");
    const Eigen::Vector4d q = tokens.Quaternion("quaternion");
    pose.cam_from_world = PoseByCenter(q, center_in_world);
    tokens.ExpectEnd();
  }
  return poses;
}

// The cameras of the images, one per image.
class Cameras {
 public:
  Cameras(const path& folder, const ImportOptions& options) : folder_(folder), given_(options) {
    if (given_.camera) return;
    const path file = folder / "reconstruction.nvm";
    if (!std::filesystem::exists(file)) {
      throw InputError(file, "the file with the focal lengths is missing: give the camera instead");
    }
    focals_ = ReadFocals(file);
  }

  std::optional<Camera> Find(const std::string& name) {
    if (given_.camera) return given_.camera;
    const auto focal = focals_.find(WithoutExtension(name));
    if (focal == focals_.end()) return std::nullopt;
    const PlaneSize size = ReadImageSize(folder_ / name);
    std::vector<double> params = {focal->second.focal_px, 0.5 * size.width_px,
                                  0.5 * size.height_px};
    if (focal->second.radial_distortion == 0) {
      return Camera(CameraModel::kSimplePinhole, size.width_px, size.height_px, params);
    }
    ++num_distorted_;
    // VisualSFM undistorts by 1 + r |x|^2. kapture (kapture_import_nvm.py) and LIMAP take that for
    // k = -r, too, and Aachen's NVM agrees so with its official intrinsics.
    params.push_back(-focal->second.radial_distortion);
    return Camera(CameraModel::kSimpleRadial, size.width_px, size.height_px, params);
  }

  size_t num_distorted() const { return num_distorted_; }

 private:
  path folder_;
  ImportOptions given_;
  std::map<std::string, Focal> focals_;
  size_t num_distorted_ = 0;
};

std::vector<PosedImage> ReadImages(const path& folder, const path& list, Cameras& cameras,
                                   Skipped& skipped) {
  std::vector<PosedImage> images;
  for (const NamedPose& row : ReadRows(folder / list)) {
    if (!skipped.HasPhotograph(folder, row.name)) continue;
    const auto camera = cameras.Find(row.name);
    if (!camera) {
      skipped.Add("reconstruction.nvm does not hold its focal length", row.name);
      continue;
    }
    images.push_back({row.name, *camera, row.cam_from_world});
  }
  return images;
}

}  // namespace

ImportedScenes ImportCambridge(const path& folder, const ImportOptions& options) {
  ImportedScene scene = SceneOfFolder(folder);
  Cameras cameras(folder, options);
  Skipped skipped;
  scene.references = ReadImages(folder, "dataset_train.txt", cameras, skipped);
  for (const PosedImage& image : ReadImages(folder, "dataset_test.txt", cameras, skipped)) {
    AddQuery(image, scene);
    scene.groups.emplace(image.name, path(image.name).parent_path().generic_string());
  }
  std::erase_if(scene.groups, [](const auto& entry) { return entry.second.empty(); });
  skipped.AddWarnings(scene.warnings);
  if (cameras.num_distorted() > 0) {
    scene.notes.push_back(fmt::format(
        "the radial distortion r of {} images is VisualSFM's, of the distorted pixel: it is taken "
        "for SIMPLE_RADIAL with k = -r, as kapture does",
        cameras.num_distorted()));
  }
  RequireImages(folder, scene);
  scene.thresholds = "cambridge";
  return {std::move(scene)};
}

}  // namespace raylift
