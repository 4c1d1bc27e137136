#include "raylift/comparison/report.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "base/index_sets.h"
#include "base/json_text.h"
#include "comparison/comparison_tables.h"
#include "lifting/source_view.h"
#include "report/page.h"
#include "report/scene_json.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"
#include "raylift/io/image_file.h"

namespace raylift {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kFullError = 0.2;
constexpr int kHistogramBins = 41;
constexpr int kQueryPhotoWidthPx = 640;
constexpr size_t kMaxStrips = 40;  // images that are shown, evenly spread
constexpr int kThumbnailWidthPx = 220;

Json MetricsJson() {
  Json metrics = Json::array();
  for (const DepthMetric& metric : DepthMetrics()) {
    std::string better = "neither";
    if (metric.better == DepthMetric::Better::kLow) better = "low";
    if (metric.better == DepthMetric::Better::kHigh) better = "high";
    metrics.push_back({{"key", metric.key},
                       {"title", metric.title},
                       {"better", better},
                       {"digits", metric.digits}});
  }
  return metrics;
}

}  // namespace

struct ReportPictures::Impl {
  struct Strip {
    Json json;
    std::vector<ScenePoint> points;
  };

  ReportOptions options;
  std::optional<size_t> truth;
  double near = 1, far = 2;
  std::map<size_t, Strip> strips;  // of the images that are shown

  Json MakeStrip(const PosedImage& view, std::span<const SourceView> views,
                 const std::optional<Image>& photo) const {
    Json sources = Json::array();
    for (size_t s = 0; s < views.size(); ++s) {
      const DepthMap& depth = views[s].depth;
      Json source = {{"depth", JpegDataUri(ColorizeDepth(depth, near, far), kThumbnailWidthPx)},
                     {"error", nullptr}};
      if (truth && s != *truth) {
        const DepthMap& true_depth = views[*truth].depth;
        source["error"] =
            JpegDataUri(ColorizeError(depth, true_depth, kFullError), kThumbnailWidthPx);
        source["histogram"] = ErrorHistogram(depth, true_depth, kFullError, kHistogramBins);
      }
      sources.push_back(std::move(source));
    }
    return {{"image", view.name},
            {"photo", photo ? Json(JpegDataUri(*photo, kThumbnailWidthPx)) : Json()},
            {"sources", sources}};
  }
};

ReportPictures::ReportPictures(std::span<const ComparedSource> sources,
                               std::span<const PosedImage> images, std::optional<size_t> truth,
                               const ReportOptions& options)
    : impl_(std::make_unique<Impl>()) {
  impl_->options = options;
  impl_->truth = truth;
  std::vector<double> depths;
  constexpr int kPixels = 100;
  for (const size_t i : EvenlySpaced(images.size(), kMaxStrips)) {
    impl_->strips.try_emplace(i);
    const GeometrySource& source = *sources[truth.value_or(0)].source;
    for (const auto& point : source.Lift(images[i], GridPixels(images[i].camera, kPixels))) {
      if (point && point->depth_z > 0) depths.push_back(point->depth_z);
    }
  }
  if (!depths.empty()) {
    std::sort(depths.begin(), depths.end());
    impl_->near = depths[depths.size() / 50];
    impl_->far = depths[depths.size() - 1 - depths.size() / 50];
  }
}

ReportPictures::~ReportPictures() = default;

void ReportPictures::Take(size_t image, const PosedImage& view, std::span<const SourceView> views) {
  // Every image has a place of its own: no lock is needed.
  const auto strip = impl_->strips.find(image);
  if (strip == impl_->strips.end()) return;
  const auto photo = ReadPhoto(impl_->options.images, view.name);
  strip->second.json = impl_->MakeStrip(view, views, photo);
  // Shows the truth, else the first source, colored by the photograph, else by how near it is.
  const DepthMap& depth = views[impl_->truth.value_or(0)].depth;
  strip->second.points =
      PointsOf(view, depth, photo ? *photo : ColorizeDepth(depth, impl_->near, impl_->far));
}

std::string FormatReport(const DepthComparison& comparison,
                         const LocalizationComparison* localization, const ReportPictures& pictures,
                         std::span<const PosedImage> references,
                         std::span<const PosedImage> true_queries, const ReportOptions& options) {
  const ReportPictures::Impl& taken = *pictures.impl_;
  Json data = Json::parse(FormatComparisonJson(comparison));
  data["title"] = options.title;
  data["subtitle"] = fmt::format("{} sources of geometry, {} images", comparison.sources.size(),
                                 references.size());
  if (const std::string advice = Advice(comparison); !advice.empty()) {
    data["subtitle"] = fmt::format("{}; {}", data["subtitle"].get<std::string>(), advice);
  }
  data["metrics"] = MetricsJson();
  data["depth_range"] = {taken.near, taken.far};
  data["full_error"] = kFullError;
  data["depth_colors"] = DepthColors();
  data["error_colors"] = ErrorColors();
  data["tile_width"] = kThumbnailWidthPx;
  SceneJson scene;
  for (const auto& [index, strip] : taken.strips) {
    if (!strip.json.is_null()) AppendTo(data, "strips", strip.json);
    scene.AddPoints(strip.points);
  }
  for (const PosedImage& reference : references) scene.AddCamera("reference", reference);
  for (const PosedImage& query : true_queries) scene.AddCamera("true", query);
  if (localization != nullptr) {
    data["rows"] = Json::parse(FormatLocalizationJson(*localization))["rows"];
    const auto best = std::find_if(localization->rows.begin(), localization->rows.end(),
                                   [](const LocalizationRow& row) { return row.is_best; });
    for (const PosedImage& query : true_queries) {
      if (best == localization->rows.end()) break;
      const auto detail = best->details.find(query.name);
      if (detail != best->details.end() && detail->second.cam_from_world) {
        scene.AddCamera("estimated", {query.name, query.camera, *detail->second.cam_from_world},
                        query.cam_from_world.OriginInSource());
      }
    }
    for (const PosedImage& query : true_queries) {
      if (const auto photo = ReadPhoto(options.query_images, query.name)) {
        SetIn(data, "query_photos", query.name,
              {{"uri", JpegDataUri(*photo, kQueryPhotoWidthPx)},
               {"width", photo->width_px},
               {"height", photo->height_px}});
      }
    }
  }
  data["scene"] = scene.Build();
  return MakePage(options.title, JsonText(data));
}

std::string FormatEvaluationReport(std::span<const Threshold> thresholds,
                                   std::span<const EvaluatedResult> results,
                                   const PosesByName& ground_truth, std::string_view title) {
  Json data = {
      {"title", title},
      {"subtitle", fmt::format("{} results, {} queries", results.size(), ground_truth.size())},
      {"rows", Json::array()}};
  SceneJson scene;
  for (const auto& [name, pose] : ground_truth) scene.AddCamera("true", name, pose);
  for (const EvaluatedResult& result : results) {
    Json recalls = Json::array();
    for (size_t t = 0; t < thresholds.size(); ++t) {
      recalls.push_back({{"position", thresholds[t].position},
                         {"rotation_deg", thresholds[t].rotation_deg},
                         {"percent", result.summary.recalls_percent[t]}});
    }
    Json queries = Json::array();
    for (const QueryError& query : result.comparison.queries) {
      queries.push_back({{"query", query.name},
                         {"position", query.error ? Json(query.error->position) : Json()},
                         {"rotation_deg", query.error ? Json(query.error->rotation_deg) : Json()}});
    }
    const double median = result.summary.median_position;
    data["rows"].push_back({{"name", result.summary.name},
                            {"method", result.summary.name},
                            {"uses_ground_truth", result.summary.uses_ground_truth},
                            {"recalls", recalls},
                            {"median_position", std::isfinite(median) ? Json(median) : Json()},
                            {"queries", queries}});
    for (const auto& [name, pose] : result.poses) {
      scene.AddCamera("estimated", name, pose, ground_truth.at(name).OriginInSource());
    }
  }
  data["scene"] = scene.Build();
  return MakePage(title, JsonText(data));
}

}  // namespace raylift
