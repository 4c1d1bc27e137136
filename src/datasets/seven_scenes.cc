#include <map>
#include <string>

#include "datasets/importers.h"
#include "io/text/line_tokens.h"
#include "scene/seven_scenes_kinect.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/scene/image.h"

namespace raylift {
namespace {

using std::filesystem::path;

// Reads the SfM poses of 7-Scenes and 12 Scenes by Brachmann et al. (ICCV 2021, "On the limits of
// pseudo ground truth", folder pgt): SCENE_train.txt and SCENE_test.txt with rows `name qw qx qy qz
// tx ty tz f`, world to camera, f the photograph's focal length.
class PseudoGroundTruth {
 public:
  // `scene` is the scene's folder: pgt/sfm/7scenes holds chess_train.txt, pgt/sfm/12scenes
  // apt1_kitchen_train.txt for apt1/kitchen.
  PseudoGroundTruth(const path& pgt, const path& scene) {
    const path folder = std::filesystem::canonical(scene);
    const std::string room = folder.filename().string();
    const std::string place = folder.parent_path().filename().string();
    for (const std::string& name : {room, place + "_" + room}) {
      file_ = pgt / (name + "_train.txt");
      if (!std::filesystem::exists(file_)) continue;
      Read(file_);
      Read(pgt / (name + "_test.txt"));
      return;
    }
    throw InputError(
        pgt, fmt::format("expected {0}_train.txt and {0}_test.txt, or {1}_{0}_...", room, place));
  }

  // Returns the pose, and the camera with this focal length and its axis in the middle of the
  // photograph, which was published in one size and is here in that of `fitted`; nullopt where the
  // files lack it.
  std::optional<PosedImage> Find(const std::string& name, const PlaneSize& published,
                                 const Camera& fitted) const {
    const auto row = rows_.find(name);
    if (row == rows_.end()) return std::nullopt;
    const std::vector<double> params = {row->second.focal_px, 0.5 * published.width_px,
                                        0.5 * published.height_px};
    const Camera camera(CameraModel::kSimplePinhole, published.width_px, published.height_px,
                        params);
    return PosedImage{name, camera.Scaled(fitted.width_px(), fitted.height_px()),
                      row->second.cam_from_world};
  }

  const path& file() const { return file_; }

 private:
  struct Row {
    Rigid3 cam_from_world;
    double focal_px;
  };

  void Read(const path& file) {
    LineReader lines(file);
    while (const auto line = lines.NextContent()) {
      LineTokens tokens(lines, *line);
      const std::string name(tokens.Token("name"));
      const auto rotation = UnitQuaternion(tokens.Quaternion("quaternion"));
      if (!rotation) tokens.Fail("quaternion: expected one of length 1");
      const Eigen::Vector3d translation = tokens.Vector<3>("translation");
      const double focal_px = tokens.Double("focal length");
      if (!(focal_px > 0)) tokens.Fail("focal length: expected a positive number");
      tokens.ExpectEnd();
      if (!rows_.emplace(name, Row{{*rotation, translation}, focal_px}).second) {
        tokens.Fail(fmt::format("{} stands twice", name));
      }
    }
  }

  path file_;  // that of the references
  std::map<std::string, Row> rows_;
};

// Reads the folders of sequences: "sequence1" is the folder seq-01.
std::vector<std::string> ReadSequences(const path& file) {
  std::vector<std::string> sequences;
  LineReader lines(file);
  while (const auto line = lines.NextContent()) {
    const size_t digits = line->find_first_of("0123456789");
    const auto number =
        digits == std::string_view::npos ? std::nullopt : ParseUint(Trim(line->substr(digits)));
    if (!number) {
      lines.Fail(fmt::format("expected a sequence such as \"sequence1\", found \"{}\"", *line));
    }
    sequences.push_back(fmt::format("seq-{:02}", *number));
  }
  return sequences;
}

// Reads the poses and cameras of the photographs, by one of three readings of the data set.
class SevenScenesReader {
 public:
  SevenScenesReader(const path& folder, const ImportOptions& options)
      : folder_(folder), options_(options), camera_(options) {
    if (!options.pseudo_ground_truth.empty()) pgt_.emplace(options.pseudo_ground_truth, folder);
  }

  std::vector<PosedImage> ReadFrames(const std::string& sequence, Skipped& skipped) {
    std::vector<PosedImage> frames;
    const std::string suffix = ".pose.txt";
    for (const std::string& file : ListFiles(folder_ / sequence, suffix)) {
      const std::string stem = file.substr(0, file.size() - suffix.size());
      const std::string name = fmt::format("{}/{}.color.png", sequence, stem);
      const auto world_from_depth = ReadWorldFromCam(folder_ / sequence / file);
      if (!world_from_depth) {
        skipped.Add("the pose is not finite", name);
        continue;
      }
      if (!skipped.HasPhotograph(folder_, name)) continue;
      if (const auto frame = MakeFrame(name, world_from_depth->Inverse())) {
        frames.push_back(*frame);
      } else {
        skipped.Add(pgt_->file().string() + " and its test lack it", name);
      }
    }
    return frames;
  }

  void AddWarning(ImportedScene& scene) const {
    if (2 * num_equal_ <= scene.references.size()) return;
    scene.warnings.push_back(
        pgt_->file().string() +
        " holds the data set's own poses, of the depth camera (as those in pgt/dslam): the "
        "photographs' are some 26 mm and 0.67 degrees elsewhere");
  }

  std::string Note() const {
    if (pgt_) return "poses and focal lengths are those of " + pgt_->file().string();
    if (options_.calibration == SensorCalibration::kRaw) {
      return "the poses are those of the depth camera, as hloc and DSAC* take them: the "
             "photographs' are some 26 mm and 0.67 degrees elsewhere (the calibration color moves "
             "the poses there)";
    }
    return "the poses were moved from the depth camera, for which they are published, to the "
           "color camera, as kapture and ACE do: some 26 mm and 0.67 degrees; the calibration "
           "raw leaves them, as hloc and DSAC* do";
  }

 private:
  std::optional<PosedImage> MakeFrame(const std::string& name, const Rigid3& depth_from_world) {
    // The camera is the published one; what lens and registration leave is unknown, and everyone
    // uses this.
    const Camera& camera =
        camera_.Get([&] { return FitToPhotograph(SevenScenesColorCamera(), folder_ / name); });
    if (pgt_) {
      auto frame = pgt_->Find(name, {640, 480}, camera);
      if (frame && IsSame(frame->cam_from_world, depth_from_world)) ++num_equal_;
      if (frame && options_.camera) frame->camera = camera;
      return frame;
    }
    if (options_.calibration == SensorCalibration::kRaw) {
      return PosedImage{name, camera, depth_from_world};
    }
    return PosedImage{name, camera, SevenScenesColorFromDepth() * depth_from_world};
  }

  // Returns whether the poses are the same but for the rounding of text files.
  static bool IsSame(const Rigid3& a, const Rigid3& b) {
    constexpr double kRounding = 1e-3;
    return (a.OriginInSource() - b.OriginInSource()).norm() < kRounding &&
           a.rotation.angularDistance(b.rotation) < kRounding;
  }

  path folder_;
  const ImportOptions& options_;
  SharedCamera camera_;
  std::optional<PseudoGroundTruth> pgt_;
  size_t num_equal_ = 0;
};

}  // namespace

ImportedScenes Import7Scenes(const path& folder, const ImportOptions& options) {
  ImportedScene scene = SceneOfFolder(folder);
  SevenScenesReader reader(folder, options);
  Skipped skipped;
  for (const std::string& sequence : ReadSequences(folder / "TrainSplit.txt")) {
    for (PosedImage& frame : reader.ReadFrames(sequence, skipped)) {
      scene.references.push_back(std::move(frame));
    }
  }
  for (const std::string& sequence : ReadSequences(folder / "TestSplit.txt")) {
    for (const PosedImage& frame : reader.ReadFrames(sequence, skipped)) {
      AddQuery(frame, scene);
      scene.groups.emplace(frame.name, sequence);
    }
  }
  skipped.AddWarnings(scene.warnings);
  reader.AddWarning(scene);
  RequireImages(folder, scene);
  scene.thresholds = "7scenes";
  scene.geometries = {{"sensor", "depth:" + folder.string() + ",preset=7scenes_sensor"}};
  scene.notes.push_back(reader.Note());
  scene.notes.emplace_back(
      "the sensor's depth (f 585) is registered into the photographs (f 525) by a calibration of "
      "another Kinect: a mesh or depth rendered for the photographs is more exact");
  return {std::move(scene)};
}

// 12 Scenes (Valentin et al., 3DV 2016): PLACE/ROOM/{info.txt,split.txt} and
// data/frame-XXXXXX.{color.jpg,depth.png,pose.txt}; the first sequence of split.txt is the test.

namespace {

constexpr PlaneSize kPublishedSize = {1296, 968};

// Returns the number of frames of the first sequence:
// "sequence0 [frames=357]  [start=0 ; end=356]".
uint64_t ReadNumTestFrames(const path& file) {
  LineReader lines(file);
  const auto line = lines.NextContent();
  if (!line) lines.Fail("expected the sequences, found nothing");
  constexpr std::string_view kKey = "frames=";
  const size_t begin = line->find(kKey);
  if (begin == std::string_view::npos) lines.Fail("expected \"frames=N\"");
  const std::string_view rest = line->substr(begin + kKey.size());
  return lines.Uint(rest.substr(0, rest.find_first_not_of("0123456789")), "frames");
}

}  // namespace

ImportedScenes Import12Scenes(const path& folder, const ImportOptions& options) {
  ImportedScene scene = SceneOfFolder(folder);
  const uint64_t num_test_frames = ReadNumTestFrames(folder / "split.txt");
  std::optional<PseudoGroundTruth> pgt;
  if (!options.pseudo_ground_truth.empty()) pgt.emplace(options.pseudo_ground_truth, folder);
  SharedCamera camera(options);
  const std::string prefix = "frame-", suffix = ".pose.txt";
  Skipped skipped;
  for (const std::string& file : ListFiles(folder / "data", suffix)) {
    const std::string stem = file.substr(0, file.size() - suffix.size());
    const auto number = stem.starts_with(prefix) ? ParseUint(stem.substr(prefix.size()))
                                                 : std::optional<uint64_t>();
    if (!number) throw InputError(folder / "data" / file, "expected a name such as frame-000000");
    // The published poses of others have the folder in their names, too.
    const std::string name = "data/" + stem + ".color.jpg";
    const auto world_from_cam = ReadWorldFromCam(folder / "data" / file);
    if (!world_from_cam && !pgt) {
      skipped.Add("the pose is not finite", name);
      continue;
    }
    if (!skipped.HasPhotograph(folder, name)) continue;
    const Camera& fitted = camera.Get(
        [&] { return FitToPhotograph(ReadColorCamera(folder / "info.txt"), folder / name); });
    auto frame = pgt ? pgt->Find(name, kPublishedSize, fitted)
                     : std::optional(PosedImage{name, fitted, world_from_cam->Inverse()});
    if (!frame) {
      skipped.Add(pgt->file().string() + " and its test lack it", name);
      continue;
    }
    if (options.camera) frame->camera = fitted;
    if (*number < num_test_frames) {
      AddQuery(*frame, scene);
    } else {
      scene.references.push_back(*frame);
    }
  }
  skipped.AddWarnings(scene.warnings);
  RequireImages(folder, scene);
  scene.thresholds = "12scenes";
  scene.geometries = {{"sensor", "depth:" + folder.string() + ",preset=12scenes"}};
  if (pgt) scene.notes.push_back("poses and focal lengths are those of " + pgt->file().string());
  return {std::move(scene)};
}

}  // namespace raylift
