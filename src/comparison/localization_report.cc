#include "raylift/comparison/localization_report.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "report_pictures.h"
#include "report_scene.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/json_text.h"
#include "raylift/comparison/report_page.h"
#include "raylift/io/image_file.h"

namespace raylift {
namespace {

using Json = nlohmann::ordered_json;

constexpr size_t kShownKeypoints = 200;
constexpr int kPhotoWidthPx = 480;

struct ScenePoint {
  Eigen::Vector3d point_in_world;
  std::array<uint8_t, 3> color_rgb;
};

struct QueryEntry {
  Json json;
  Json photo;
  std::vector<ScenePoint> points;
  std::optional<PosedImage> view;
};

// Grey where there is no photograph.
std::array<uint8_t, 3> ColorAt(const std::optional<Image>& photo, const Eigen::Vector2d& pixel) {
  constexpr std::array<uint8_t, 3> kGrey = {190, 190, 190};
  if (!photo) return kGrey;
  const int x = std::clamp(static_cast<int>(pixel.x()), 0, photo->width_px - 1);
  const int y = std::clamp(static_cast<int>(pixel.y()), 0, photo->height_px - 1);
  const uint8_t* color = photo->Pixel(x, y);
  return {color[0], color[1], color[2]};
}

Json CountsJson(const LocalizedQuery& query) {
  const StageCounts& counts = query.counts;
  Json json = {{"query", query.name},
               {"reason", query.reason},
               {"position", nullptr},
               {"rotation_deg", nullptr},
               {"retrieved", counts.retrieved},
               {"matched", counts.matched},
               {"hit", counts.hit},
               {"consistent", counts.filter.consistent},
               {"inliers_2d3d", counts.inliers_2d3d},
               {"inliers_2d2d", counts.inliers_2d2d}};
  if (query.localized()) {
    json["solver"] = ToString(query.estimate.solver);
    if (query.estimate.covariance) {
      json["position_sigma"] = query.estimate.position_sigma;
      json["rotation_sigma_deg"] = query.estimate.rotation_sigma_deg;
    }
  }
  return json;
}

}  // namespace

struct LocalizationReport::Impl {
  std::filesystem::path query_images;
  size_t photo_stride = 1;
  std::vector<QueryEntry> entries;

  // A missing photograph leaves a gap, not an error.
  std::optional<Image> ReadPhoto(size_t index, const std::string& name) const {
    if (query_images.empty() || index % photo_stride != 0) return std::nullopt;
    try {
      return ReadImage(query_images / name, ImageChannels::kRgb);
    } catch (const InputError&) {
      return std::nullopt;
    }
  }
};

LocalizationReport::LocalizationReport(size_t num_queries, std::filesystem::path query_images,
                                       size_t max_photos)
    : impl_(std::make_unique<Impl>()) {
  RAYLIFT_CHECK(max_photos > 0);
  impl_->query_images = std::move(query_images);
  impl_->photo_stride = std::max<size_t>(1, (num_queries + max_photos - 1) / max_photos);
  impl_->entries.resize(num_queries);
}

LocalizationReport::~LocalizationReport() = default;

void LocalizationReport::Take(size_t index, const QueryResult& result) {
  // Every query has a place of its own: no lock is needed.
  QueryEntry& entry = impl_->entries.at(index);
  const LocalizedQuery& query = result.localized;
  const PoseEstimate& estimate = query.estimate;
  entry.json = CountsJson(query);
  const auto photo = impl_->ReadPhoto(index, query.name);
  if (photo) {
    entry.photo = {{"uri", JpegDataUri(*photo, kPhotoWidthPx)},
                   {"width", photo->width_px},
                   {"height", photo->height_px}};
  }
  const auto& matches = result.problem.matches_2d3d;
  const size_t stride = matches.size() / kShownKeypoints + 1;
  for (size_t i = 0; i < matches.size(); i += stride) {
    const bool is_inlier = i < estimate.inliers_2d3d.size() && estimate.inliers_2d3d[i];
    const Eigen::Vector2d& pixel = matches[i].query_px;
    entry.json["keypoints"].push_back(
        {std::round(pixel.x() * 10) / 10, std::round(pixel.y() * 10) / 10, is_inlier ? 1 : 0});
    if (is_inlier) entry.points.push_back({matches[i].point_in_world, ColorAt(photo, pixel)});
  }
  if (query.localized()) {
    entry.view = PosedImage{query.name, result.problem.query_camera, *estimate.cam_from_world};
  }
}

std::string LocalizationReport::Format(std::string_view title,
                                       std::span<const PosedImage> references) const {
  Json queries = Json::array();
  Json data = {{"title", title}};
  SceneJson scene;
  for (const PosedImage& reference : references) scene.AddCamera("reference", reference);
  size_t num_localized = 0;
  for (const QueryEntry& entry : impl_->entries) {
    queries.push_back(entry.json);
    if (!entry.photo.is_null()) {
      data["query_photos"][entry.json["query"].get<std::string>()] = entry.photo;
    }
    for (const ScenePoint& point : entry.points) {
      scene.AddPoint(point.point_in_world, point.color_rgb);
    }
    if (entry.view) {
      scene.AddCamera("estimated", *entry.view);
      ++num_localized;
    }
  }
  data["subtitle"] = fmt::format("{} of {} queries localized against {} references", num_localized,
                                 queries.size(), references.size());
  data["rows"] = {{{"name", "this run"}, {"recalls", Json::array()}, {"queries", queries}}};
  data["scene"] = scene.Build();
  return MakePage(title, JsonText(data));
}

}  // namespace raylift
