// ScanNet (Dai et al., CVPR 2017), as its SensReader exports a scene: color/N.jpg, depth/N.png,
// pose/N.txt (camera to world, -inf where it was not tracked) and intrinsic/intrinsic_color.txt.

#include "datasets/importers.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/io/image_file.h"

namespace raylift {
namespace {

using std::filesystem::path;

Camera ReadCamera(const path& file, const path& photograph) {
  const Eigen::Matrix4d k = ReadMatrix(file);
  const PlaneSize size = ReadImageSize(photograph);
  try {
    return Camera(CameraModel::kPinhole, size.width_px, size.height_px,
                  std::vector<double>{k(0, 0), k(1, 1), k(0, 2), k(1, 2)});
  } catch (const InputError& error) {
    throw InputError(file, error.what());
  }
}

}  // namespace

ImportedScenes ImportScanNet(const path& folder, const ImportOptions& options) {
  ImportedScene scene = SceneOfFolder(folder);
  SharedCamera camera(options);
  std::vector<PosedImage> frames;
  Skipped skipped;
  for (const std::string& file : ListFiles(folder / "pose", ".txt")) {
    const std::string name = "color/" + path(file).stem().string() + ".jpg";
    const auto world_from_cam = ReadWorldFromCam(folder / "pose" / file);
    if (!world_from_cam) {
      skipped.Add("the pose is not finite", name);
      continue;
    }
    if (!std::filesystem::exists(folder / name)) {
      skipped.Add("the photograph is missing", name);
      continue;
    }
    const Camera& of_all = camera.Get(
        [&] { return ReadCamera(folder / "intrinsic" / "intrinsic_color.txt", folder / name); });
    frames.push_back({name, of_all, world_from_cam->Inverse()});
  }
  skipped.AddWarnings(scene.warnings);
  SplitFrames(frames, options.query_every, folder, scene);
  scene.thresholds = "0.05,5:0.1,1:0.25,2";
  if (std::filesystem::is_directory(folder / "depth")) {
    scene.geometries.push_back({"sensor", "depth:" + folder.string() + ",preset=scannet"});
  }
  const path mesh = folder / (scene.name + "_vh_clean_2.ply");
  if (std::filesystem::exists(mesh)) {
    scene.geometries.push_back({"mesh", "mesh:" + mesh.string()});
  }
  return {std::move(scene)};
}

}  // namespace raylift
