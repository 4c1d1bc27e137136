#include "raylift/datasets/dataset.h"

#include <array>

#include "datasets/importers.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/io/colmap_model.h"

namespace raylift {
namespace {

using std::filesystem::path;

constexpr std::array<Dataset, 12> kDatasets = {{
    {"7scenes", "7-Scenes",
     "a scene's folder: TrainSplit.txt, TestSplit.txt, seq-XX/frame-XXXXXX.{color.png,pose.txt}",
     &Import7Scenes},
    {"12scenes", "12 Scenes",
     "a room's folder: info.txt, split.txt, data/frame-XXXXXX.{color.jpg,pose.txt}",
     &Import12Scenes},
    {"cambridge", "Cambridge Landmarks",
     "a landmark's folder: dataset_train.txt, dataset_test.txt, reconstruction.nvm, seqN/*.png",
     &ImportCambridge},
    {"aachen", "Aachen Day-Night v1.1", "images_upright/, queries/, 3D-models/aachen_v_1_1/",
     &ImportAachen},
    {"cmu", "Extended CMU Seasons",
     "intrinsics.txt and sliceN/{database,query,sparse}/, or one of the slices", &ImportCmu},
    {"gangnam", "Gangnam Station (kapture)", "a floor's release/{mapping,validation,test}/sensors/",
     &ImportGangnam},
    {"nerfstudio", "nerfstudio",
     "transforms.json (of instant-ngp, too), or transforms_{train,test}.json, and images",
     &ImportNerfstudio},
    {"tum", "TUM RGB-D", "a sequence's folder: rgb.txt, groundtruth.txt, rgb/, depth/", &ImportTum},
    {"scannet", "ScanNet",
     "an exported scene: color/N.jpg, pose/N.txt, intrinsic/intrinsic_color.txt, depth/N.png,\n"
     "or frame-NNNNNN.{color.jpg,pose.txt,depth.pgm}, _info.txt",
     &ImportScanNet},
    {"scannetpp", "ScanNet++",
     "a scene's folder: dslr/{resized_images,colmap,train_test_lists.json}, scans/, and\n"
     "iphone/{rgb,colmap} for a second scene of the telephone's queries",
     &ImportScanNetPp},
    {"eth3d", "ETH3D (high-resolution multi-view)",
     "a scene's folder: images/, dslr_calibration_jpg/ or dslr_calibration_undistorted/, and\n"
     "where they are public ground_truth_depth/, occlusion/",
     &ImportEth3d},
    {"lamar", "LaMAR, CroCoDL (capture format)",
     "a location's folder: sessions/map/ and sessions/query*/, each a scene", &ImportLamar},
}};

// Images of equal cameras share one.
ColmapModel MakeModel(const std::vector<PosedImage>& images) {
  ColmapModel model;
  std::map<std::string, uint32_t> id_of_camera;
  for (const PosedImage& image : images) {
    const auto [camera, is_new] = id_of_camera.emplace(
        image.camera.ToString(), static_cast<uint32_t>(id_of_camera.size() + 1));
    if (is_new) model.cameras.emplace(camera->second, image.camera);
    ColmapImage stored;
    stored.name = image.name;
    stored.camera_id = camera->second;
    stored.SetCamFromWorld(image.cam_from_world);
    model.images.emplace(static_cast<uint32_t>(model.images.size() + 1), std::move(stored));
  }
  return model;
}

std::vector<PosedImage> PosedQueries(const ImportedScene& scene) {
  std::map<std::string, Camera> cameras;
  for (const Query& query : scene.queries) cameras.emplace(query.name, query.camera);
  std::vector<PosedImage> images;
  for (const NamedPose& pose : scene.ground_truth) {
    images.push_back({pose.name, cameras.at(pose.name), pose.cam_from_world});
  }
  return images;
}

std::string Joined(const std::vector<std::string>& lines) {
  return fmt::format("{}", fmt::join(lines, "; "));
}

}  // namespace

std::span<const Dataset> AllDatasets() { return kDatasets; }

std::string DatasetNames() {
  std::string names;
  for (const Dataset& dataset : kDatasets) {
    if (!names.empty()) names += '|';
    names += dataset.name;
  }
  return names;
}

std::vector<ImportedScene> ImportDataset(std::string_view name, const path& folder,
                                         const ImportOptions& options) {
  for (const Dataset& dataset : kDatasets) {
    if (dataset.name == name) return dataset.import(folder, options);
  }
  throw OptionError("dataset", name, "expected " + DatasetNames());
}

path WriteImportedScene(const path& folder, const ImportedScene& scene, std::string_view dataset) {
  const path out = scene.folder.empty() ? folder : folder / scene.folder;
  SceneFile file;
  file.name = scene.name;
  file.images = scene.images;
  file.query_images = scene.query_images;
  file.thresholds = scene.thresholds;
  file.geometries = scene.geometries;
  file.references = scene.reference_model;
  if (file.references.empty()) {
    file.references = out / "references";
    WriteColmapModel(file.references, MakeModel(scene.references), ColmapForm::kBinary);
  }
  file.queries = out / "queries.txt";
  WriteQueryList(file.queries, scene.queries);
  if (!scene.ground_truth.empty()) {
    file.ground_truth = out / "ground_truth";
    WriteColmapModel(file.ground_truth, MakeModel(PosedQueries(scene)), ColmapForm::kBinary);
  }
  if (!scene.times.empty()) {
    file.times = out / "times.txt";
    WriteTimes(file.times, scene.times);
  }
  if (!scene.groups.empty()) {
    file.groups = out / "groups.txt";
    WriteGroups(file.groups, scene.groups);
  }
  file.provenance = {{"dataset", std::string(dataset)}};
  if (!scene.notes.empty()) file.provenance.emplace_back("notes", Joined(scene.notes));
  if (!scene.warnings.empty()) file.provenance.emplace_back("warnings", Joined(scene.warnings));
  WriteSceneFile(out / "scene.toml", file);
  return out / "scene.toml";
}

}  // namespace raylift
