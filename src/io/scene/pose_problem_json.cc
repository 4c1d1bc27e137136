// Reads pose problems; they are written in pose_problem_format.cc.

#include "raylift/io/pose_problem_json.h"

#include <algorithm>

#include "base/input_paths.h"
#include "io/text/json_document.h"
#include "io/text/line_tokens.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/scene/keypoints.h"

namespace raylift {
namespace {

// The first format is the second without priors and rigs.
constexpr std::string_view kFormats[] = {"pose-problem/1", "pose-problem/2"};

Camera ReadCamera(const JsonPlace& place) {
  const JsonPlace model_place = place.Member("model");
  const std::string name = model_place.String();
  const auto model = CameraModelFromName(name);
  if (!model) {
    model_place.Fail(fmt::format("unknown camera model \"{}\"", name));
  }
  const JsonPlace params_place = place.Member("params");
  std::vector<double> params(params_place.ArraySize());
  for (size_t i = 0; i < params.size(); ++i) {
    params[i] = params_place.At(i).Number();
  }
  const int width_px = place.Member("width").Int();
  const int height_px = place.Member("height").Int();
  return place.Blame([&] { return Camera(*model, width_px, height_px, params); });
}

Rigid3 ReadPose(const JsonPlace& place) {
  return {place.Member("qvec").Rotation(), place.Member("tvec").Vector<3>()};
}

PosedImage ReadReference(const JsonPlace& place) {
  return {place.Member("name").String(), ReadCamera(place.Member("camera")),
          ReadPose(place.Member("cam_from_world"))};
}

// Reads an index; `what` gets an s behind it where there are several.
int ReadIndex(const JsonPlace& place, std::string_view what, size_t count) {
  const int index = place.Int();
  if (index < 0 || static_cast<size_t>(index) >= count) {
    place.Fail(
        fmt::format("{} index {} is out of range, there are {} {}s", what, index, count, what));
  }
  return index;
}

std::vector<RigCamera> ReadOtherCameras(const JsonPlace& place) {
  std::vector<RigCamera> cameras;
  const size_t count = place.ArraySize();
  for (size_t i = 0; i < count; ++i) {
    const JsonPlace camera = place.At(i);
    cameras.push_back({camera.Member("name").String(), ReadCamera(camera.Member("camera")),
                       ReadPose(camera.Member("cam_from_query"))});
  }
  return cameras;
}

// Reads a list with a value for each match, where there is one.
template <typename Match, typename Read>
void ReadColumn(const JsonPlace& parent, std::string_view name, std::vector<Match>& matches,
                const Read& read) {
  if (!parent.Has(name)) return;
  const JsonPlace column = parent.Member(name);
  column.ExpectArraySize(matches.size());
  for (size_t i = 0; i < matches.size(); ++i) read(column.At(i), matches[i]);
}

void ReadMatches2D2D(const JsonPlace& place, PoseProblem* problem) {
  problem->matches_2d2d.resize(place.ArraySize());
  for (size_t i = 0; i < problem->matches_2d2d.size(); ++i) {
    const JsonPlace row = place.At(i);
    row.ExpectArraySize(5);
    Match2D2D& match = problem->matches_2d2d[i];
    match.reference = ReadIndex(row.At(0), "reference", problem->references.size());
    match.query_px = {row.At(1).Number(), row.At(2).Number()};
    match.reference_px = {row.At(3).Number(), row.At(4).Number()};
  }
}

void ReadMatches2D3D(const JsonPlace& place, PoseProblem* problem) {
  problem->matches_2d3d.resize(place.ArraySize());
  for (size_t i = 0; i < problem->matches_2d3d.size(); ++i) {
    const auto row = place.At(i).Vector<5>();
    problem->matches_2d3d[i].query_px = row.head<2>();
    problem->matches_2d3d[i].point_in_world = row.tail<3>();
  }
}

std::optional<double> ReadSigma(const JsonPlace& place) {
  if (place.IsNull()) return std::nullopt;
  const double sigma = place.Number();
  if (sigma < 0) {
    place.Fail(fmt::format("expected a standard deviation, found {}", sigma));
  }
  return sigma;
}

int ReadKeypoint(const JsonPlace& place) {
  const int index = place.Int();
  if (index < 0 || index > kLargestKeypoint) {
    place.Fail(fmt::format("expected the index of a keypoint, found {}", index));
  }
  return index;
}

template <typename Match>
void ReadQueryKeypoint(const JsonPlace& place, Match& match) {
  match.query_keypoint = ReadKeypoint(place);
}

// Reads the member "extra". "keypoint" is of both kinds of matches where "keypoint_2d3d" is
// missing.
void ReadExtra(const JsonPlace& extra, PoseProblem& problem) {
  std::vector<Match2D2D>& pairs = problem.matches_2d2d;
  std::vector<Match2D3D>& points = problem.matches_2d3d;
  if (extra.Has("keypoint")) {
    const size_t count = extra.Member("keypoint").ArraySize();
    const bool is_of_2d3d = !extra.Has("keypoint_2d3d") && count == points.size();
    if (is_of_2d3d) ReadColumn(extra, "keypoint", points, ReadQueryKeypoint<Match2D3D>);
    if (!is_of_2d3d || count == pairs.size()) {
      ReadColumn(extra, "keypoint", pairs, ReadQueryKeypoint<Match2D2D>);
    }
  }
  ReadColumn(extra, "keypoint_2d3d", points, ReadQueryKeypoint<Match2D3D>);
  ReadColumn(extra, "reference_keypoint", pairs, [](const JsonPlace& place, Match2D2D& pair) {
    if (!place.IsNull()) pair.reference_keypoint = ReadKeypoint(place);
  });
  ReadColumn(extra, "match_2d2d", points, [&pairs](const JsonPlace& place, Match2D3D& point) {
    if (place.IsNull()) return;
    const int index = place.Int();
    if (index < 0 || static_cast<size_t>(index) >= pairs.size()) {
      place.Fail(fmt::format("match index {} is out of range, there are {} 2D-2D matches", index,
                             pairs.size()));
    }
    point.match_2d2d = static_cast<size_t>(index);
  });
}

void ReadReferenceClusters(const JsonPlace& place, PoseProblem* problem) {
  const size_t count = problem->references.size();
  place.ExpectArraySize(count);
  for (size_t i = 0; i < count; ++i) {
    const JsonPlace cluster = place.At(i);
    const int number = cluster.Int();
    if (number < 0 || static_cast<size_t>(number) >= count) {
      cluster.Fail(fmt::format("expected a cluster below {}, found {}", count, number));
    }
    problem->reference_clusters.push_back(number);
  }
}

Eigen::Vector3d ReadDirection(const JsonPlace& place) {
  Eigen::Vector3d direction = place.Vector<3>();
  if (!HasDirection(direction)) {
    place.Fail(fmt::format("expected a direction, found {}",
                           direction.isZero(0) ? "zeros" : "numbers out of range"));
  }
  return direction;
}

double ReadSigmaDeg(const JsonPlace& prior) {
  const JsonPlace place = prior.Member("sigma_deg");
  const std::optional<double> sigma_deg = ReadSigma(place);
  if (!sigma_deg) place.Fail("expected a standard deviation, found null");
  return *sigma_deg;
}

PosePriors ReadPriors(const JsonPlace& query) {
  PosePriors priors;
  if (query.Has("position_prior")) {
    const JsonPlace place = query.Member("position_prior");
    const JsonPlace sigma = place.Member("sigma");
    priors.position = {.position = place.Member("position").Vector<3>(),
                       .sigma = sigma.Vector<3>()};
    if (priors.position->sigma.minCoeff() < 0) sigma.Fail("expected standard deviations");
  }
  if (query.Has("gravity_prior")) {
    const JsonPlace place = query.Member("gravity_prior");
    priors.gravity = {.down_in_cam = ReadDirection(place.Member("down_in_cam")),
                      .down_in_world = ReadDirection(place.Member("down_in_world")),
                      .sigma_deg = ReadSigmaDeg(place)};
  }
  if (query.Has("heading_prior")) {
    const JsonPlace place = query.Member("heading_prior");
    priors.heading = {.right_in_cam = ReadDirection(place.Member("right_in_cam")),
                      .right_in_world = ReadDirection(place.Member("right_in_world")),
                      .down_in_world = ReadDirection(place.Member("down_in_world")),
                      .sigma_deg = ReadSigmaDeg(place)};
  }
  if (query.Has("orientation_prior")) {
    const JsonPlace place = query.Member("orientation_prior");
    priors.orientation = {.cam_from_world = place.Member("qvec").Rotation(),
                          .sigma_deg = ReadSigmaDeg(place)};
  }
  if (query.Has("range_prior")) {
    const JsonPlace place = query.Member("range_prior");
    const JsonPlace range = place.Member("range");
    const JsonPlace sigma = place.Member("sigma"), of_plane = place.Member("plane_sigma");
    priors.range = {
        .range = range.Number(),
        .sigma = sigma.Number(),
        .plane = RangePrior::Plane{place.Member("point").Vector<3>(),
                                   ReadDirection(place.Member("normal")), of_plane.Number()}};
    if (!(priors.range->range > 0)) range.Fail("expected a positive range");
    if (!(priors.range->sigma >= 0)) sigma.Fail("expected a standard deviation");
    if (!(priors.range->plane->sigma >= 0)) of_plane.Fail("expected a standard deviation");
  }
  if (query.Has("focal_range")) {
    const JsonPlace place = query.Member("focal_range");
    priors.focal_range = place.Number();
    if (!(priors.focal_range >= 1 && priors.focal_range <= kMaxFocalRange)) {
      place.Fail(fmt::format("expected a factor of 1 to {}", kMaxFocalRange));
    }
  }
  if (query.Has("focal_sigma")) {
    const JsonPlace place = query.Member("focal_sigma");
    priors.focal_sigma = ReadSigma(place);
    if (priors.focal_sigma.value_or(0) > kMaxFocalSigma) {
      place.Fail(fmt::format("expected a share of the focal length of 0 to {}", kMaxFocalSigma));
    }
  }
  return priors;
}

ReferenceSigmas ReadReferenceSigmas(const JsonPlace& place) {
  const auto sigma = [&](const char* name) {
    return place.Has(name) ? ReadSigma(place.Member(name)) : std::nullopt;
  };
  return {.factor = sigma("factor"),
          .rotation_deg = sigma("rotation_deg"),
          .position = sigma("position")};
}

PoseProblemFile ReadRoot(const JsonPlace& root) {
  const JsonPlace format = root.Member("format");
  if (std::ranges::find(kFormats, format.String()) == std::end(kFormats)) {
    format.Fail(fmt::format("expected \"{}\" or \"{}\", found \"{}\"", kFormats[0], kFormats[1],
                            format.String()));
  }
  PoseProblemFile file;
  PoseProblem& problem = file.problem;
  problem.name = root.Member("name").String();
  const JsonPlace query = root.Member("query");
  problem.query_camera = ReadCamera(query.Member("camera"));
  problem.priors = ReadPriors(query);
  if (query.Has("other_cameras")) {
    problem.other_cameras = ReadOtherCameras(query.Member("other_cameras"));
  }
  if (query.Has("gt_cam_from_world")) {
    file.gt_cam_from_world = ReadPose(query.Member("gt_cam_from_world"));
  }
  const JsonPlace references = root.Member("references");
  const size_t num_references = references.ArraySize();
  for (size_t i = 0; i < num_references; ++i) {
    problem.references.push_back(ReadReference(references.At(i)));
  }
  ReadMatches2D2D(root.Member("matches_2d2d"), &problem);
  ReadMatches2D3D(root.Member("matches_2d3d"), &problem);
  const auto read_camera = [&problem](const JsonPlace& place, auto& match) {
    match.camera = ReadIndex(place, "camera", static_cast<size_t>(problem.num_cameras()));
  };
  ReadColumn(root, "matches_2d2d_camera", problem.matches_2d2d, read_camera);
  ReadColumn(root, "matches_2d3d_camera", problem.matches_2d3d, read_camera);
  if (root.Has("reference_clusters")) {
    ReadReferenceClusters(root.Member("reference_clusters"), &problem);
  }
  ReadColumn(root, "matches_2d3d_reference", problem.matches_2d3d,
             [&](const JsonPlace& place, Match2D3D& match) {
               if (!place.IsNull()) match.reference = ReadIndex(place, "reference", num_references);
             });
  ReadColumn(root, "matches_2d2d_sigma_px", problem.matches_2d2d,
             [](const JsonPlace& place, Match2D2D& match) {
               match.reference_sigma_px = ReadSigma(place);
             });
  ReadColumn(
      root, "matches_2d3d_sigma", problem.matches_2d3d,
      [](const JsonPlace& place, Match2D3D& match) { match.point_sigma = ReadSigma(place); });
  ReadColumn(
      root, "matches_2d3d_log_depth_sigma", problem.matches_2d3d,
      [](const JsonPlace& place, Match2D3D& match) { match.log_depth_sigma = ReadSigma(place); });
  if (root.Has("reference_sigmas")) {
    problem.reference_sigmas = ReadReferenceSigmas(root.Member("reference_sigmas"));
  }
  if (root.Has("search_area_px2")) {
    const JsonPlace place = root.Member("search_area_px2");
    problem.search_area_px2 = place.Number();
    if (!(problem.search_area_px2 > 0)) place.Fail("expected an area above 0");
  }
  if (root.Has("extra")) {
    ReadExtra(root.Member("extra"), problem);
  }
  AssignKeypointsByPixel(problem);
  return file;
}

}  // namespace

PoseProblemFile ReadPoseProblem(const std::filesystem::path& path) {
  return ParsePoseProblem(ReadFile(path), path);
}

PoseProblemFile ParsePoseProblem(std::string_view json,
                                 const std::filesystem::path& path_for_messages) {
  const JsonDocument document(json, path_for_messages);
  return ReadRoot(document.Root());
}

std::vector<std::filesystem::path> ListPoseProblems(const std::filesystem::path& file_or_folder) {
  if (!IsFolder(file_or_folder)) {
    if (!Exists(file_or_folder)) {
      throw InputError(file_or_folder, "no such file or folder");
    }
    return {file_or_folder};
  }
  std::vector<std::filesystem::path> files = ListFilesBelow(file_or_folder);
  std::erase_if(files, [](const std::filesystem::path& file) {
    return file.extension() != ".json" || file.filename().string().starts_with('.');
  });
  if (files.empty()) {
    throw InputError(file_or_folder, "expected pose problems (*.json), found none");
  }
  return files;
}

}  // namespace raylift
