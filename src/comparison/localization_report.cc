#include "raylift/comparison/localization_report.h"

#include <algorithm>
#include <array>
#include <map>
#include <mutex>
#include <vector>

#include "base/index_sets.h"
#include "base/json_text.h"
#include "query_page.h"
#include "report_pictures.h"
#include "report_scene.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/comparison/report_page.h"
#include "raylift/io/image_file.h"

namespace raylift {
namespace {

using Json = nlohmann::ordered_json;

// Of each query, for the view in 3D.
constexpr size_t kScenePoints = 200;

struct QueryEntry {
  Json json;
  std::vector<ScenePoint> points;
  std::optional<PosedImage> view;
};

Json PhotoJson(const Image& photo) {
  return {{"uri", JpegDataUri(photo, kPagePictureWidthPx)},
          {"width", photo.width_px},
          {"height", photo.height_px}};
}

// Gray where there is no photograph.
std::array<uint8_t, 3> ColorAt(const std::optional<Image>& photo, const Eigen::Vector2d& pixel) {
  constexpr std::array<uint8_t, 3> kGray = {190, 190, 190};
  if (!photo) return kGray;
  const int x = std::clamp(static_cast<int>(pixel.x()), 0, photo->width_px - 1);
  const int y = std::clamp(static_cast<int>(pixel.y()), 0, photo->height_px - 1);
  const uint8_t* color = photo->Pixel(x, y);
  return {color[0], color[1], color[2]};
}

// Of the inliers.
std::vector<ScenePoint> ScenePointsOf(const QueryResult& result,
                                      const std::optional<Image>& photo) {
  const std::vector<bool>& inliers = result.localized.estimate.inliers_2d3d;
  const auto& matches = result.problem.matches_2d3d;
  std::vector<ScenePoint> points;
  for (const size_t i : EvenlySpaced(matches.size(), kScenePoints)) {
    if (i >= inliers.size() || !inliers[i]) continue;
    points.push_back({matches[i].point_in_world, ColorAt(photo, matches[i].query_px)});
  }
  return points;
}

}  // namespace

struct LocalizationReport::Impl {
  LocalizationReportOptions options;
  std::vector<QueryEntry> entries;
  std::map<std::string, Json> reference_photos;
  std::mutex mutex;  // guards them

  bool IsPaged() const { return options.num_queries > options.max_in_page; }

  // Null where there is none, and where the page has it already.
  Json ReferencePhoto(const std::string& name) {
    if (!IsPaged()) {
      const std::lock_guard lock(mutex);
      if (reference_photos.contains(name)) return nullptr;
    }
    const auto photo = ReadPhoto(options.reference_images, name);
    if (!photo) return nullptr;
    Json json = PhotoJson(*photo);
    if (IsPaged()) return json;
    const std::lock_guard lock(mutex);
    reference_photos.emplace(name, std::move(json));
    return nullptr;
  }

  // All that is looked at of one query at a time.
  Json Pictures(const QueryResult& result, const std::optional<Image>& photo) {
    Json json = {{"points", PointMarks(result)}, {"pairs", PairMarks(result)}};
    if (photo) json["photo"] = PhotoJson(*photo);
    if (const auto best = BestReference(result)) {
      const std::string& name = result.problem.references[*best].name;
      json["reference"] = {{"name", name}, {"lines", MatchLines(result, *best)}};
      if (Json of_reference = ReferencePhoto(name); !of_reference.is_null()) {
        json["reference"]["photo"] = std::move(of_reference);
      }
    }
    if (result.localized.localized() && options.mesh != nullptr) {
      json.update(SeenFromPose(result, *options.mesh));
    }
    return json;
  }
};

LocalizationReport::LocalizationReport(LocalizationReportOptions options)
    : impl_(std::make_unique<Impl>()) {
  impl_->entries.resize(options.num_queries);
  impl_->options = std::move(options);
}

LocalizationReport::~LocalizationReport() = default;

void LocalizationReport::Take(size_t index, const QueryResult& result) {
  // Every query has a place of its own: no lock is needed.
  QueryEntry& entry = impl_->entries.at(index);
  const LocalizedQuery& query = result.localized;
  entry.json = QueryFacts(query);
  const auto photo = ReadPhoto(impl_->options.query_images, query.name);
  const Json pictures = impl_->Pictures(result, photo);
  if (impl_->IsPaged()) {
    const std::string file = fmt::format("queries/{:06}.js", index);
    WriteFile(impl_->options.folder / file, "takeQuery(" + JsonText(pictures) + ");\n");
    entry.json["file"] = file;
  } else {
    entry.json.update(pictures);
  }
  entry.points = ScenePointsOf(result, photo);
  if (query.localized()) {
    entry.view =
        PosedImage{query.name, result.problem.query_camera, *query.estimate.cam_from_world};
  }
}

std::string LocalizationReport::Format(std::string_view title,
                                       std::span<const PosedImage> references,
                                       std::span<const std::string> warnings) const {
  Json queries = Json::array();
  Json data = {{"title", title}};
  SceneJson scene;
  for (const PosedImage& reference : references) scene.AddCamera("reference", reference);
  if (impl_->options.mesh) scene.AddMesh(impl_->options.mesh->mesh());
  std::map<std::string, size_t> count_of;
  for (const QueryEntry& entry : impl_->entries) {
    queries.push_back(entry.json);
    const auto verdict = entry.json["verdict"].get<std::string>();
    ++count_of[verdict];
    scene.AddPoints(entry.points);
    if (entry.view) scene.AddCamera(verdict, *entry.view);
  }
  for (const auto& [name, photo] : impl_->reference_photos) {
    SetIn(data, "reference_photos", name, photo);
  }
  data["subtitle"] = fmt::format(
      "{} of {} queries localized, {} of them doubtful, against {} references",
      queries.size() - count_of["failed"], queries.size(), count_of["doubtful"], references.size());
  data["warnings"] = warnings;
  data["rows"] = {{{"name", "this run"}, {"recalls", Json::array()}, {"queries", queries}}};
  data["scene"] = scene.Build();
  return MakePage(title, JsonText(data));
}

}  // namespace raylift
