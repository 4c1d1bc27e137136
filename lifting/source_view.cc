#include "lifting/source_view.h"

#include <algorithm>
#include <cmath>

#include "raylift/base/error.h"

namespace raylift {
namespace {

constexpr int kRowsPerBatch = 32;
// A source that does not know the surface turns the normal straight to the camera.
constexpr double kMinIncidenceDeg = 1e-6;

int SparseSide(int side_px, int stride) { return std::max(1, side_px / stride); }

// Returns the position in the whole image of the i-th pixel center of a sparse one.
double SparsePixel(int i, int stride) { return i * stride + (stride - 1) / 2 + 0.5; }

}  // namespace

SourceView LookThrough(const GeometrySource& source, const PosedImage& image, int stride) {
  const int width = SparseSide(image.camera.width_px(), stride);
  const int height = SparseSide(image.camera.height_px(), stride);
  const size_t count = static_cast<size_t>(width) * static_cast<size_t>(height);
  SourceView view;
  view.depth = {width, height, std::vector<float>(count, 0.0F)};
  view.normals_in_world.assign(3 * count, 0.0F);
  view.incidence_deg.assign(count, -1.0F);
  std::vector<Eigen::Vector2d> pixels;
  for (int begin = 0; begin < height; begin += kRowsPerBatch) {
    pixels.clear();
    for (int y = begin; y < std::min(height, begin + kRowsPerBatch); ++y) {
      for (int x = 0; x < width; ++x)
        pixels.emplace_back(SparsePixel(x, stride), SparsePixel(y, stride));
    }
    const auto points = source.Lift(image, pixels);
    size_t i = static_cast<size_t>(begin) * static_cast<size_t>(width);
    for (const auto& point : points) {
      if (point && point->depth_z > 0) {
        view.depth.z[i] = static_cast<float>(point->depth_z);
        if (point->incidence_deg > kMinIncidenceDeg) {
          view.incidence_deg[i] = static_cast<float>(point->incidence_deg);
          for (int axis = 0; axis < 3; ++axis) {
            view.normals_in_world[3 * i + static_cast<size_t>(axis)] =
                static_cast<float>(point->normal_in_world[axis]);
          }
        }
      }
      ++i;
    }
  }
  return view;
}

PosedImage Sparse(const PosedImage& image, int stride) {
  RAYLIFT_CHECK(stride > 0);
  const Camera& camera = image.camera;
  const int width = SparseSide(camera.width_px(), stride);
  const int height = SparseSide(camera.height_px(), stride);
  if (camera.is_panorama() || stride == 1) {
    return {image.name, camera.Scaled(width, height), image.cam_from_world};
  }
  // x = SparsePixel(x' - 0.5) is the same lens with other focal lengths and principal point.
  std::vector<double> params(camera.params().begin(), camera.params().end());
  const auto num_focal_lengths =
      static_cast<size_t>(GetCameraModelInfo(camera.model()).num_focal_lengths);
  for (size_t i = 0; i < num_focal_lengths; ++i) params[i] /= stride;
  for (size_t i = num_focal_lengths; i < num_focal_lengths + 2; ++i) {
    params[i] = (params[i] - SparsePixel(0, stride)) / stride + 0.5;
  }
  return {image.name, Camera(camera.model(), width, height, params), image.cam_from_world};
}

PosedImage ShrunkTo(const PosedImage& image, int max_side_px) {
  RAYLIFT_CHECK(max_side_px > 0);
  const int width = image.camera.width_px(), height = image.camera.height_px();
  const int longer = std::max(width, height);
  if (longer <= max_side_px) return image;
  const auto shrink = [&](int side) {
    return std::max(
        1, static_cast<int>(std::lround(static_cast<double>(side) * max_side_px / longer)));
  };
  return {image.name, image.camera.Scaled(shrink(width), shrink(height)), image.cam_from_world};
}

std::vector<Eigen::Vector2d> GridPixels(const Camera& camera, int count) {
  const double width = camera.width_px(), height = camera.height_px();
  const double cell = std::max(1.0, std::sqrt(width * height / std::max(1, count)));
  std::vector<Eigen::Vector2d> pixels;
  for (double y = cell / 2; y < height; y += cell) {
    for (double x = cell / 2; x < width; x += cell) {
      pixels.emplace_back(std::floor(x) + 0.5, std::floor(y) + 0.5);
    }
  }
  return pixels;
}

std::vector<Eigen::Vector2d> PixelGrid(const Camera& camera, int columns, int rows) {
  std::vector<Eigen::Vector2d> pixels;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      pixels.emplace_back((column + 0.5) * camera.width_px() / columns,
                          (row + 0.5) * camera.height_px() / rows);
    }
  }
  return pixels;
}

}  // namespace raylift
