// The formats of point clouds, one reader each. What they return may hold points that are not
// finite, and no point at all. `contents` is the whole file, `path` for messages: InputError where
// something is wrong with it.

#pragma once

#include <filesystem>
#include <string_view>

#include "raylift/surfaces/point_cloud.h"

namespace raylift {

PointCloud ReadPlyCloud(const std::filesystem::path& path, std::string_view contents);
PointCloud ReadLasCloud(const std::filesystem::path& path, std::string_view contents);
PointCloud ReadPcdCloud(const std::filesystem::path& path, std::string_view contents);
PointCloud ReadTextCloud(const std::filesystem::path& path, std::string_view contents);

}  // namespace raylift
