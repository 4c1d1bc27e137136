#include "raylift/report/localization_report.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>
#include <vector>

#include "base/index_sets.h"
#include "base/json_text.h"
#include "geometry/pose_json.h"
#include "report/page.h"
#include "report/query_facts.h"
#include "report/scene_json.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/io/image_file.h"
#include "raylift/io/query_list.h"

namespace raylift {
namespace {

using Eigen::Vector2d;
using std::filesystem::path;
using Json = nlohmann::ordered_json;

// More would hide the picture.
constexpr size_t kMaxMarks = 250;
constexpr size_t kMaxLines = 120;

double Rounded(double value) { return std::round(value * 10) / 10; }

bool IsInlier(const std::vector<bool>& inliers, size_t i) {
  return i < inliers.size() && inliers[i];
}

Json Mark(const Vector2d& pixel, bool is_inlier, const std::optional<Vector2d>& target) {
  Json mark = {Rounded(pixel.x()), Rounded(pixel.y()), is_inlier ? 1 : 0};
  if (target) {
    mark.push_back(Rounded(target->x() - pixel.x()));
    mark.push_back(Rounded(target->y() - pixel.y()));
  }
  return mark;
}

// Returns the point of the epipolar line, the projections of the reference's keypoint at 0.1 to
// 10^4 baselines, that is nearest to the matched pixel; nullopt where none can be projected.
std::optional<Vector2d> NearestOnEpipolarLine(const PoseProblem& problem, const Match2D2D& match,
                                              const Rigid3& cam_from_world) {
  const PosedImage& reference = problem.references[static_cast<size_t>(match.reference)];
  const auto ray = reference.camera.RayInCam(match.reference_px);
  if (!ray) return std::nullopt;
  const Rigid3 query_from_reference = cam_from_world * reference.cam_from_world.Inverse();
  const double baseline = std::max(query_from_reference.translation.norm(), 1e-9);
  std::optional<Vector2d> nearest;
  Vector2d before = Vector2d::Zero();
  bool has_before = false;
  double least = std::numeric_limits<double>::infinity();
  for (double distance = 0.1 * baseline; distance < 1e4 * baseline; distance *= 1.1) {
    const auto pixel = problem.query_camera.ImgFromCam(query_from_reference * (distance * *ray));
    if (pixel && has_before) {
      // This point is on the chord between this point of the line and the one before.
      const Vector2d along = *pixel - before;
      const double share = std::clamp(
          (match.query_px - before).dot(along) / std::max(along.squaredNorm(), 1e-12), 0.0, 1.0);
      const Vector2d point = before + share * along;
      if ((point - match.query_px).norm() < least) {
        least = (point - match.query_px).norm();
        nearest = point;
      }
    }
    has_before = pixel.has_value();
    if (pixel) before = *pixel;
  }
  return nearest;
}

// Returns marks of some 2D-3D and some 2D-2D matches: [x, y, inlier, dx, dy], in pixels of the
// query. (dx, dy) leads to the projected 3D point, or to the nearest point of the epipolar line; it
// is left out where there is no pose or nothing to be seen.
template <typename Match, typename TargetOf>
Json Marks(const PoseEstimate& estimate, const std::vector<Match>& matches,
           const std::vector<bool>& inliers, const TargetOf& target_of) {
  Json marks = Json::array();
  for (const size_t i : EvenlySpaced(matches.size(), kMaxMarks)) {
    std::optional<Vector2d> target;
    if (estimate.cam_from_world) target = target_of(*estimate.cam_from_world, matches[i]);
    marks.push_back(Mark(matches[i].query_px, IsInlier(inliers, i), target));
  }
  return marks;
}

Json PointMarks(const QueryResult& result) {
  const PoseEstimate& estimate = result.localized.estimate;
  return Marks(
      estimate, result.problem.matches_2d3d, estimate.inliers_2d3d,
      [&](const Rigid3& cam_from_world, const Match2D3D& match) {
        return result.problem.query_camera.ImgFromCam(cam_from_world * match.point_in_world);
      });
}

Json PairMarks(const QueryResult& result) {
  const PoseEstimate& estimate = result.localized.estimate;
  return Marks(estimate, result.problem.matches_2d2d, estimate.inliers_2d2d,
               [&](const Rigid3& cam_from_world, const Match2D2D& match) {
                 return NearestOnEpipolarLine(result.problem, match, cam_from_world);
               });
}

// Returns the index of the reference that most inliers are of, or most matches where none is one,
// among the problem's references.
std::optional<size_t> BestReference(const QueryResult& result) {
  const PoseProblem& problem = result.problem;
  // Each pair counts inliers, and then matches.
  std::vector<std::pair<int, int>> counts(problem.references.size());
  for (size_t i = 0; i < problem.matches_2d2d.size(); ++i) {
    auto& [inliers, matches] = counts[static_cast<size_t>(problem.matches_2d2d[i].reference)];
    inliers += IsInlier(result.localized.estimate.inliers_2d2d, i) ? 1 : 0;
    ++matches;
  }
  const auto best = std::max_element(counts.begin(), counts.end());
  if (best == counts.end() || best->second == 0) return std::nullopt;
  return static_cast<size_t>(best - counts.begin());
}

// Returns lines of matches: [x, y, x in the reference, y, inlier].
Json MatchLines(const QueryResult& result, size_t reference) {
  const PoseProblem& problem = result.problem;
  std::vector<size_t> own;
  for (size_t i = 0; i < problem.matches_2d2d.size(); ++i) {
    if (static_cast<size_t>(problem.matches_2d2d[i].reference) == reference) own.push_back(i);
  }
  Json lines = Json::array();
  for (const size_t k : EvenlySpaced(own.size(), kMaxLines)) {
    const Match2D2D& match = problem.matches_2d2d[own[k]];
    lines.push_back({Rounded(match.query_px.x()), Rounded(match.query_px.y()),
                     Rounded(match.reference_px.x()), Rounded(match.reference_px.y()),
                     IsInlier(result.localized.estimate.inliers_2d2d, own[k]) ? 1 : 0});
  }
  return lines;
}

// The number of points of each query in the view in 3D.
constexpr size_t kScenePoints = 200;

Json PhotoJson(const Image& photo) {
  return {{"uri", JpegDataUri(photo, kPagePictureWidthPx)},
          {"width", photo.width_px},
          {"height", photo.height_px}};
}

// Returns the photograph's color at a pixel; gray where there is no photograph.
std::array<uint8_t, 3> ColorAt(const std::optional<Image>& photo, const Eigen::Vector2d& pixel) {
  constexpr std::array<uint8_t, 3> kGray = {190, 190, 190};
  if (!photo) return kGray;
  const int x = std::clamp(static_cast<int>(pixel.x()), 0, photo->width_px - 1);
  const int y = std::clamp(static_cast<int>(pixel.y()), 0, photo->height_px - 1);
  const uint8_t* color = photo->Pixel(x, y);
  return {color[0], color[1], color[2]};
}

// Returns the points of some inliers, colored by the photograph: [x, y, z, red, green, blue].
Json ScenePointsOf(const QueryResult& result, const std::optional<Image>& photo) {
  const std::vector<bool>& inliers = result.localized.estimate.inliers_2d3d;
  const auto& matches = result.problem.matches_2d3d;
  Json points = Json::array();
  for (const size_t i : EvenlySpaced(matches.size(), kScenePoints)) {
    if (i >= inliers.size() || !inliers[i]) continue;
    const Eigen::Vector3d& point = matches[i].point_in_world;
    const auto [red, green, blue] = ColorAt(photo, matches[i].query_px);
    points.push_back({point.x(), point.y(), point.z(), red, green, blue});
  }
  return points;
}

// Returns what a query adds to the view in 3D.
Json InScene(const QueryResult& result, const std::optional<Image>& photo) {
  Json json = {{"points", ScenePointsOf(result, photo)},
               {"camera", result.problem.query_camera.ToString()}};
  if (result.localized.localized()) {
    json["cam_from_world"] = ToJson(*result.localized.estimate.cam_from_world);
  }
  return json;
}

// Adds the true pose to the scene, and to `query` how far its pose is from it; adds to `errors`
// where there is a pose. `in_scene` is as InScene() gives it.
void TakeTruth(const Rigid3& truth, const Json& in_scene, Json& query, SceneJson& scene,
               std::vector<QueryError>& errors) {
  const auto name = query.at("query").get<std::string>();
  scene.AddCamera("true", PosedImage{name, ParseCamera("camera", in_scene.at("camera")), truth});
  if (!in_scene.contains("cam_from_world")) return;
  const PoseError error = ComparePoses(FromJson<Rigid3>(in_scene.at("cam_from_world")), truth);
  query["position"] = error.position;
  query["rotation_deg"] = error.rotation_deg;
  errors.push_back({name, error});
}

// Returns a clause of the median errors; empty where nothing is compared.
std::string MedianErrors(std::vector<QueryError> errors) {
  if (errors.empty()) return "";
  const size_t count = errors.size();
  const ResultSummary summary =
      Summarize("", {.queries = std::move(errors), .unknown_names = {}}, {});
  return fmt::format("; the median error of {} is {:.4g} units and {:.4g}°", count,
                     summary.median_position, summary.median_rotation_deg);
}

constexpr size_t kShownReferences = 5;

// Returns the references that most matches are of.
Json ReferencesOf(const QueryResult& result) {
  const PoseProblem& problem = result.problem;
  std::vector<std::pair<int, size_t>> counts;
  for (size_t i = 0; i < problem.references.size(); ++i) counts.emplace_back(0, i);
  for (const Match2D2D& match : problem.matches_2d2d) {
    --counts[static_cast<size_t>(match.reference)].first;  // most first, then in their order
  }
  std::sort(counts.begin(), counts.end());
  Json references = Json::array();
  for (const auto& [negative, i] : counts) {
    if (negative == 0 || references.size() == kShownReferences) break;
    references.push_back({{"name", problem.references[i].name}, {"matches", -negative}});
  }
  return references;
}

// Adds a query to the scene; `json` is as InScene() gives it.
void AddToScene(const Json& json, const std::string& name, const std::string& verdict,
                SceneJson& scene) {
  std::vector<ScenePoint> points;
  for (const Json& point : json.at("points")) {
    const auto numbers = point.get<std::array<double, 6>>();
    const auto byte = [&numbers](size_t i) { return static_cast<uint8_t>(numbers[i]); };
    points.push_back(
        {Eigen::Vector3d(numbers[0], numbers[1], numbers[2]), {byte(3), byte(4), byte(5)}});
  }
  scene.AddPoints(points);
  if (json.contains("cam_from_world")) {
    scene.AddCamera(verdict, PosedImage{name, ParseCamera("camera", json.at("camera")),
                                        FromJson<Rigid3>(json.at("cam_from_world"))});
  }
}

path PartOfPage(size_t index, const char* extension) {
  return fmt::format("queries/{:06}.{}", index, extension);
}

}  // namespace

struct LocalizationReport::Impl {
  LocalizationReportOptions options;

  bool IsPaged() const { return options.num_queries > options.max_in_page; }

  // Returns a reference's photograph; null where there is none.
  Json ReferencePhoto(const std::string& name) const {
    const auto photo = ReadPhoto(options.reference_images, name);
    return photo ? PhotoJson(*photo) : Json();
  }

  // Returns all that is shown of one query at a time.
  Json Pictures(const QueryResult& result, const std::optional<Image>& photo) const {
    Json json = {{"points", PointMarks(result)}, {"pairs", PairMarks(result)}};
    if (photo) json["photo"] = PhotoJson(*photo);
    if (const auto best = BestReference(result)) {
      const std::string& name = result.problem.references[*best].name;
      json["reference"] = {{"name", name}, {"lines", MatchLines(result, *best)}};
      // A page that has all queries has the photograph once.
      Json of_reference = IsPaged() ? ReferencePhoto(name) : Json();
      if (!of_reference.is_null()) json["reference"]["photo"] = std::move(of_reference);
    }
    if (!result.localized.localized()) json["references"] = ReferencesOf(result);
    // For a query that is not localized, this shows the nearest candidate.
    if (const auto& pose = result.localized.estimate.cam_from_world; pose && options.mesh) {
      json.update(SeenFromPose(result.problem.query_camera, *pose, *options.mesh));
    }
    return json;
  }
};

LocalizationReport::LocalizationReport(LocalizationReportOptions options)
    : impl_(std::make_unique<Impl>(Impl{std::move(options)})) {}

LocalizationReport::~LocalizationReport() = default;

void LocalizationReport::Take(size_t index, const QueryResult& result) {
  const path& folder = impl_->options.folder;
  const auto photo = ReadPhoto(impl_->options.query_images, result.localized.name);
  Json query = QueryFacts(result.localized);
  const Json pictures = impl_->Pictures(result, photo);
  if (impl_->IsPaged()) {
    const path file = PartOfPage(index, "js");
    WriteFile(folder / file, "takeQuery(" + JsonText(pictures) + ");\n");
    query["file"] = file.string();
  } else {
    query.update(pictures);
  }
  WriteFile(folder / PartOfPage(index, "json"),
            JsonText(Json{{"query", std::move(query)}, {"scene", InScene(result, photo)}}) + "\n");
}

std::string LocalizationReport::Format(std::string_view title,
                                       std::span<const PosedImage> references,
                                       std::span<const std::string> warnings,
                                       const std::optional<ReportedWalk>& walk) const {
  Json queries = Json::array();
  Json data = {{"title", title}};
  SceneJson scene;
  for (const PosedImage& reference : references) scene.AddCamera("reference", reference);
  if (impl_->options.mesh) scene.AddMesh(impl_->options.mesh->mesh());
  std::map<std::string, size_t> count_of;
  std::vector<QueryError> errors;
  std::set<std::string> shown_references;
  std::vector<std::string> without_truth;
  for (size_t i = 0; i < impl_->options.num_queries; ++i) {
    const path file = impl_->options.folder / PartOfPage(i, "json");
    try {
      Json part = Json::parse(ReadFile(file));
      Json& query = part.at("query");
      if (walk) {
        TakeWalk(walk->walked.queries[i], walk->queries[i],
                 impl_->IsPaged() ? nullptr : impl_->options.mesh.get(), part);
      }
      const auto verdict = query.at("verdict").get<std::string>();
      ++count_of[verdict];
      if (walk) AddSinglePose(walk->walked.queries[i], scene);  // what comes later lies above
      AddToScene(part.at("scene"), query.at("query"), verdict, scene);
      const PosesByName& truth = impl_->options.ground_truth;
      if (const auto found = truth.find(query.at("query").get<std::string>());
          found != truth.end()) {
        TakeTruth(found->second, part.at("scene"), query, scene, errors);
      } else if (!truth.empty()) {
        without_truth.push_back(query.at("query").get<std::string>());
      }
      if (query.contains("reference")) {  // not where it is beside the page
        shown_references.insert(query["reference"].at("name").get<std::string>());
      }
      queries.push_back(std::move(query));
    } catch (const Json::exception&) {
      throw InputError(file, "is no part of a page");
    }
  }
  for (const std::string& name : shown_references) {
    Json photo = impl_->ReferencePhoto(name);
    if (!photo.is_null()) SetIn(data, "reference_photos", name, std::move(photo));
  }
  data["subtitle"] =
      fmt::format("{} of {} queries localized, {} of them doubtful, against {} references{}",
                  queries.size() - count_of["failed"], queries.size(), count_of["doubtful"],
                  references.size(), MedianErrors(std::move(errors)));
  data["warnings"] = warnings;
  if (!without_truth.empty()) {
    data["warnings"].push_back(
        fmt::format("no ground truth has the names of {} of {} queries, such as {}",
                    without_truth.size(), queries.size(), without_truth.front()));
  }
  data["rows"] = {{{"name", "this run"}, {"recalls", Json::array()}, {"queries", queries}}};
  data["scene"] = scene.Build();
  if (walk) data["walk"] = WalkJson(walk->walked);
  return MakePage(title, JsonText(data));
}

}  // namespace raylift
