#include "raylift/report/geometry_report.h"

#include <algorithm>
#include <vector>

#include "base/index_sets.h"
#include "base/json_text.h"
#include "lifting/source_view.h"
#include "renderers/view_frame.h"
#include "report/page.h"
#include "report/scene_json.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/parallel.h"

namespace raylift {
namespace {

using Json = nlohmann::ordered_json;

constexpr size_t kMaxPictured = 24;  // images, evenly spread
constexpr int kTileSidePx = 240;     // the longer side

// Returns the 2nd and the 98th percentile of all depths, between which the colors are spread.
std::pair<double, double> DepthColorRange(std::span<const DepthMap> maps) {
  std::vector<float> depths;
  for (const DepthMap& map : maps) {
    for (const float z : map.z) {
      if (z > 0) depths.push_back(z);
    }
  }
  if (depths.empty()) return {1, 2};
  std::sort(depths.begin(), depths.end());
  const size_t margin = depths.size() / 50;
  return {depths[margin], depths[depths.size() - 1 - margin]};
}

void AddDepthKey(Json& data, const std::pair<double, double>& range) {
  data["depth_range"] = {range.first, range.second};
  data["depth_colors"] = DepthColors();
}

Json Tile(const Image& image, std::string_view caption) {
  return {{"uri", JpegDataUri(image, kTileSidePx)}, {"caption", caption}};
}

Json RowJson(const RenderedView& image) {
  const auto depth = [&image](auto member) {
    return image.depth_range ? Json((*image.depth_range).*member) : Json();
  };
  return {
      {"image", image.view.name},
      {"size", fmt::format("{} x {}", image.view.camera.width_px(), image.view.camera.height_px())},
      {"coverage_percent", 100 * image.coverage},
      {"nearest", depth(&std::pair<float, float>::first)},
      {"farthest", depth(&std::pair<float, float>::second)},
      {"bytes", image.bytes}};
}

void AddCamera(SceneJson& scene, const PosedImage& view) {
  if (view.camera.is_panorama()) {
    scene.AddCamera("reference", view.name, view.cam_from_world);
  } else {
    scene.AddCamera("reference", view);
  }
}

}  // namespace

std::string FormatRenderReport(const RenderReport& report) {
  Json data = {
      {"title", report.title}, {"subtitle", report.subtitle}, {"warnings", report.warnings}};
  FrameOptions options;
  options.depth = true;
  options.color = true;
  options.color_options = report.colors;
  options.color_options.background_rgb = kPictureBackground;
  const FrameRenderer renderer(report.scene, options);
  const std::vector<size_t> shown = EvenlySpaced(report.images.size(), kMaxPictured);
  std::vector<DepthMap> maps(shown.size());
  std::vector<Image> colors(shown.size());
  ParallelFor(shown.size(), report.threads, [&](size_t i) {
    Frame frame = RenderScaled(renderer, report.images[shown[i]].view, kTileSidePx);
    maps[i] = {frame.width_px, frame.height_px, std::move(frame.depth)};
    colors[i] = std::move(frame.color);
  });
  const auto range = DepthColorRange(maps);
  Json pictures = Json::array();
  for (size_t i = 0; i < shown.size(); ++i) {
    const RenderedView& image = report.images[shown[i]];
    pictures.push_back({{"image", image.view.name},
                        {"coverage_percent", 100 * image.coverage},
                        {"tiles",
                         {Tile(colors[i], "color"),
                          Tile(ColorizeDepth(maps[i], range.first, range.second), "depth")}}});
  }
  AddDepthKey(data, range);
  Json rows = Json::array();
  SceneJson scene;
  scene.AddMesh(report.scene->mesh());
  for (const RenderedView& image : report.images) {
    rows.push_back(RowJson(image));
    AddCamera(scene, image.view);
  }
  data["rendered"] = {{"images", rows}, {"pictures", pictures}};
  data["scene"] = scene.Build();
  return MakePage(report.title, JsonText(data));
}

std::string FormatDoctorReport(const DoctorReport& report) {
  Json data = {
      {"title", report.title}, {"subtitle", report.subtitle}, {"warnings", report.warnings}};
  const std::vector<size_t> shown = EvenlySpaced(report.references.size(), kMaxPictured);
  std::vector<DepthMap> maps(shown.size());
  ParallelFor(shown.size(), report.threads, [&](size_t i) {
    maps[i] = LookThrough(report.source, ShrunkTo(report.references[shown[i]], kTileSidePx)).depth;
  });
  const auto range = DepthColorRange(maps);
  SceneJson scene;
  Json pictures = Json::array();
  for (size_t i = 0; i < shown.size(); ++i) {
    const PosedImage view = ShrunkTo(report.references[shown[i]], kTileSidePx);
    const auto photo = ReadPhoto(report.images, view.name);
    const Image depth = ColorizeDepth(maps[i], range.first, range.second);
    Json tiles = Json::array();
    if (photo) tiles.push_back(Tile(*photo, "photograph"));
    tiles.push_back(Tile(depth, "depth as read"));
    pictures.push_back({{"image", view.name}, {"tiles", std::move(tiles)}});
    // A mesh is shown by itself.
    if (report.surface == nullptr) {
      scene.AddPoints(PointsOf(view, maps[i], photo ? *photo : depth));
    }
  }
  AddDepthKey(data, range);
  if (report.surface != nullptr) scene.AddMesh(report.surface->mesh());
  for (const PosedImage& reference : report.references) scene.AddCamera("reference", reference);
  data["doctor"] = {{"diagnosis", Json::parse(report.diagnosis)}, {"pictures", pictures}};
  data["scene"] = scene.Build();
  return MakePage(report.title, JsonText(data));
}

}  // namespace raylift
