// 7-Scenes (Shotton et al., CVPR 2013): one folder per scene, seq-XX/frame-XXXXXX.{color.png,
// depth.png,pose.txt}, camera-to-world matrices, TrainSplit.txt and TestSplit.txt. The poses are
// KinectFusion's, which tracks the depth camera.

#include "datasets/importers.h"
#include "datasets/pseudo_ground_truth.h"
#include "scene/seven_scenes_kinect.h"
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

using std::filesystem::path;

// "sequence1" is the folder seq-01.
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

// The poses and cameras of the photographs, by one of three readings of the data set.
class Reader {
 public:
  Reader(const path& folder, const ImportOptions& options)
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
      if (!Exists(folder_ / name)) {
        skipped.Add("the photograph is missing", name);
        continue;
      }
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
             "photographs' are some 26 mm and 0.67 degrees elsewhere (--calibration color)";
    }
    return "the poses were moved from the depth camera, for which they are published, to the "
           "color camera, as kapture and ACE do: some 26 mm and 0.67 degrees; --calibration raw "
           "leaves them, as hloc and DSAC* do";
  }

 private:
  std::optional<PosedImage> MakeFrame(const std::string& name, const Rigid3& depth_from_world) {
    // As published; what lens and registration leave is unknown, and everyone uses this.
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

  // The same but for the rounding of text files.
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
  Reader reader(folder, options);
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

}  // namespace raylift
