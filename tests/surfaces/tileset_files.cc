#include "tileset_files.h"

#include <cmath>

#include "mesh_files.h"
#include <fmt/format.h>
#include <fmt/ranges.h>

namespace raylift {

TilePatch HillPatch(const Eigen::Vector2d& center) {
  constexpr uint32_t kSide = 81;
  TilePatch patch;
  for (uint32_t row = 0; row < kSide; ++row) {
    for (uint32_t column = 0; column < kSide; ++column) {
      const Eigen::Vector2d at = center + Eigen::Vector2d(column * 0.5 - 20, row * 0.5 - 20);
      const double height = 3 * std::sin(at.x() / 5) * std::cos(at.y() / 7);
      patch.vertices.emplace_back(static_cast<float>(at.x()), static_cast<float>(at.y()),
                                  static_cast<float>(std::round(height * 256) / 256));
      if (row == 0 || column == 0) continue;
      const uint32_t last = row * kSide + column;
      patch.triangles.push_back({last - kSide - 1, last - kSide, last});
      patch.triangles.push_back({last - kSide - 1, last, last - 1});
    }
  }
  return patch;
}

std::string TileGlb(const TilePatch& patch, const std::string& node, const std::string& root) {
  std::string bin;
  Eigen::AlignedBox3f box;
  for (const Eigen::Vector3f& v : patch.vertices) {
    const Eigen::Vector3f y_up(v.x(), v.z(), -v.y());
    box.extend(y_up);
    for (const float value : y_up) AppendBytes(bin, value);
  }
  const size_t indices_at = bin.size();
  for (const auto& triangle : patch.triangles) {
    for (const uint32_t index : triangle) AppendBytes(bin, index);
  }
  const std::string json = fmt::format(
      R"({{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0{}}}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}],
"buffers":[{{"byteLength":{}}}],"bufferViews":[{{"buffer":0,"byteLength":{}}},
{{"buffer":0,"byteOffset":{},"byteLength":{}}}],
"accessors":[{{"bufferView":0,"componentType":5126,"count":{},"type":"VEC3","min":[{}],"max":[{}]}},
{{"bufferView":1,"componentType":5125,"count":{},"type":"SCALAR"}}]{}}})",
      node, bin.size(), indices_at, indices_at, bin.size() - indices_at, patch.vertices.size(),
      fmt::join(box.min(), ","), fmt::join(box.max(), ","), patch.triangles.size() * 3, root);
  return GlbOf(json, bin);
}

std::string Tile(const std::string& kind, const std::string& rest) {
  std::string tile = kind;
  AppendBytes(tile, uint32_t{1});
  AppendBytes(tile, static_cast<uint32_t>(12 + rest.size()));
  return tile + rest;
}

std::string B3dm(const std::string& glb, const Eigen::Vector3d& center) {
  std::string features = R"({"BATCH_LENGTH":0)";
  if (!center.isZero(0)) {
    features += fmt::format(R"(,"RTC_CENTER":[{:.17g},{:.17g},{:.17g}])", center.x(), center.y(),
                            center.z());
  }
  features += '}';
  while ((28 + features.size()) % 8 != 0) features += ' ';
  std::string rest;
  for (const size_t size : {features.size(), size_t{0}, size_t{0}, size_t{0}}) {
    AppendBytes(rest, static_cast<uint32_t>(size));
  }
  return Tile("b3dm", rest + features + glb);
}

std::string Cmpt(const std::vector<std::string>& tiles) {
  std::string rest;
  AppendBytes(rest, static_cast<uint32_t>(tiles.size()));
  for (const std::string& tile : tiles) rest += tile;
  return Tile("cmpt", rest);
}

std::string ColumnsOf(const Eigen::Affine3d& transform) {
  std::string text = "[";
  for (const double value : transform.matrix().reshaped()) {
    text += fmt::format("{}{:.17g}", text.size() > 1 ? "," : "", value);
  }
  return text + "]";
}

}  // namespace raylift
