// nerfstudio and instant-ngp: transforms.json with camera-to-world matrices of cameras in OpenGL's
// axes (x right, y up, z back), intrinsics for all frames or per frame. The scene is in the world
// that the images were in before nerfstudio's `applied_transform` and `applied_scale`.

#include <algorithm>
#include <cmath>
#include <set>

#include "datasets/importers.h"
#include "io/text/json_document.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/io/depth_file.h"
#include "raylift/io/image_file.h"

namespace raylift {
namespace {

using std::filesystem::path;

// nerfstudio reads depth maps of every kind with its depth_unit_scale_factor.
constexpr double kDepthUnit = 1e-3;

struct Frame {
  PosedImage image;
  std::string depth;  // the name in the file; empty: there is none
};

// The change that was made to the world: q = scale * (transform * p).
struct AppliedTransform {
  Rigid3 transform;
  double scale = 1;

  Rigid3 Undo(const Rigid3& world_from_cam) const {
    Rigid3 unscaled = world_from_cam;
    unscaled.translation /= scale;
    return transform.Inverse() * unscaled;
  }
};

// Reads the rows of a matrix; the last one may be left out. An element that is no number (null, as
// written for infinity) makes all of it not finite.
Eigen::Matrix4d ReadRows(const JsonPlace& place) {
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
  const size_t num_rows = place.ArraySize();
  if (num_rows != 3 && num_rows != 4) place.Fail("expected 3 or 4 rows");
  for (size_t r = 0; r < num_rows; ++r) {
    const JsonPlace row = place.At(r);
    row.ExpectArraySize(4);
    for (size_t c = 0; c < 4; ++c) {
      const JsonPlace element = row.At(c);
      matrix(static_cast<Eigen::Index>(r), static_cast<Eigen::Index>(c)) =
          element.IsNull() ? std::nan("") : element.Number();
    }
  }
  return matrix;
}

// The photographs of a file. Their names are relative to the file's folder, but for those that lead
// out of it ("../images/a.jpg"): then to a folder above.
class Photographs {
 public:
  Photographs(const path& folder, const JsonPlace& frames) : folder_(folder), root_(folder) {
    int max_ups = 0;
    for (size_t i = 0; i < frames.ArraySize(); ++i) {
      const JsonPlace frame = frames.At(i);
      const JsonPlace file_path = frame.Member("file_path");
      const path name = Normal(file_path.String());
      if (!name.is_absolute() && Existing(name)) {
        max_ups = std::max(max_ups, static_cast<int>(std::count(name.begin(), name.end(), "..")));
      }
    }
    if (max_ups == 0) return;
    root_ = std::filesystem::canonical(folder);
    for (int i = 0; i < max_ups; ++i) root_ = root_.parent_path();
    prefix_ = std::filesystem::canonical(folder).lexically_relative(root_);
  }

  // Returns the folder that names are relative to.
  const path& root() const { return root_; }

  // Returns the photograph that a file_path means. Where there is none in its place, the ends of
  // the path are tried: files come with names relative to some other folder, or of another
  // computer.
  std::optional<std::string> Find(const std::string& file_path) {
    const path name = Normal(file_path);
    if (const auto file = name.is_absolute() ? std::nullopt : Existing(name)) return NameOf(*file);
    for (path end = WithoutFirst(name); !end.empty(); end = WithoutFirst(end)) {
      const auto file = Existing(end);
      if (!file) continue;
      moved_.emplace(NameOf(*file), file_path);
      return NameOf(*file);
    }
    return std::nullopt;
  }

  void AddWarning(std::vector<std::string>& warnings) const {
    if (moved_.empty()) return;
    warnings.push_back(
        fmt::format("{} photographs were found in another place than the file says: {} as {}",
                    moved_.size(), moved_.begin()->second, moved_.begin()->first));
  }

 private:
  static path Normal(std::string file_path) {
    std::replace(file_path.begin(), file_path.end(), '\\', '/');
    return path(file_path).lexically_normal();
  }

  static path WithoutFirst(const path& name) {
    path rest;
    bool is_first = true;
    for (const path& part : name.relative_path()) {
      if (!is_first) rest /= part;
      is_first = false;
    }
    return rest;
  }

  // Returns the file that exists: "images/1" of the Blender scenes is images/1.png; instant-ngp
  // tries other formats, too.
  std::optional<path> Existing(const path& name) const {
    for (const char* extension : {"", ".png", ".jpg", ".jpeg", ".bmp", ".tga", ".exr"}) {
      path with_extension = name;
      with_extension += extension;
      if (IsFile(folder_ / with_extension)) {
        return with_extension;
      }
    }
    return std::nullopt;
  }

  std::string NameOf(const path& file) const {
    return (prefix_ / file).lexically_normal().generic_string();
  }

  path folder_, root_, prefix_;
  std::map<std::string, std::string> moved_;  // by name: what the file says
};

class NerfstudioReader {
 public:
  enum class Missing { kSkip, kKeep };  // frames without a photograph

  NerfstudioReader(const path& file, const ImportOptions& options, Missing missing = Missing::kSkip)
      : file_(file),
        folder_(file.has_parent_path() ? file.parent_path() : path(".")),
        document_(ReadFile(file), file),
        root_(document_.Root()),
        list_(root_.Member("frames")),
        photographs_(folder_, list_),
        options_(options),
        missing_(missing) {
    if (root_.Has("applied_transform")) {
      const JsonPlace place = root_.Member("applied_transform");
      const auto transform = RigidFromMatrix(ReadRows(place));
      if (!transform) place.Fail("expected a rotation and a translation");
      applied_.transform = *transform;
    } else if (std::filesystem::exists(folder_ / "colmap" / "sparse" / "0")) {
      // ns-process-data did this before it wrote so (nerfstudio_dataparser.py).
      Eigen::Matrix3d exchanged;
      exchanged << 0, 1, 0, 1, 0, 0, 0, 0, -1;
      applied_.transform.rotation = Eigen::Quaterniond(exchanged);
      notes_.push_back(
          "there is no applied_transform, but colmap/sparse/0: x and y are exchanged and z is "
          "turned over, as nerfstudio takes it, so that the scene is in COLMAP's world");
    }
    if (root_.Has("applied_scale")) {
      const JsonPlace place = root_.Member("applied_scale");
      applied_.scale = place.Number();
      if (!(applied_.scale > 0)) place.Fail("expected a positive number");
    }
  }

  std::vector<Frame> Frames(Skipped& skipped) {
    std::vector<Frame> frames;
    for (size_t i = 0; i < list_.ArraySize(); ++i) {
      const JsonPlace place = list_.At(i);
      if (auto frame = ReadFrame(place, skipped)) frames.push_back(std::move(*frame));
    }
    // This is nerfstudio's own order.
    std::sort(frames.begin(), frames.end(),
              [](const Frame& a, const Frame& b) { return a.image.name < b.image.name; });
    for (size_t i = 1; i < frames.size(); ++i) {
      if (frames[i].image.name == frames[i - 1].image.name) {
        throw InputError(file_, "frames", fmt::format("\"{}\" stands twice", frames[i].image.name));
      }
    }
    return frames;
  }

  // Returns the names of a split; nullopt where the file has no such list.
  std::optional<std::set<std::string>> Names(std::string_view key) {
    if (!root_.Has(key)) return std::nullopt;
    std::set<std::string> names;
    const JsonPlace list = root_.Member(key);
    for (size_t i = 0; i < list.ArraySize(); ++i) {
      const JsonPlace place = list.At(i);
      if (const auto name = photographs_.Find(place.String())) names.insert(*name);
    }
    return names;
  }

  const path& folder() const { return folder_; }
  const Photographs& photographs() const { return photographs_; }
  double applied_scale() const { return applied_.scale; }
  const std::vector<std::string>& notes() const { return notes_; }

 private:
  std::optional<Frame> ReadFrame(const JsonPlace& place, Skipped& skipped) {
    const JsonPlace file_path = place.Member("file_path");
    const auto found = photographs_.Find(file_path.String());
    const std::string name =
        found.value_or(path(file_path.String()).lexically_normal().generic_string());
    const JsonPlace matrix_place = place.Member("transform_matrix");
    const Eigen::Matrix4d matrix = ReadRows(matrix_place);
    if (!matrix.allFinite()) {
      skipped.Add("the pose is not finite", name);
      return std::nullopt;
    }
    const auto world_from_opengl = RigidFromMatrix(matrix);
    if (!world_from_opengl) matrix_place.Fail("expected a rotation and a translation");
    if (!found && missing_ == Missing::kSkip) {
      skipped.Add("the photograph is missing below " + folder_.string(), name);
      return std::nullopt;
    }
    Frame frame{
        {name, ReadCamera(place, name),
         CamFromWorld(applied_.Undo(*world_from_opengl), PoseConvention::kWorldFromOpenGlCamera)},
        ""};
    if (place.Has("depth_file_path")) {
      const JsonPlace depth = place.Member("depth_file_path");
      frame.depth = path(depth.String()).lexically_normal().generic_string();
    }
    return frame;
  }

  Camera ReadCamera(const JsonPlace& frame, const std::string& name) const {
    if (options_.camera) return *options_.camera;
    return CameraOfTransforms(frame, root_,
                              [&] { return ReadImageSize(photographs_.root() / name); });
  }

  path file_, folder_;
  JsonDocument document_;
  JsonPlace root_, list_;
  Photographs photographs_;
  const ImportOptions& options_;
  Missing missing_;
  AppliedTransform applied_;
  std::vector<std::string> notes_;
};

// Warns of depth in floats, which may as well be in the unit of the poses: the import cannot know.
void WarnOfFloats(const path& file, ImportedScene& scene) {
  const StoredDepth stored = ReadDepthFile(file);
  if (!stored.sample_type.starts_with("float")) return;
  const auto first = std::find_if(stored.values.begin(), stored.values.end(),
                                  [](float value) { return value > 0 && std::isfinite(value); });
  scene.warnings.push_back(fmt::format(
      "the depth maps hold floats ({}: {}), taken as thousandths of the poses' unit as nerfstudio "
      "does (depth_unit_scale_factor): where they are not, correct unit in scene.toml",
      file.filename().string(), first == stored.values.end() ? 0 : *first));
}

// Takes the depth maps of all frames, if they are called after the photographs.
void TakeDepth(const NerfstudioReader& reader, const std::vector<Frame>& frames,
               ImportedScene& scene) {
  const auto with_depth =
      std::find_if(frames.begin(), frames.end(), [](const Frame& f) { return !f.depth.empty(); });
  if (with_depth == frames.end()) return;
  const path first = with_depth->depth;
  const auto expected = [&first](const Frame& frame) {
    return (first.parent_path() / path(frame.image.name).stem()).generic_string() +
           first.extension().string();
  };
  for (const Frame& frame : frames) {
    if (!frame.depth.empty() && frame.depth != expected(frame)) {
      scene.warnings.push_back(
          fmt::format("depth maps are not used: \"{}\" is not called after \"{}\"", frame.depth,
                      frame.image.name));
      return;
    }
  }
  if (!Exists(reader.folder() / first)) {
    scene.warnings.push_back(
        fmt::format("depth maps are not used: \"{}\" is missing", first.generic_string()));
    return;
  }
  WarnOfFloats(reader.folder() / first, scene);
  const std::string pattern =
      (first.parent_path() / "{stem}").generic_string() + first.extension().string();
  scene.geometries.push_back(
      {"depth", fmt::format("depth:{},pattern={},unit={}", reader.folder().string(), pattern,
                            FormatDouble(kDepthUnit / reader.applied_scale()))});
}

std::vector<PosedImage> ImagesOf(const std::vector<Frame>& frames) {
  std::vector<PosedImage> images;
  images.reserve(frames.size());
  for (const Frame& frame : frames) images.push_back(frame.image);
  return images;
}

ImportedScene SceneOf(const NerfstudioReader& reader) {
  ImportedScene scene = SceneOfFolder(reader.folder());
  scene.images = scene.query_images = reader.photographs().root();
  scene.notes = reader.notes();
  return scene;
}

ImportedScene ImportFile(const path& file, const ImportOptions& options) {
  NerfstudioReader reader(file, options);
  ImportedScene scene = SceneOf(reader);
  Skipped skipped;
  const std::vector<Frame> frames = reader.Frames(skipped);
  skipped.AddWarnings(scene.warnings);
  reader.photographs().AddWarning(scene.warnings);
  TakeDepth(reader, frames, scene);
  const std::vector<PosedImage> images = ImagesOf(frames);
  auto tests = reader.Names("test_filenames");
  if (!tests || tests->empty()) tests = reader.Names("val_filenames");
  if (tests && !tests->empty()) {
    for (const PosedImage& image : images) {
      if (tests->contains(image.name)) {
        AddQuery(image, scene);
      } else {
        scene.references.push_back(image);
      }
    }
  } else {
    SplitFrames(images, options.query_every, file, scene);
  }
  RequireImages(file, scene);
  return scene;
}

// Imports a file per split, as of the Blender scenes of NeRF.
ImportedScene ImportSplitFiles(const path& folder, const path& queries,
                               const ImportOptions& options) {
  NerfstudioReader train(folder / "transforms_train.json", options), test(queries, options);
  ImportedScene scene = SceneOf(train);
  scene.query_images = test.photographs().root();
  Skipped skipped;
  const std::vector<Frame> frames = train.Frames(skipped);
  scene.references = ImagesOf(frames);
  for (const PosedImage& image : ImagesOf(test.Frames(skipped))) AddQuery(image, scene);
  skipped.AddWarnings(scene.warnings);
  train.photographs().AddWarning(scene.warnings);
  test.photographs().AddWarning(scene.warnings);
  TakeDepth(train, frames, scene);
  scene.notes.push_back(fmt::format("references are transforms_train.json's, queries {}'s",
                                    queries.filename().string()));
  RequireImages(folder, scene);
  return scene;
}

}  // namespace

std::vector<PosedImage> ReadTransforms(const path& file, std::vector<std::string>& warnings) {
  const ImportOptions options;
  NerfstudioReader reader(file, options, NerfstudioReader::Missing::kKeep);
  Skipped skipped;
  std::vector<PosedImage> images = ImagesOf(reader.Frames(skipped));
  skipped.AddWarnings(warnings);
  reader.photographs().AddWarning(warnings);
  warnings.insert(warnings.end(), reader.notes().begin(), reader.notes().end());
  return images;
}

ImportedScenes ImportNerfstudio(const path& folder, const ImportOptions& options) {
  if (std::filesystem::is_regular_file(folder)) return {ImportFile(folder, options)};
  if (!std::filesystem::exists(folder / "transforms.json") &&
      std::filesystem::exists(folder / "transforms_train.json")) {
    for (const char* name : {"transforms_test.json", "transforms_val.json"}) {
      if (std::filesystem::exists(folder / name)) {
        return {ImportSplitFiles(folder, folder / name, options)};
      }
    }
    return {ImportFile(folder / "transforms_train.json", options)};
  }
  return {ImportFile(folder / "transforms.json", options)};
}

}  // namespace raylift
