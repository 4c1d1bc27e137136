#include <algorithm>
#include <span>

#include "base/bytes.h"
#include "views/surface_labels.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/io/depth_file.h"
#include "raylift/io/image_file.h"
#include "raylift/scene/image.h"
#include "raylift/views/render_job.h"

namespace raylift {
namespace {

using std::filesystem::path;

constexpr std::array<std::string_view, 7> kOfDepth = {"npy", "exr",  "npz", "png",
                                                      "bin", "tiff", "pfm"};
constexpr std::array<std::string_view, 5> kOfAngles = {"npy", "exr", "npz", "tiff", "pfm"};
constexpr std::array<std::string_view, 5> kOfNormals = {"npy", "exr", "npz", "png", "bin"};
constexpr std::array<std::string_view, 4> kOfPoints = {"npy", "exr", "npz", "ply"};
constexpr std::array<std::string_view, 4> kOfIndices = {"npy", "exr", "npz", "png"};
constexpr std::array<std::string_view, 2> kOfColor = {"png", "jpg"};
constexpr std::array<std::string_view, 1> kOfMask = {"png"};

// Returns normals as a picture to look at: -1 .. 1 is 0 .. 255, gray where there is none.
Image NormalPicture(const Frame& frame) {
  Image image{frame.width_px, frame.height_px, 3, std::vector<uint8_t>(frame.normals.size())};
  std::transform(frame.normals.begin(), frame.normals.end(), image.data.begin(),
                 [](float n) { return NearestByte(127.5f * (n + 1)); });
  return image;
}

WrittenFile WritePicture(const path& file, const Image& image, int jpeg_quality) {
  WriteImage(file, image, jpeg_quality);
  return {file, static_cast<size_t>(std::filesystem::file_size(file))};
}

WrittenFile WriteFloats(const path& file, const Frame& frame, const std::vector<float>& values,
                        const DepthWriteOptions& options) {
  const DepthWriteReport report =
      WriteDepthFile(file, {frame.width_px, frame.height_px, values}, options);
  return {file, report.bytes, report.dropped};
}

// Writes only the points on the surface, in the order of the pixels.
WrittenFile WriteCloud(const path& file, const Frame& frame) {
  std::string rows;
  for (size_t i = 0; i < frame.points.size(); i += 3) {
    const Eigen::Map<const Eigen::Vector3f> point(&frame.points[i]);
    if (!point.allFinite()) continue;
    const Eigen::Vector3d in_world = frame.points_origin + point.cast<double>();
    rows += AsBytes(std::span(in_world.data(), 3));
    rows += AsBytes(std::span(&frame.normals[i], 3));
    rows += AsBytes(std::span(&frame.color.data[i], 3));
  }
  constexpr size_t kRowBytes = 3 * (sizeof(double) + sizeof(float) + sizeof(uint8_t));
  const std::string header = fmt::format(
      "ply\nformat binary_little_endian 1.0\ncomment written by Raylift\nelement vertex {}\n"
      "property double x\nproperty double y\nproperty double z\n"
      "property float nx\nproperty float ny\nproperty float nz\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
      rows.size() / kRowBytes);
  const std::string_view parts[] = {header, rows};
  WriteFile(file, parts);
  return {file, header.size() + rows.size()};
}

DepthWriteOptions OptionsFor(const ProductOutput& output, const DepthWriteOptions& floats) {
  DepthWriteOptions options = floats;
  options.format = std::nullopt;
  options.layer = {};
  const bool holds_half =
      output.format == "exr" || output.format == "npy" || output.format == "npz";
  if (!holds_half) options.sample = FloatSample::kFloat32;
  if (output.format == "npz") options.layer = ToString(output.product);
  return options;
}

}  // namespace

std::vector<float> InverseDepths(const Frame& frame) {
  std::vector<float> inverse(frame.depth.size());
  std::transform(frame.depth.begin(), frame.depth.end(), inverse.begin(),
                 [](float z) { return z > 0 ? 1 / z : 0.0f; });
  return inverse;
}

std::vector<uint32_t> IdsOf(Product product, const Frame& frame, const TriangleMesh& mesh) {
  RAYLIFT_CHECK(IsId(product));
  const auto id_of = [&](uint32_t triangle) {
    if (triangle == HitBlock::kNoTriangle) return triangle;
    if (product == Product::kTriangle) return mesh.FaceOf(triangle);
    if (product == Product::kObject) return mesh.ObjectOf(triangle);
    return IdOf(product, mesh.LabelOf(triangle));
  };
  std::vector<uint32_t> ids(frame.triangle.size());
  std::transform(frame.triangle.begin(), frame.triangle.end(), ids.begin(), id_of);
  return ids;
}

std::span<const std::string_view> FormatsOf(Product product) {
  if (IsId(product)) return kOfIndices;
  if (product == Product::kDepth || product == Product::kDistance) return kOfDepth;
  if (product == Product::kNormals) return kOfNormals;
  if (product == Product::kPoints) return kOfPoints;
  if (product == Product::kColor) return kOfColor;
  return product == Product::kMask ? std::span<const std::string_view>(kOfMask) : kOfAngles;
}

std::string_view ExrChannels(Product product) {
  if (IsVector(product)) return "R,G,B";
  return IsId(product) ? "id" : "Y";
}

void Request(std::span<const ProductOutput> products, FrameOptions& options) {
  for (const ProductOutput& output : products) {
    options.depth |= output.product == Product::kDepth || output.product == Product::kInverseDepth;
    options.points |= output.product == Product::kPoints;
    options.points_from_center |= output.format == "ply";
    options.distance |= output.product == Product::kDistance;
    options.normals |= output.product == Product::kNormals || output.format == "ply";
    options.color |= HasColors(output);
    options.triangle |= IsId(output.product);
    options.incidence |= output.product == Product::kIncidence;
    options.mask |= output.product == Product::kMask;
  }
}

WrittenFile WriteProduct(const path& file, const ProductOutput& output, const Frame& frame,
                         const TriangleMesh& mesh, const StorageOptions& storage) {
  const DepthWriteOptions options = OptionsFor(output, storage.floats);
  const PlaneSize size{frame.width_px, frame.height_px};
  switch (output.product) {
    case Product::kDepth:
      return WriteFloats(file, frame, frame.depth, options);
    case Product::kDistance:
      return WriteFloats(file, frame, frame.distance, options);
    case Product::kIncidence:
      return WriteFloats(file, frame, frame.incidence_deg, options);
    case Product::kInverseDepth:
      return WriteFloats(file, frame, InverseDepths(frame), options);
    case Product::kPoints:
      if (output.format == "ply") return WriteCloud(file, frame);
      return {file, WriteVectorMap(file, size, frame.points, options)};
    case Product::kNormals:
      if (output.format == "png") return WritePicture(file, NormalPicture(frame), 0);
      return {file, WriteVectorMap(file, size, frame.normals, options)};
    case Product::kColor:
      return WritePicture(file, frame.color, storage.jpeg_quality);
    case Product::kTriangle:
    case Product::kObject:
    case Product::kInstance:
    case Product::kSemantic:
      return {file, WriteIndexMap(file, size, IdsOf(output.product, frame, mesh), options)};
    case Product::kMask:
      return WritePicture(file, frame.mask, 0);
  }
  RAYLIFT_CHECK(false);
}

}  // namespace raylift
