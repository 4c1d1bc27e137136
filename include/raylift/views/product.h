// What is rendered of each view, and how it is stored.

#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "raylift/base/enum_names.h"
#include "raylift/io/depth_file.h"
#include "raylift/renderers/frame_renderer.h"
#include "raylift/surfaces/triangle_mesh.h"

namespace raylift {

enum class Product {
  kDepth,         // z along the optical axis; 0 = none
  kDistance,      // along the ray; 0 = none
  kInverseDepth,  // 1 / depth: disparity over baseline and focal length; 0 = none
  kPoints,        // x, y, z of what is seen; NaN = none
  kNormals,       // unit, toward the camera; 0 = none
  kColor,         // RGB
  kTriangle,      // face of the mesh's file, from 0; 4294967295 = none
  kObject,        // which of the meshes, from 0; 4294967295 = none
  kIncidence,     // angle between normal and ray, degrees; -1 = none
  kMask,          // 255 where there is a surface
};
template <>
inline constexpr auto kEnumNames<Product> = std::to_array<EnumName<Product>>({
    {Product::kDepth, "depth"},
    {Product::kDistance, "distance"},
    {Product::kInverseDepth, "inverse_depth"},
    {Product::kPoints, "points"},
    {Product::kNormals, "normals"},
    {Product::kColor, "color"},
    {Product::kTriangle, "triangle"},
    {Product::kObject, "object"},
    {Product::kIncidence, "incidence"},
    {Product::kMask, "mask"},
});

// x, y, z per pixel.
constexpr bool IsVector(Product product) {
  return product == Product::kNormals || product == Product::kPoints;
}

// Whole numbers.
constexpr bool IsId(Product product) {
  return product == Product::kTriangle || product == Product::kObject;
}

// What kInverseDepth holds, of a frame with a map of depth.
std::vector<float> InverseDepths(const Frame& frame);

// What kTriangle and kObject hold, of a frame of this mesh with a map of triangles.
std::vector<uint32_t> FaceIds(const Frame& frame, const TriangleMesh& mesh);
std::vector<uint32_t> ObjectIds(const Frame& frame, const TriangleMesh& mesh);

struct ProductOutput {
  Product product;
  std::string format;  // one of FormatsOf(product); also the files' extension
};

// The formats that can hold a product, the default first: of "exr", "npy", "npz", "png", "tiff",
// "bin" (COLMAP), "pfm", "jpg".
std::span<const std::string_view> FormatsOf(Product product);

// What the channels of an EXR file are called, separated by commas.
std::string_view ExrChannels(Product product);

struct StorageOptions {
  DepthWriteOptions floats;  // `format` and `layer` are set for each file
  int jpeg_quality = 92;
};

// Asks for the maps that the products need.
void Request(std::span<const ProductOutput> products, FrameOptions& options);

struct WrittenFile {
  std::filesystem::path file;
  size_t bytes = 0;
  size_t dropped = 0;  // values that the format could not hold
};

// Writes one product of a frame of this mesh. Errors as WriteDepthFile; thread safe.
WrittenFile WriteProduct(const std::filesystem::path& file, const ProductOutput& output,
                         const Frame& frame, const TriangleMesh& mesh,
                         const StorageOptions& options);

}  // namespace raylift
