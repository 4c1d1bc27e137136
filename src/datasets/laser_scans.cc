// ScanNet++ (Yeshwanth et al., ICCV 2023), a scene's folder as it is published
// (github.com/scannetpp/scannetpp, common/scene_release.py): photographs of a DSLR with a fisheye
// lens in dslr/resized_images, their COLMAP model in dslr/colmap, dslr/train_test_lists.json; a
// telephone's frames in iphone/rgb with theirs in iphone/colmap; a mesh of the laser scans in the
// same frame, scans/mesh_aligned_0.05.ply. References are the DSLR's training photographs, and one
// scene has its test photographs as queries, a second one the telephone's.

#include <set>

#include "datasets/importers.h"
#include "io/text/json_document.h"

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/io/colmap_model.h"

namespace raylift {
namespace {

using std::filesystem::path;

std::set<std::string> ReadNames(const JsonPlace& root, std::string_view key) {
  const JsonPlace list = root.Member(key);
  std::set<std::string> names;
  for (size_t i = 0; i < list.ArraySize(); ++i) names.insert(list.At(i).String());
  return names;
}

// Returns the images of a model whose photographs are there.
std::vector<PosedImage> ReadFrames(const path& model, const path& photographs,
                                   const ImportOptions& options, Skipped& skipped) {
  std::vector<PosedImage> frames;
  for (PosedImage& image : ReadColmapModel(model).PosedImages()) {
    if (!skipped.HasPhotograph(photographs, image.name)) continue;
    if (options.camera) image.camera = *options.camera;
    frames.push_back(std::move(image));
  }
  return frames;
}

// Makes what both scenes share: all but their queries.
ImportedScene MakeScene(const path& folder, const std::string& device) {
  ImportedScene scene = SceneOfFolder(folder);
  scene.folder = device;
  scene.name += "_" + device;
  scene.images = folder / "dslr" / "resized_images";
  scene.thresholds = "0.02,2:0.05,5:0.25,10";
  const path mesh = folder / "scans" / "mesh_aligned_0.05.ply";
  if (Exists(mesh)) {
    scene.geometries.push_back({"mesh", "mesh:" + mesh.string()});
  } else {
    scene.warnings.push_back(mesh.string() + " is missing: the scene has no mesh");
  }
  return scene;
}

ImportedScene ImportDslr(const path& folder, const std::set<std::string>& test,
                         const std::vector<PosedImage>& frames) {
  ImportedScene scene = MakeScene(folder, "dslr");
  scene.query_images = scene.images;
  for (const PosedImage& frame : frames) {
    if (test.contains(frame.name)) AddQuery(frame, scene);
  }
  return scene;
}

// The poses are of COLMAP, in the mesh's frame and meters; those of ARKit are not used.
ImportedScene ImportPhone(const path& folder, const ImportOptions& options) {
  ImportedScene scene = MakeScene(folder, "iphone");
  scene.query_images = folder / "iphone" / "rgb";
  Skipped skipped;
  for (const PosedImage& frame :
       ReadFrames(folder / "iphone" / "colmap", scene.query_images, options, skipped)) {
    AddQuery(frame, scene);
  }
  skipped.AddWarnings(scene.warnings);
  scene.notes.push_back(
      "the references are the DSLR's; the telephone's depth is none of theirs and is left out");
  return scene;
}

}  // namespace

ImportedScenes ImportScanNetPp(const path& folder, const ImportOptions& options) {
  const path lists = folder / "dslr" / "train_test_lists.json";
  const JsonDocument document(ReadFile(lists), lists);
  const JsonPlace root = document.Root();
  const std::set<std::string> train = ReadNames(root, "train"), test = ReadNames(root, "test");
  Skipped skipped;
  const std::vector<PosedImage> frames =
      ReadFrames(folder / "dslr" / "colmap", folder / "dslr" / "resized_images", options, skipped);
  ImportedScenes scenes;
  scenes.push_back(ImportDslr(folder, test, frames));
  const path phone = folder / "iphone";
  if (DetectColmapForm(phone / "colmap")) {
    if (std::filesystem::is_directory(phone / "rgb")) {
      scenes.push_back(ImportPhone(folder, options));
    } else {
      scenes.front().notes.push_back(
          "iphone is left out: its frames are still in rgb.mp4 (the toolbox's "
          "prepare_iphone_data.py extracts them to iphone/rgb)");
    }
  }
  for (ImportedScene& scene : scenes) {
    for (const PosedImage& frame : frames) {
      if (train.contains(frame.name)) scene.references.push_back(frame);
    }
    skipped.AddWarnings(scene.warnings);
    RequireImages(folder, scene);
  }
  return scenes;
}

// ETH3D's high-resolution multi-view scenes (Schoeps et al., CVPR 2017; eth3d.net/documentation):
// photographs below images/, and dslr_calibration_jpg/ (as they were taken, THIN_PRISM_FISHEYE) or
// dslr_calibration_undistorted/ (PINHOLE), COLMAP's text models, whose names are relative to
// images/. Training scenes have ground_truth_depth/dslr_images/NAME.JPG, plain floats that fit the
// photographs as they were taken, and occlusion/surface_mesh.ply, a mesh of the laser scans.

namespace {

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
  calibrated.frames = ReadFrames(calibrated.model, folder / "images", options, calibrated.skipped);
  return calibrated;
}

// Returns the calibration of the photographs as they were taken, where they are there: the depth
// maps are theirs.
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
