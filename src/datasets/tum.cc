// TUM RGB-D (Sturm et al., IROS 2012): rgb.txt (`seconds file`) and groundtruth.txt (`seconds tx ty
// tz qx qy qz qw`, camera to world, the quaternion with w last), taken at times of their own.

#include <cmath>
#include <iterator>

#include "datasets/importers.h"
#include "io/text/line_tokens.h"
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

using std::filesystem::path;

// Poses farther apart than this are not interpolated: the motion capture lost the camera.
constexpr double kMaxGapS = 0.1;
// Where there is but one side, as at the ends, a pose counts for this long.
constexpr double kMaxDifferenceS = 0.02;

// Makes a camera by a calibration that the authors publish (OpenCV's convention: k1 k2 p1 p2 k3).
// Pixel centers are at whole numbers there.
Camera MakeCamera(double fx, double fy, double cx, double cy, const std::vector<double>& lens) {
  std::vector<double> params = {fx, fy, cx + 0.5, cy + 0.5};
  if (lens.empty()) return Camera(CameraModel::kPinhole, 640, 480, params);
  params.insert(params.end(), lens.begin(), lens.end());
  params.insert(params.end(), {0, 0, 0});  // k4 to k6
  return Camera(CameraModel::kFullOpenCv, 640, 480, params);
}

// Returns the camera by the folder's name, which says which of the authors' it was; a Kinect's,
// with a warning, where it does not.
Camera CameraOfFolder(const std::string& name, std::vector<std::string>& warnings) {
  if (name.find("freiburg1") != std::string::npos) {
    return MakeCamera(517.306408, 516.469215, 318.643040, 255.313989,
                      {0.262383, -0.953104, -0.005358, 0.002628, 1.163314});
  }
  if (name.find("freiburg2") != std::string::npos) {
    return MakeCamera(520.908620, 521.007327, 325.141442, 249.701764,
                      {0.231222, -0.784899, -0.003257, -0.000105, 0.917205});
  }
  if (name.find("freiburg3") != std::string::npos) {
    return MakeCamera(535.433105, 539.212524, 320.106653, 247.632132, {});
  }
  warnings.push_back(
      "the folder's name holds none of freiburg1, freiburg2, freiburg3: the camera is taken to be "
      "a Kinect as its driver describes it (f = 525) where none is given");
  return MakeCamera(525.0, 525.0, 319.5, 239.5, {});
}

using PosesByTime = std::map<double, Rigid3>;

PosesByTime ReadPoses(const path& file) {
  PosesByTime poses;
  LineReader lines(file);
  while (const auto line = lines.NextContent()) {
    const auto tokens = SplitTokens(*line);
    if (tokens.size() != 8) {
      lines.Fail(fmt::format("expected time, 3 and 4 numbers, found {} tokens", tokens.size()));
    }
    Eigen::Matrix<double, 8, 1> numbers;
    for (int i = 0; i < 8; ++i) {
      const auto number = ParseDouble(tokens[static_cast<size_t>(i)]);
      if (!number) {
        lines.Fail(fmt::format("expected a number, found \"{}\"", tokens[static_cast<size_t>(i)]));
      }
      numbers[i] = *number;
    }
    if (!numbers.allFinite()) continue;
    const auto rotation = UnitQuaternion({numbers[7], numbers[4], numbers[5], numbers[6]});
    if (!rotation) lines.Fail("expected a quaternion of length 1 (qx qy qz qw)");
    poses[numbers[0]] = {*rotation, numbers.segment<3>(1)};
  }
  return poses;
}

std::optional<Rigid3> PoseAt(const PosesByTime& poses, double seconds) {
  const auto after = poses.lower_bound(seconds);
  if (after != poses.end() && after->first == seconds) return after->second;
  if (after == poses.end() || after == poses.begin()) {
    if (poses.empty()) return std::nullopt;
    const auto nearest = after == poses.end() ? std::prev(after) : after;
    if (std::abs(nearest->first - seconds) > kMaxDifferenceS) return std::nullopt;
    return nearest->second;
  }
  const auto before = std::prev(after);
  const double gap = after->first - before->first;
  if (gap > kMaxGapS) return std::nullopt;
  const double share = (seconds - before->first) / gap;
  const Rigid3 &a = before->second, &b = after->second;
  return Rigid3{a.rotation.slerp(share, b.rotation),
                (1 - share) * a.translation + share * b.translation};
}

}  // namespace

ImportedScenes ImportTum(const path& folder, const ImportOptions& options) {
  ImportedScene scene = SceneOfFolder(folder);
  const PosesByTime world_from_cam = ReadPoses(folder / "groundtruth.txt");
  SharedCamera camera(options);
  std::vector<PosedImage> frames;
  Skipped skipped;
  LineReader lines(folder / "rgb.txt");
  while (const auto line = lines.NextContent()) {
    LineTokens tokens(lines, *line);
    const double seconds = tokens.Double("seconds");
    const std::string name(tokens.Token("file"));
    tokens.ExpectEnd();
    const auto pose = PoseAt(world_from_cam, seconds);
    if (!pose) {
      skipped.Add("groundtruth.txt has no pose near its time", name);
      continue;
    }
    if (!skipped.HasPhotograph(folder, name)) continue;
    const Camera& fitted = camera.Get(
        [&] { return FitToPhotograph(CameraOfFolder(scene.name, scene.warnings), folder / name); });
    frames.push_back({name, fitted, pose->Inverse()});
    scene.times.emplace(name, seconds);
  }
  skipped.AddWarnings(scene.warnings);
  SplitFrames(frames, options.query_every, folder, scene);
  scene.thresholds = "0.05,5:0.1,1:0.25,2";
  if (std::filesystem::is_directory(folder / "depth")) {
    scene.geometries = {{"sensor", "depth:" + folder.string() + ",preset=tum"}};
  }
  return {std::move(scene)};
}

}  // namespace raylift
