// 7-Scenes (Shotton et al., CVPR 2013): one folder per scene, seq-XX/frame-XXXXXX.{color.png,
// depth.png,pose.txt}, camera-to-world matrices, TrainSplit.txt and TestSplit.txt.

#include "datasets/importers.h"
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

using std::filesystem::path;

// As published; what lens and registration leave is unknown, and everyone uses this.
Camera NominalCamera() {
  return Camera(CameraModel::kSimplePinhole, 640, 480, std::vector<double>{525, 320, 240});
}

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

std::vector<PosedImage> ReadFrames(const path& folder, const std::string& sequence,
                                   const ImportOptions& options, Skipped& skipped) {
  std::vector<PosedImage> frames;
  SharedCamera camera(options);
  const std::string suffix = ".pose.txt";
  for (const std::string& file : ListFiles(folder / sequence, suffix)) {
    const std::string stem = file.substr(0, file.size() - suffix.size());
    const std::string name = fmt::format("{}/{}.color.png", sequence, stem);
    const auto world_from_cam = ReadWorldFromCam(folder / sequence / file);
    if (!world_from_cam) {
      skipped.Add("the pose is not finite", name);
      continue;
    }
    if (!std::filesystem::exists(folder / name)) {
      skipped.Add("the photograph is missing", name);
      continue;
    }
    const Camera& fitted =
        camera.Get([&] { return FitToPhotograph(NominalCamera(), folder / name); });
    frames.push_back({name, fitted, world_from_cam->Inverse()});
  }
  return frames;
}

}  // namespace

ImportedScenes Import7Scenes(const path& folder, const ImportOptions& options) {
  ImportedScene scene = SceneOfFolder(folder);
  Skipped skipped;
  for (const std::string& sequence : ReadSequences(folder / "TrainSplit.txt")) {
    for (PosedImage& frame : ReadFrames(folder, sequence, options, skipped)) {
      scene.references.push_back(std::move(frame));
    }
  }
  for (const std::string& sequence : ReadSequences(folder / "TestSplit.txt")) {
    for (const PosedImage& frame : ReadFrames(folder, sequence, options, skipped)) {
      AddQuery(frame, scene);
      scene.groups.emplace(frame.name, sequence);
    }
  }
  skipped.AddWarnings(scene.warnings);
  RequireImages(folder, scene);
  scene.thresholds = "7scenes";
  scene.geometries = {{"sensor", "depth:" + folder.string() + ",preset=7scenes"}};
  scene.notes.emplace_back(
      "the sensor's depth is of the depth camera (f 585), not registered to the photographs "
      "(f 525): a mesh or depth rendered for the photographs is more exact");
  return {std::move(scene)};
}

}  // namespace raylift
