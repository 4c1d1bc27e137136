// Reads and writes query lists, image lists, pose files and lists of views.

#include "raylift/io/query_list.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <map>
#include <optional>
#include <string_view>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "base/input_paths.h"
#include "base/read_limits.h"
#include "io/colmap/colmap_files.h"
#include "io/text/json_document.h"
#include "io/text/line_tokens.h"
#include <fmt/format.h>
#include <glob.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/image_file.h"

namespace raylift {
namespace {

// Returns the files that match a pattern with `*` and `?` as in the shell; brackets and backslashes
// stand for themselves.
std::vector<std::filesystem::path> MatchingFiles(const std::filesystem::path& pattern) {
  std::string escaped;
  for (const char c : pattern.string()) {
    if (c == '[' || c == ']' || c == '\\') {
      escaped += '\\';
    }
    escaped += c;
  }
  glob_t found{};
  std::vector<std::filesystem::path> files;
  if (glob(escaped.c_str(), GLOB_NOSORT, nullptr, &found) == 0) {
    files.assign(found.gl_pathv, found.gl_pathv + found.gl_pathc);
  }
  globfree(&found);
  std::sort(files.begin(), files.end());
  return files;
}

std::vector<std::filesystem::path> ListedFiles(const std::filesystem::path& path_or_pattern) {
  const bool is_pattern = path_or_pattern.string().find_first_of("*?") != std::string::npos;
  if (!is_pattern || Exists(path_or_pattern)) {
    return {path_or_pattern};
  }
  auto files = MatchingFiles(path_or_pattern);
  if (files.empty()) {
    throw InputError(path_or_pattern, "no file has such a name");
  }
  return files;
}

// The uncertainty of the focal length that is guessed for photographs of an unknown camera.
constexpr double kGuessedFocalRange = 2;
// EXIF rounds to whole millimeters, does not say whether the diagonal or the width is meant (4 %
// apart at 4:3) nor that a 4:3 sensor's image was cropped to 16:9 (9 %), and nominal focal lengths
// are off by some per cent.
constexpr double kExifFocalRange = 1.2;
constexpr double kFilmDiagonalMm = 43.267;
Camera CameraOfFocalLength(const PlaneSize& size, double focal_px) {
  const double params[] = {focal_px, 0.5 * size.width_px, 0.5 * size.height_px};
  return {CameraModel::kSimplePinhole, size.width_px, size.height_px, params};
}

std::optional<double> FocalLengthByFilm(const PlaneSize& size, const LensTags& lens) {
  if (!lens.film_mm) return std::nullopt;
  return *lens.film_mm / kFilmDiagonalMm * std::hypot(size.width_px, size.height_px);
}

// Focus and temperature move a lens's focal length by so much from where it was calibrated.
constexpr double kCalibratedFocalSigma = 0.005;

// Returns the camera that the photograph says it was taken with; nullopt where it says none, or
// one that its size or its focal length on film contradict, as where it was cropped.
std::optional<Camera> CalibratedCamera(const PlaneSize& size, const LensTags& lens) {
  if (!lens.calibration) return std::nullopt;
  const auto& [fx, fy, dx, dy, k1, k2, p1, p2, k3] = *lens.calibration;
  const double scale = lens.taken_width_px ? size.width_px / *lens.taken_width_px : 1;
  const double by_film = FocalLengthByFilm(size, lens).value_or(scale * fx);
  // Infinite numbers have no ratio.
  const double off = std::abs(std::log(scale * fx / by_film));
  if (!(off <= std::log(kExifFocalRange)) || !std::isfinite(scale * fy)) return std::nullopt;
  const double x = 0.5 * size.width_px + scale * dx, y = 0.5 * size.height_px + scale * dy;
  if (!(x > 0 && x < size.width_px && y > 0 && y < size.height_px)) return std::nullopt;
  const double params[] = {scale * fx, scale * fy, x, y, k1, k2, p1, p2, k3, 0, 0, 0};
  return Camera(CameraModel::kFullOpenCv, size.width_px, size.height_px, params);
}

// Reads a calibrated camera, and its focal_sigma where the line has one.
void ReadCamera(LineTokens& tokens, Query& query) {
  query.camera = tokens.CameraToEnd("focal_sigma");
  if (tokens.AtEnd()) return;
  tokens.Token("focal_sigma");
  query.priors.focal_sigma = tokens.FocalSigma();
  tokens.ExpectEnd();
}

// Returns the name without quotes at the start of a line: what stands before the camera's model,
// the first word where there is none.
std::string_view PlainName(std::string_view line) {
  const std::vector<std::string_view> words = SplitTokens(line);
  const auto model = std::find_if(words.begin() + 1, words.end(),
                                  [](std::string_view word) { return CameraModelFromName(word); });
  return model == words.end()
             ? words.front()
             : Trim({line.data(), static_cast<size_t>(model->data() - line.data())});
}

Query ReadQuery(const LineReader& lines, std::string_view line,
                const std::filesystem::path& images) {
  if (!images.empty() && IsFile(PathBelow(images, line))) {
    return QueryOfUnknownCamera(std::string(line), images);
  }
  const std::string_view plain = PlainName(line);
  LineTokens tokens(lines, line.starts_with('"') ? line : line.substr(plain.size()));
  Query query = {.name = std::string(line.starts_with('"') ? tokens.Name() : plain), .camera = {}};
  if (!images.empty() && tokens.AtEnd()) return QueryOfUnknownCamera(query.name, images);
  ReadCamera(tokens, query);
  return query;
}

bool HasPictureExtension(const std::filesystem::path& file) {
  constexpr std::array<std::string_view, 10> kExtensions = {
      ".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp", ".ppm", ".pgm", ".pnm"};
  return std::find(kExtensions.begin(), kExtensions.end(), LowerExtension(file)) !=
         kExtensions.end();
}

// Returns all photographs in a folder and below it, by name.
std::vector<Query> QueriesBelow(const std::filesystem::path& folder,
                                const std::filesystem::path& images) {
  const std::filesystem::path root =
      std::filesystem::weakly_canonical(images.empty() ? folder : images);
  std::vector<std::string> names;
  for (const std::filesystem::path& file : ListFilesBelow(std::filesystem::canonical(folder))) {
    if (!HasPictureExtension(file)) continue;
    const auto below = Below(file, root);
    if (!below) {
      throw InputError(
          folder, fmt::format("expected a folder in {}, that of the photographs", images.string()));
    }
    names.push_back(below->string());
  }
  if (names.empty()) throw InputError(folder, "holds no photograph");
  std::sort(names.begin(), names.end());
  std::vector<Query> queries;
  for (const std::string& name : names) queries.push_back(QueryOfUnknownCamera(name, root));
  return queries;
}

using std::filesystem::path;

// A camera of a rig with the prefix of its photographs' names.
struct PrefixedCamera {
  size_t rig = 0;
  int sensor = 0;
  Rigid3 cam_from_rig = {};
};
using CamerasByPrefix = std::map<std::string, PrefixedCamera>;

bool IsReference(const JsonPlace& camera) {
  return camera.Has("ref_sensor") && camera.Member("ref_sensor").Bool();
}

Rigid3 ReadCamFromRig(const JsonPlace& camera) {
  return {camera.Member("cam_from_rig_rotation").Rotation(),
          camera.Member("cam_from_rig_translation").Vector<3>()};
}

void ReadRig(const JsonPlace& cameras, size_t rig, CamerasByPrefix& by_prefix) {
  int num_references = 0;
  for (size_t i = 0; i < cameras.ArraySize(); ++i) {
    const JsonPlace camera = cameras.At(i);
    const JsonPlace prefix = camera.Member("image_prefix");
    const bool is_reference = IsReference(camera);
    // The reference is the first, wherever it stands.
    PrefixedCamera read = {.rig = rig, .sensor = is_reference ? 0 : static_cast<int>(i) + 1};
    if (!is_reference) read.cam_from_rig = ReadCamFromRig(camera);
    num_references += is_reference ? 1 : 0;
    if (!by_prefix.emplace(prefix.String(), read).second) {
      prefix.Fail(fmt::format("\"{}\" stands twice", prefix.String()));
    }
  }
  if (num_references != 1) {
    cameras.Fail(
        fmt::format("expected one camera with \"ref_sensor\": true, found {}", num_references));
  }
}

CamerasByPrefix ReadRigConfig(const path& file) {
  const std::string text = ReadFile(file);
  const JsonDocument document(text, file);
  const JsonPlace root = document.Root();
  CamerasByPrefix by_prefix;
  for (size_t i = 0; i < root.ArraySize(); ++i) {
    const JsonPlace rig = root.At(i);
    const JsonPlace cameras = rig.Member("cameras");
    ReadRig(cameras, i, by_prefix);
  }
  return by_prefix;
}

// Returns the mount of the longest prefix that the name has.
std::optional<RigMount> MountOf(const std::string& name, const CamerasByPrefix& by_prefix) {
  const std::pair<const std::string, PrefixedCamera>* best = nullptr;
  for (const auto& camera : by_prefix) {
    const bool fits = std::string_view(name).starts_with(camera.first);
    if (fits && (best == nullptr || camera.first.size() > best->first.size())) best = &camera;
  }
  if (best == nullptr) return std::nullopt;
  const auto& [prefix, camera] = *best;
  return RigMount{.frame = fmt::format("{}: {}", camera.rig, name.substr(prefix.size())),
                  .sensor = camera.sensor,
                  .cam_from_rig = camera.cam_from_rig};
}

// Reads the mounts of a model's images, by their names.
std::map<std::string, RigMount> ReadMounts(const path& folder) {
  const ColmapModel model = ReadColmapModel(folder);
  if (model.frames.empty()) {
    throw InputError(folder, "expected a model with rigs and frames, found none of them");
  }
  std::map<std::string, RigMount> mounts;
  for (const auto& [frame_id, frame] : model.frames) {
    const ColmapRig& rig = model.rigs.at(frame.rig_id);
    for (const ColmapFrame::Data& data : frame.data) {
      if (data.sensor.type != colmap::kCameraSensor || data.data_id > UINT32_MAX) continue;
      const auto image = model.images.find(static_cast<uint32_t>(data.data_id));
      if (image == model.images.end()) continue;
      const std::optional<Rigid3> cam_from_rig = colmap::SensorFromRig(rig, data.sensor);
      if (!cam_from_rig) {
        throw InputError(folder, fmt::format("rig {}: the pose of camera {} is not known",
                                             frame.rig_id, data.sensor.id));
      }
      const bool is_reference = rig.reference_sensor == data.sensor;
      mounts[image->second.name] = {.frame = std::to_string(frame_id),
                                    .sensor = is_reference ? -1 : static_cast<int>(data.sensor.id),
                                    .cam_from_rig = *cam_from_rig};
    }
  }
  return mounts;
}

}  // namespace

Query QueryOfUnknownCamera(const std::string& name, PlaneSize size, const LensTags& lens) {
  if (auto camera = CalibratedCamera(size, lens)) {
    return {.name = name, .camera = *camera, .priors = {.focal_sigma = kCalibratedFocalSigma}};
  }
  const double focal_px =
      FocalLengthByFilm(size, lens).value_or(1.2 * std::max(size.width_px, size.height_px));
  return {.name = name,
          .camera = CameraOfFocalLength(size, focal_px),
          .priors = {.focal_range = lens.film_mm ? kExifFocalRange : kGuessedFocalRange}};
}

Query QueryOfUnknownCamera(const std::string& name, const std::filesystem::path& images) {
  const std::filesystem::path file = PathBelow(images, name);
  return QueryOfUnknownCamera(name, ReadImageSize(file), ReadLensTags(file));
}

std::vector<Query> ReadQueryList(const std::filesystem::path& path_or_pattern,
                                 const std::filesystem::path& images) {
  if (IsFolder(path_or_pattern)) return QueriesBelow(path_or_pattern, images);
  std::vector<Query> queries;
  std::unordered_map<std::string, std::string> place_of_name;
  for (const std::filesystem::path& path : ListedFiles(path_or_pattern)) {
    LineReader lines(path);
    while (const auto line = lines.NextContent()) {
      queries.push_back(ReadQuery(lines, *line, images));
      const std::string& name = queries.back().name;
      const auto [other, is_new] = place_of_name.emplace(
          name, fmt::format("{}: line {}", path.string(), lines.line_number()));
      if (!is_new) {
        lines.Fail(fmt::format("name: \"{}\" stands twice (also in {})", name, other->second));
      }
    }
  }
  if (queries.empty()) throw InputError(path_or_pattern, "lists no photograph");
  return queries;
}

void TakeCamera(const std::string& text, Query& query) {
  LineReader lines("camera", text);
  const auto line = lines.NextContent();
  if (!line || line->size() != text.size()) {
    throw InputError("camera", "expected MODEL width height params... in one line");
  }
  LineTokens tokens(lines, *line);
  ReadCamera(tokens, query);
}

void WriteQueryList(const std::filesystem::path& path, const std::vector<Query>& queries) {
  std::string text;
  for (const Query& query : queries) {
    text += NameText(path, query.name) + ' ' + query.camera.ToString();
    if (const auto& sigma = query.priors.focal_sigma) {
      text += " focal_sigma " + FormatDouble(*sigma);
    }
    text += '\n';
  }
  WriteFile(path, text);
}

std::vector<std::string> ReadImageList(const std::filesystem::path& path) {
  std::vector<std::string> names;
  LineReader lines(path);
  while (const auto line = lines.NextContent()) {
    names.emplace_back(Trim(*line));
  }
  return names;
}

std::vector<NamedPose> ReadPoseFile(const std::filesystem::path& path) {
  std::vector<NamedPose> poses;
  LineReader lines(path);
  while (const auto line = lines.NextContent()) {
    LineTokens tokens(lines, *line);
    NamedPose& pose = poses.emplace_back();
    pose.name = tokens.Name();
    pose.cam_from_world = tokens.Pose();
    while (!tokens.AtEnd()) {
      const std::string_view further = tokens.Token("number");
      if (!ParseDouble(further)) {
        tokens.Fail(fmt::format("expected numbers behind the pose, found \"{}\"", further));
      }
    }
  }
  return poses;
}

void WritePoseFile(const std::filesystem::path& path, const std::vector<NamedPose>& poses) {
  std::string text;
  for (const NamedPose& pose : poses) {
    text += fmt::format("{} {}\n", NameText(path, pose.name), FormatPose(pose.cam_from_world));
  }
  WriteFile(path, text);
}

void TakeRigs(const path& file_or_model, std::span<Query> queries) {
  bool any = false;
  if (std::filesystem::is_directory(file_or_model)) {
    const std::map<std::string, RigMount> mounts = ReadMounts(file_or_model);
    for (Query& query : queries) {
      const auto mount = mounts.find(query.name);
      if (mount != mounts.end()) query.rig = mount->second;
      any = any || query.rig;
    }
  } else {
    const CamerasByPrefix by_prefix = ReadRigConfig(file_or_model);
    for (Query& query : queries) {
      query.rig = MountOf(query.name, by_prefix);
      any = any || query.rig;
    }
  }
  if (!any) {
    throw InputError(file_or_model,
                     fmt::format("knows none of the {} queries by name", queries.size()));
  }
  std::map<std::string, int> photographs_of_frame;
  for (const Query& query : queries) {
    if (query.rig) ++photographs_of_frame[query.rig->frame];
  }
  for (Query& query : queries) {
    if (query.rig && photographs_of_frame[query.rig->frame] == 1) query.rig.reset();
  }
}

std::map<std::string, Rigid3> ReadNamedPoses(const std::filesystem::path& file) {
  std::map<std::string, Rigid3> poses;
  for (const NamedPose& pose : ReadPoseFile(file)) {
    if (!poses.emplace(pose.name, pose.cam_from_world).second) {
      throw InputError(file, fmt::format("the name {} stands twice", pose.name));
    }
  }
  return poses;
}

std::map<std::string, Rigid3> ReadModelOrPoses(const std::filesystem::path& model_or_file) {
  if (!std::filesystem::is_directory(model_or_file)) return ReadNamedPoses(model_or_file);
  std::map<std::string, Rigid3> poses;
  for (const PosedImage& image : ReadColmapModel(model_or_file).PosedImages()) {
    poses.emplace(image.name, image.cam_from_world);
  }
  return poses;
}

namespace {

int Side(LineTokens& tokens, std::string_view field) {
  const int side = tokens.Int(field);
  if (side < 1 || side > kMaxImageSidePx) {
    tokens.Fail(fmt::format("{}: expected 1 to {}, found {}", field, kMaxImageSidePx, side));
  }
  return side;
}

Camera CameraToEnd(LineTokens& tokens) {
  LineTokens ahead = tokens;
  if (ahead.Token("camera model") != "EQUIRECTANGULAR") return tokens.CameraToEnd();
  const int width = Side(ahead, "width");
  const int height = Side(ahead, "height");
  if (!ahead.AtEnd()) return tokens.CameraToEnd();  // COLMAP's, which says its size again
  return Camera::Panorama(width, height);
}

}  // namespace

std::vector<PosedImage> ReadViewList(const std::filesystem::path& path) {
  std::vector<PosedImage> views;
  std::unordered_set<std::string> names;
  LineReader lines(path);
  while (const auto line = lines.NextContent()) {
    LineTokens tokens(lines, *line);
    PosedImage view;
    view.name = tokens.Name();
    if (!names.insert(view.name).second) {
      tokens.Fail(fmt::format("name: \"{}\" stands twice", view.name));
    }
    view.cam_from_world = tokens.Pose();
    view.camera = CameraToEnd(tokens);
    views.push_back(std::move(view));
  }
  return views;
}

Camera ParseCamera(const std::string& what, const std::string& text) {
  const LineReader lines(what, "");
  LineTokens tokens(lines, text);
  return tokens.CameraToEnd();
}

std::vector<Eigen::Vector3d> ReadPointList(const std::filesystem::path& path) {
  std::vector<Eigen::Vector3d> points;
  LineReader lines(path);
  while (const auto line = lines.NextContent()) {
    LineTokens tokens(lines, *line);
    points.push_back(tokens.Vector<3>("point"));
    tokens.ExpectEnd();
  }
  return points;
}

}  // namespace raylift
