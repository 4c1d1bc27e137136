// 12 Scenes (Valentin et al., 3DV 2016): PLACE/ROOM/{info.txt,split.txt} and
// data/frame-XXXXXX.{color.jpg,depth.png,pose.txt}; the first sequence of split.txt is the test.

#include <cmath>

#include "datasets/importers.h"
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

using std::filesystem::path;

// Lines "key = value".
class Info {
 public:
  explicit Info(const path& file) : file_(file) {
    LineReader lines(file);
    while (const auto line = lines.NextContent()) {
      const size_t equals = line->find('=');
      if (equals == std::string_view::npos) continue;
      values_[std::string(Trim(line->substr(0, equals)))] = Trim(line->substr(equals + 1));
    }
  }

  // The numbers of a value; at least `count`.
  std::vector<double> Numbers(const std::string& key, size_t count) const {
    const auto value = values_.find(key);
    if (value == values_.end()) throw InputError(file_, key, "the value is missing");
    std::vector<double> numbers;
    for (const std::string_view token : SplitTokens(value->second)) {
      const auto number = ParseDouble(token);
      if (!number || !std::isfinite(*number)) {
        throw InputError(file_, key, fmt::format("expected numbers, found \"{}\"", token));
      }
      numbers.push_back(*number);
    }
    if (numbers.size() < count) {
      throw InputError(file_, key,
                       fmt::format("expected {} numbers, found {}", count, numbers.size()));
    }
    return numbers;
  }

  int Side(const std::string& key) const {
    const double side = Numbers(key, 1)[0];
    if (!(side >= 1 && side <= 1 << 20)) throw InputError(file_, key, "expected a size in pixels");
    return static_cast<int>(side);
  }

 private:
  path file_;
  std::map<std::string, std::string> values_;
};

Camera ReadCamera(const path& file) {
  const Info info(file);
  const std::vector<double> k = info.Numbers("m_calibrationColorIntrinsic", 7);  // rows of four
  const int width_px = info.Side("m_colorWidth"), height_px = info.Side("m_colorHeight");
  try {
    return Camera(CameraModel::kPinhole, width_px, height_px,
                  std::vector<double>{k[0], k[5], k[2], k[6]});
  } catch (const InputError& error) {
    throw InputError(file, "m_calibrationColorIntrinsic", error.what());
  }
}

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
  scene.images = scene.query_images = folder / "data";
  const uint64_t num_test_frames = ReadNumTestFrames(folder / "split.txt");
  SharedCamera camera(options);
  const std::string prefix = "frame-", suffix = ".pose.txt";
  Skipped skipped;
  for (const std::string& file : ListFiles(scene.images, suffix)) {
    const std::string stem = file.substr(0, file.size() - suffix.size());
    const auto number = stem.starts_with(prefix) ? ParseUint(stem.substr(prefix.size()))
                                                 : std::optional<uint64_t>();
    if (!number) throw InputError(scene.images / file, "expected a name such as frame-000000");
    const std::string name = stem + ".color.jpg";
    const auto world_from_cam = ReadWorldFromCam(scene.images / file);
    if (!world_from_cam) {
      skipped.Add("the pose is not finite", name);
      continue;
    }
    if (!std::filesystem::exists(scene.images / name)) {
      skipped.Add("the photograph is missing", name);
      continue;
    }
    const Camera& fitted = camera.Get(
        [&] { return FitToPhotograph(ReadCamera(folder / "info.txt"), scene.images / name); });
    const PosedImage frame{name, fitted, world_from_cam->Inverse()};
    if (*number < num_test_frames) {
      AddQuery(frame, scene);
    } else {
      scene.references.push_back(frame);
    }
  }
  skipped.AddWarnings(scene.warnings);
  RequireImages(folder, scene);
  scene.thresholds = "12scenes";
  scene.geometries = {{"sensor", "depth:" + scene.images.string() + ",preset=12scenes"}};
  return {std::move(scene)};
}

}  // namespace raylift
