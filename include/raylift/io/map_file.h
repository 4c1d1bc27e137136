// Pictures that stand beside depth maps: vectors and whole numbers, one per pixel.

#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>

#include "raylift/io/depth_file.h"
#include "raylift/scene/image.h"

namespace raylift {

// x, y, z per pixel, row-major, the top row first. By the file name, or `options.format`:
//   .exr  channels R, G, B (x, y, z)         .npy, .npz  an array (height, width, 3), key
//   .bin  COLMAP's normal maps (planar)                  `options.layer`, by default "normals"
// Returns the file's size in bytes. Errors as WriteDepthFile.
size_t WriteVectorMap(const std::filesystem::path& path, PlaneSize size,
                      std::span<const float> vectors, const DepthWriteOptions& options = {});

// One whole number per pixel, exactly: .exr (uint32, channel "id"), .npy, .npz (uint32, key "id").
size_t WriteIndexMap(const std::filesystem::path& path, PlaneSize size,
                     std::span<const uint32_t> indices, const DepthWriteOptions& options = {});

}  // namespace raylift
