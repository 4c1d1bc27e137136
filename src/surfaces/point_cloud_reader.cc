#include <algorithm>
#include <array>
#include <utility>

#include "base/input_paths.h"
#include "surfaces/file_readers.h"
#include "surfaces/input_files.h"
#include "surfaces/raw_mesh.h"
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

constexpr auto kTextExtensions =
    std::to_array<std::string_view>({".xyz", ".txt", ".asc", ".pts", ".csv"});
constexpr auto kExtensions = std::to_array<std::string_view>(
    {".ply", ".las", ".pcd", ".xyz", ".txt", ".asc", ".pts", ".csv"});

PointCloud ReadPlyCloud(const std::filesystem::path& path, std::string_view contents) {
  RawMesh mesh = ReadPly(path, ParsePlyHeader(path, contents), contents);
  PointCloud cloud;
  cloud.points_in_world = std::move(mesh.positions);
  cloud.normals = std::move(mesh.position_normals);
  cloud.colors_rgb = std::move(mesh.position_colors);
  return cloud;
}

PointCloud ReadByExtension(const std::filesystem::path& path) {
  const std::string extension = LowerExtension(path);
  if (extension == ".laz") {
    throw InputError(path, "compressed LAS is not read: expected it decompressed, as .las");
  }
  const MappedFile file(path);
  if (extension == ".ply") return ReadPlyCloud(path, file.contents());
  if (extension == ".las") return ReadLasCloud(path, file.contents());
  if (extension == ".pcd") return ReadPcdCloud(path, file.contents());
  if (std::find(kTextExtensions.begin(), kTextExtensions.end(), extension) !=
      kTextExtensions.end()) {
    return ReadTextCloud(path, file.contents());
  }
  throw InputError(path, fmt::format("expected a point cloud: {}", fmt::join(kExtensions, ", ")));
}

template <typename T>
void KeepOnly(const std::vector<bool>& keep, std::vector<T>& values) {
  if (values.empty()) return;
  size_t kept = 0;
  for (size_t i = 0; i < values.size(); ++i) {
    if (keep[i]) values[kept++] = values[i];
  }
  values.resize(kept);
}

void DropUnusable(const std::filesystem::path& path, PointCloud& cloud) {
  std::vector<bool> keep(cloud.points_in_world.size());
  std::transform(cloud.points_in_world.begin(), cloud.points_in_world.end(), keep.begin(),
                 IsUsablePosition);
  const auto dropped = std::count(keep.begin(), keep.end(), false);
  if (dropped == 0) return;
  cloud.warnings.push_back(
      fmt::format("{}: {} of {} points left out: not finite", path.string(), dropped, keep.size()));
  KeepOnly(keep, cloud.points_in_world);
  KeepOnly(keep, cloud.normals);
  KeepOnly(keep, cloud.colors_rgb);
}

template <typename T>
void Append(std::vector<T>&& from, std::vector<T>& to) {
  to.insert(to.end(), std::make_move_iterator(from.begin()), std::make_move_iterator(from.end()));
}

}  // namespace

PointCloud ReadPointCloud(const std::filesystem::path& path) {
  PointCloud cloud = ReadByExtension(path);
  DropUnusable(path, cloud);
  if (cloud.points_in_world.empty()) throw InputError(path, "expected points, found none");
  constexpr size_t kMostPoints = 0xfffffffeu;  // indices have 32 bits
  if (cloud.points_in_world.size() > kMostPoints) {
    throw InputError(path, fmt::format("{} points are too many", cloud.points_in_world.size()));
  }
  return cloud;
}

std::vector<std::filesystem::path> ListCloudFiles(const std::string& files) {
  return ListFiles(files, kExtensions, "point cloud");
}

bool IsCloudFileName(const std::filesystem::path& file) {
  return std::find(kExtensions.begin(), kExtensions.end(), LowerExtension(file)) !=
         kExtensions.end();
}

PointCloud ReadPointClouds(std::span<const std::filesystem::path> files) {
  RAYLIFT_CHECK(!files.empty());
  PointCloud all = ReadPointCloud(files.front());
  for (const std::filesystem::path& file : files.subspan(1)) {
    PointCloud cloud = ReadPointCloud(file);
    if (cloud.normals.empty()) all.normals.clear();
    if (cloud.colors_rgb.empty()) all.colors_rgb.clear();
    if (!all.normals.empty()) Append(std::move(cloud.normals), all.normals);
    if (!all.colors_rgb.empty()) Append(std::move(cloud.colors_rgb), all.colors_rgb);
    Append(std::move(cloud.points_in_world), all.points_in_world);
    Append(std::move(cloud.warnings), all.warnings);
  }
  return all;
}

}  // namespace raylift
