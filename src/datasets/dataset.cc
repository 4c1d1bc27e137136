#include "raylift/datasets/dataset.h"

#include <algorithm>
#include <array>
#include <limits>
#include <utility>

#include "datasets/importers.h"
#include <Eigen/LU>
#include <Eigen/SVD>
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/image_file.h"

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
    WriteColmapModel(file.references, ModelOfImages(scene.references), ColmapForm::kBinary);
  }
  file.queries = out / "queries.txt";
  WriteQueryList(file.queries, scene.queries);
  if (!scene.ground_truth.empty()) {
    file.ground_truth = out / "ground_truth";
    WriteColmapModel(file.ground_truth, ModelOfImages(PosedQueries(scene)), ColmapForm::kBinary);
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

namespace {

// Rotations in text files are rounded; a matrix farther from a rotation than this is another
// matrix.
constexpr double kRotationTolerance = 0.02;

// Parses numbers as they were printed, infinities of Windows ("-1.#INF") included.
double NumberOrInfinity(const LineReader& lines, std::string_view token) {
  if (const auto number = ParseDouble(token)) return *number;
  for (const std::string_view none : {"INF", "inf", "IND", "NAN", "nan", "QNAN"}) {
    if (token.find(none) != std::string_view::npos) return std::numeric_limits<double>::infinity();
  }
  lines.Fail(fmt::format("expected a number, found \"{}\"", token));
}

Eigen::Matrix4d ReadAnyMatrix(const path& file) {
  Eigen::Matrix4d matrix;
  LineReader lines(file);
  for (int row = 0; row < 4; ++row) {
    const auto line = lines.NextContent();
    if (!line) lines.Fail(fmt::format("expected 4 rows of a matrix, found {}", row));
    const auto tokens = SplitTokens(*line);
    if (tokens.size() != 4) {
      lines.Fail(fmt::format("expected 4 numbers, found {}", tokens.size()));
    }
    for (int column = 0; column < 4; ++column) {
      matrix(row, column) = NumberOrInfinity(lines, tokens[static_cast<size_t>(column)]);
    }
  }
  return matrix;
}

// Returns why images were skipped, to end a message.
std::string Reasons(const ImportedScene& scene) {
  std::string reasons;
  for (const std::string& warning : scene.warnings) reasons += "; " + warning;
  return reasons;
}

}  // namespace

ImportedScene SceneOfFolder(const path& folder) {
  if (!std::filesystem::is_directory(folder)) {
    throw InputError(folder, "expected the folder of a data set");
  }
  ImportedScene scene;
  scene.name = std::filesystem::canonical(folder).filename().string();
  scene.images = folder;
  scene.query_images = folder;
  return scene;
}

void Skipped::Add(const std::string& reason, const std::string& name) {
  Entry& entry = entries_[reason];
  if (entry.count++ == 0) entry.first = name;
}

bool Skipped::HasPhotograph(const path& folder, const std::string& name) {
  if (Exists(folder / name)) return true;
  Add("the photograph is missing", name);
  return false;
}

void Skipped::AddWarnings(std::vector<std::string>& warnings) const {
  for (const auto& [reason, entry] : entries_) {
    warnings.push_back(fmt::format("{} {} skipped: {} (first: {})", entry.count,
                                   entry.count == 1 ? "image is" : "images are", reason,
                                   entry.first));
  }
}

void AddQuery(const PosedImage& image, ImportedScene& scene) {
  scene.queries.push_back({image.name, image.camera});
  scene.ground_truth.push_back({image.name, image.cam_from_world});
}

void NotePublicPoses(ImportedScene& scene) {
  if (scene.ground_truth.size() < scene.queries.size()) {
    scene.notes.push_back(fmt::format("poses of {} of {} queries are public",
                                      scene.ground_truth.size(), scene.queries.size()));
  }
}

void SplitFrames(const std::vector<PosedImage>& frames, int query_every, const path& source,
                 ImportedScene& scene) {
  for (size_t i = 0; i < frames.size(); ++i) {
    if ((i + 1) % static_cast<size_t>(query_every) == 0) {
      AddQuery(frames[i], scene);
    } else {
      scene.references.push_back(frames[i]);
    }
  }
  if (scene.queries.empty() || scene.references.empty()) {
    throw InputError(source, fmt::format("{} frames that can be used make no references and "
                                         "queries by query_every = {}{}",
                                         frames.size(), query_every, Reasons(scene)));
  }
}

void RequireImages(const path& folder, const ImportedScene& scene) {
  const std::string skipped = Reasons(scene);
  if (scene.references.empty() && scene.reference_model.empty()) {
    throw InputError(folder, "no references are left" + skipped);
  }
  if (scene.queries.empty()) throw InputError(folder, "no queries are left" + skipped);
}

SharedCamera::SharedCamera(const ImportOptions& options) : known_(options.camera.has_value()) {
  if (options.camera) camera_ = *options.camera;
}

const Camera& SharedCamera::Get(const std::function<Camera()>& make) {
  if (!known_) camera_ = make();
  known_ = true;
  return camera_;
}

Camera FitToPhotograph(const Camera& camera, const path& photograph) {
  const PlaneSize size = ReadImageSize(photograph);
  if (size.width_px == camera.width_px() && size.height_px == camera.height_px()) return camera;
  return camera.Scaled(size.width_px, size.height_px);
}

std::optional<Rigid3> RigidFromMatrix(const Eigen::Matrix4d& matrix) {
  if (!matrix.allFinite() || !matrix.row(3).isApprox(Eigen::RowVector4d(0, 0, 0, 1), 1e-6)) {
    return std::nullopt;
  }
  const Eigen::Matrix3d given = matrix.topLeftCorner<3, 3>();
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(given, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::Matrix3d rotation = svd.matrixU() * svd.matrixV().transpose();
  if (rotation.determinant() < 0 || (rotation - given).norm() > kRotationTolerance) {
    return std::nullopt;
  }
  return Rigid3{Eigen::Quaterniond(rotation).normalized(), matrix.topRightCorner<3, 1>()};
}

Rigid3 PoseByCenter(const Eigen::Vector4d& q, const Eigen::Vector3d& center_in_world) {
  const Eigen::Quaterniond rotation = Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized();
  return {rotation, -(rotation * center_in_world)};
}

std::optional<Rigid3> ReadWorldFromCam(const path& file) {
  const Eigen::Matrix4d matrix = ReadAnyMatrix(file);
  if (!matrix.allFinite()) return std::nullopt;
  auto world_from_cam = RigidFromMatrix(matrix);
  if (!world_from_cam) throw InputError(file, "expected a rotation and a translation");
  return world_from_cam;
}

Eigen::Matrix4d ReadMatrix(const path& file) {
  Eigen::Matrix4d matrix = ReadAnyMatrix(file);
  if (!matrix.allFinite()) throw InputError(file, "expected finite numbers");
  return matrix;
}

std::vector<std::string> ListFiles(const path& folder, const std::string& suffix) {
  if (!std::filesystem::is_directory(folder)) throw InputError(folder, "there is no such folder");
  std::vector<std::pair<uint64_t, std::string>> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    if (!name.ends_with(suffix) || name.size() == suffix.size()) continue;
    const std::string stem = name.substr(0, name.size() - suffix.size());
    files.emplace_back(ParseUint(stem).value_or(0), name);
  }
  std::sort(files.begin(), files.end());
  std::vector<std::string> names;
  names.reserve(files.size());
  for (auto& [number, name] : files) names.push_back(std::move(name));
  return names;
}

}  // namespace raylift
