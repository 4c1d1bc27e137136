// ETH3D's high-resolution multi-view scenes (Schoeps et al., CVPR 2017; eth3d.net/documentation):
// photographs below images/, and dslr_calibration_jpg/ (as they were taken, THIN_PRISM_FISHEYE) or
// dslr_calibration_undistorted/ (PINHOLE), COLMAP's text models, whose names are relative to images/.
// Training scenes have ground_truth_depth/dslr_images/NAME.JPG, plain floats that fit the photographs
// as they were taken, and occlusion/surface_mesh.ply, a mesh of the laser scans.

#include "datasets/importers.h"

#include "raylift/base/error.h"
#include "raylift/io/colmap_model.h"

namespace raylift {
namespace {

using std::filesystem::path;

constexpr std::string_view kDistorted = "dslr_calibration_jpg";
constexpr std::string_view kUndistorted = "dslr_calibration_undistorted";

// A calibration and those of its photographs that are there.
struct Calibrated {
  path model;
  std::vector<PosedImage> frames;
  Skipped skipped;
};

std::optional<Calibrated> ReadCalibrated(const path& folder, std::string_view name,
                                         const ImportOptions& options) {
  Calibrated calibrated{.model = folder / name, .frames = {}, .skipped = {}};
  if (!DetectColmapForm(calibrated.model)) return std::nullopt;
  for (PosedImage& image : ReadColmapModel(calibrated.model).PosedImages()) {
    if (!Exists(folder / "images" / image.name)) {
      calibrated.skipped.Add("the photograph is missing", image.name);
      continue;
    }
    if (options.camera) image.camera = *options.camera;
    calibrated.frames.push_back(std::move(image));
  }
  return calibrated;
}

// The photographs as they were taken, where they are there: the depth maps are theirs.
Calibrated Choose(const path& folder, const ImportOptions& options) {
  std::optional<Calibrated> chosen;
  for (const std::string_view name : {kDistorted, kUndistorted}) {
    auto calibrated = ReadCalibrated(folder, name, options);
    if (!calibrated) continue;
    if (!chosen || chosen->frames.empty()) chosen = std::move(calibrated);
  }
  if (!chosen) {
    throw InputError(folder,
                     "expected dslr_calibration_jpg or dslr_calibration_undistorted there, "
                     "each a COLMAP model");
  }
  return *std::move(chosen);
}

}  // namespace

ImportedScenes ImportEth3d(const path& folder, const ImportOptions& options) {
  ImportedScene scene = SceneOfFolder(folder);
  scene.images = scene.query_images = folder / "images";
  const Calibrated chosen = Choose(folder, options);
  chosen.skipped.AddWarnings(scene.warnings);
  SplitFrames(chosen.frames, options.query_every, chosen.model, scene);
  scene.thresholds = "0.02,2:0.05,5:0.25,10";
  const path mesh = folder / "occlusion" / "surface_mesh.ply";
  if (Exists(mesh)) scene.geometries.push_back({"mesh", "mesh:" + mesh.string()});
  const bool has_depth = std::filesystem::is_directory(folder / "ground_truth_depth");
  if (has_depth && chosen.model.filename() == kDistorted) {
    scene.geometries.push_back({"laser", "depth:" + folder.string() + ",preset=eth3d"});
  } else if (has_depth) {
    scene.notes.push_back(
        "ground_truth_depth is left out: its maps fit the photographs as they were taken, not the "
        "undistorted ones");
  }
  if (Exists(folder / "dslr_scan_eval")) {
    scene.notes.push_back(
        "the scans in dslr_scan_eval are left out: each is in a frame of its own "
        "(scan_alignment.mlp)");
  }
  return {std::move(scene)};
}

}  // namespace raylift
