// Aachen Day-Night v1.1 (Sattler et al., CVPR 2018; Zhang et al., IJCV 2021): photographs in
// images_upright, queries/{day,night}_time_queries_with_intrinsics.txt, the COLMAP model of the
// references in 3D-models/aachen_v_1_1. The poses of the queries are not public.

#include <algorithm>
#include <array>
#include <utility>

#include "datasets/importers.h"
#include "io/text/line_tokens.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/io/colmap_model.h"

namespace raylift {
namespace {

using std::filesystem::path;

constexpr std::array<std::pair<std::string_view, std::string_view>, 2> kLists = {
    {{"day", "day_time_queries_with_intrinsics.txt"},
     {"night", "night_time_queries_with_intrinsics.txt"}}};

void TakeQueries(const path& folder, const ImportOptions& options, ImportedScene& scene) {
  Skipped skipped;
  for (const auto& [group, list] : kLists) {
    const path file = folder / "queries" / list;
    if (!std::filesystem::exists(file)) {
      scene.warnings.push_back(
          fmt::format("{} is missing: there are no queries of the {}", file.string(), group));
      continue;
    }
    for (Query& query : ReadQueryList(file)) {
      if (!skipped.HasPhotograph(scene.images, query.name)) continue;
      if (options.camera) query.camera = *options.camera;
      scene.groups.emplace(query.name, group);
      scene.queries.push_back(std::move(query));
    }
  }
  skipped.AddWarnings(scene.warnings);
}

}  // namespace

ImportedScenes ImportAachen(const path& folder, const ImportOptions& options) {
  ImportedScene scene = SceneOfFolder(folder);
  scene.images = scene.query_images = folder / "images_upright";
  scene.reference_model = folder / "3D-models" / "aachen_v_1_1";
  if (!DetectColmapForm(scene.reference_model)) {
    throw InputError(scene.reference_model, "expected COLMAP's cameras.bin and images.bin there");
  }
  TakeQueries(folder, options, scene);
  RequireImages(folder, scene);
  scene.thresholds = "aachen";
  scene.geometries = {{"sfm", "sfm"}};
  scene.notes.emplace_back(
      "the poses of the queries are not public: hand results in at visuallocalization.net "
      "(raylift evaluate checks submissions)");
  return {std::move(scene)};
}

// Extended CMU Seasons (Sattler et al., CVPR 2018; Badino et al., 2011): a folder per slice with
// database/, query/, sparse/ (COLMAP), ground-truth-database-images-sliceN.txt, test-images-
// sliceN.txt and camera-poses/*.txt, rows `name qw qx qy qz cx cy cz` with the camera's center; one
// intrinsics.txt of both cameras for all slices. Slices have nothing in common: each is a scene.

namespace {

// Returns a field of img_00119_c0_1303398474779439us.jpg, counted from 0.
std::string FieldOfName(const std::string& name, size_t index) {
  const std::string stem = path(name).stem().string();
  const auto fields = SplitBy(stem, '_');
  return index < fields.size() ? std::string(fields[index]) : "";
}

std::optional<double> SecondsOfName(const std::string& name) {
  const std::string field = FieldOfName(name, 3);
  if (!field.ends_with("us")) return std::nullopt;
  const auto microseconds = ParseUint(field.substr(0, field.size() - 2));
  if (!microseconds) return std::nullopt;
  return static_cast<double>(*microseconds) * 1e-6;
}

class Intrinsics {
 public:
  Intrinsics(const path& slice, const ImportOptions& options) : given_(options.camera) {
    if (given_) return;
    file_ = slice / "intrinsics.txt";
    const path of_all = (slice / ".." / "intrinsics.txt").lexically_normal();
    if (!std::filesystem::exists(file_) && std::filesystem::exists(of_all)) file_ = of_all;
    LineReader lines(file_);
    while (const auto line = lines.NextContent()) {
      LineTokens tokens(lines, *line);
      const std::string name(tokens.Token("camera"));
      cameras_.emplace(name, tokens.CameraToEnd());
    }
  }

  Camera Of(const std::string& image) const {
    if (given_) return *given_;
    const auto camera = cameras_.find(FieldOfName(image, 2));
    if (camera == cameras_.end()) {
      throw InputError(
          file_, fmt::format("no camera \"{}\" as \"{}\" names it", FieldOfName(image, 2), image));
    }
    return camera->second;
  }

 private:
  std::optional<Camera> given_;
  path file_;
  std::map<std::string, Camera> cameras_;
};

std::map<std::string, Rigid3> ReadPosesByCenter(const path& file) {
  std::map<std::string, Rigid3> poses;
  LineReader lines(file);
  while (const auto line = lines.NextContent()) {
    LineTokens tokens(lines, *line);
    const std::string name(tokens.Token("name"));
    const Eigen::Vector4d q = tokens.Quaternion("quaternion");
    const Eigen::Vector3d center_in_world = tokens.Vector<3>("camera center");
    tokens.ExpectEnd();
    poses[name] = PoseByCenter(q, center_in_world);
  }
  return poses;
}

// Warns where the model and the list of poses, which should be the same, differ.
void CompareReferences(const std::map<std::string, Rigid3>& listed, ImportedScene& scene) {
  constexpr double kFar = 0.01;
  size_t num_far = 0, num_common = 0;
  for (const PosedImage& image : ReadColmapModel(scene.reference_model).PosedImages()) {
    const auto pose = listed.find(image.name);
    if (pose == listed.end()) continue;
    ++num_common;
    const Eigen::Vector3d difference =
        pose->second.OriginInSource() - image.cam_from_world.OriginInSource();
    if (difference.norm() > kFar) ++num_far;
  }
  if (num_far > 0) {
    scene.warnings.push_back(fmt::format(
        "{} of {} references are elsewhere in sparse/ than in the list of poses; sparse/ is used",
        num_far, num_common));
  }
}

void TakeReferences(const path& slice, const Intrinsics& intrinsics, ImportedScene& scene) {
  const path list = slice / fmt::format("ground-truth-database-images-{}.txt", scene.name);
  const auto poses =
      std::filesystem::exists(list) ? ReadPosesByCenter(list) : std::map<std::string, Rigid3>();
  if (DetectColmapForm(slice / "sparse")) {
    scene.reference_model = slice / "sparse";
    scene.geometries = {{"sfm", "sfm"}};
    for (const PosedImage& image : ReadColmapModel(scene.reference_model).PosedImages()) {
      if (const auto seconds = SecondsOfName(image.name)) scene.times.emplace(image.name, *seconds);
    }
    CompareReferences(poses, scene);
    return;
  }
  if (poses.empty()) {
    throw InputError(list,
                     "expected the poses of the references there, or a COLMAP model in "
                     "sparse/");
  }
  for (const auto& [name, pose] : poses) {
    scene.references.push_back({name, intrinsics.Of(name), pose});
    if (const auto seconds = SecondsOfName(name)) scene.times.emplace(name, *seconds);
  }
}

void TakeQueries(const path& slice, const Intrinsics& intrinsics, ImportedScene& scene) {
  std::map<std::string, Rigid3> poses;
  if (std::filesystem::is_directory(slice / "camera-poses")) {
    for (const std::string& file : ListFiles(slice / "camera-poses", ".txt")) {
      poses.merge(ReadPosesByCenter(slice / "camera-poses" / file));
    }
  }
  for (const std::string& name :
       ReadImageList(slice / fmt::format("test-images-{}.txt", scene.name))) {
    scene.queries.push_back({name, intrinsics.Of(name)});
    scene.groups.emplace(name, scene.name);
    if (const auto seconds = SecondsOfName(name)) scene.times.emplace(name, *seconds);
    const auto pose = poses.find(name);
    if (pose != poses.end()) scene.ground_truth.push_back({name, pose->second});
  }
  NotePublicPoses(scene);
}

ImportedScene ImportSlice(const path& slice, const ImportOptions& options) {
  ImportedScene scene = SceneOfFolder(slice);
  scene.images = slice / "database";
  scene.query_images = slice / "query";
  const Intrinsics intrinsics(slice, options);
  TakeReferences(slice, intrinsics, scene);
  TakeQueries(slice, intrinsics, scene);
  RequireImages(slice, scene);
  scene.thresholds = "cmu";
  return scene;
}

std::vector<std::string> ListSlices(const path& folder) {
  std::vector<std::pair<uint64_t, std::string>> slices;
  constexpr std::string_view kPrefix = "slice";
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    if (!entry.is_directory() || !name.starts_with(kPrefix)) continue;
    const auto number = ParseUint(name.substr(kPrefix.size()));
    if (number) slices.emplace_back(*number, name);
  }
  std::sort(slices.begin(), slices.end());
  std::vector<std::string> names;
  names.reserve(slices.size());
  for (const auto& [number, name] : slices) names.push_back(name);
  return names;
}

}  // namespace

ImportedScenes ImportCmu(const path& folder, const ImportOptions& options) {
  SceneOfFolder(folder);
  const std::vector<std::string> slices = ListSlices(folder);
  if (slices.empty()) return {ImportSlice(folder, options)};
  ImportedScenes scenes;
  for (const std::string& slice : slices) {
    scenes.push_back(ImportSlice(folder / slice, options));
    scenes.back().folder = slice;
  }
  return scenes;
}

}  // namespace raylift
