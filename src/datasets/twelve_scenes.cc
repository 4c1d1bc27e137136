// 12 Scenes (Valentin et al., 3DV 2016): PLACE/ROOM/{info.txt,split.txt} and
// data/frame-XXXXXX.{color.jpg,depth.png,pose.txt}; the first sequence of split.txt is the test.

#include "datasets/importers.h"
#include "datasets/pseudo_ground_truth.h"
#include "datasets/sensor_info.h"
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

using std::filesystem::path;

constexpr PlaneSize kPublishedSize = {1296, 968};

// The number of frames of the first sequence: "sequence0 [frames=357]  [start=0 ; end=356]".
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
    if (!Exists(folder / name)) {
      skipped.Add("the photograph is missing", name);
      continue;
    }
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
