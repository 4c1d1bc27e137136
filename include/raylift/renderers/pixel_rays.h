// The rays through all pixel centers of a picture. They depend on the lens alone, so that one table
// serves all views of a camera and the costly inversion of a distorted lens is done once. A pinhole
// needs one slope per column and row instead of a table.

#pragma once

#include <array>
#include <optional>
#include <vector>

#include "raylift/geometry/camera.h"
#include "raylift/renderers/ray_caster.h"

namespace raylift {

class PixelRays {
 public:
  // Tabulates the rays. In a panorama column x + 0.5 looks at the azimuth 2 pi ((x + 0.5) / width -
  // 0.5) from z toward x, row y + 0.5 at the elevation pi (0.5 - (y + 0.5) / height), up being -y.
  PixelRays(const Camera& camera, int threads);

  int width_px() const { return camera_.width_px(); }
  int height_px() const { return camera_.height_px(); }
  bool is_panorama() const { return camera_.is_panorama(); }

  // Returns the unit ray through the center of a pixel in the camera's frame, in double; nullopt
  // where the lens has none.
  std::optional<Eigen::Vector3d> RayInCam(int x, int y) const;

  // Returns whether the rays are those of a lens without distortion. Then they are (x slope of the
  // column, y slope of the row, 1) in the camera's frame, and their z is 1 instead of their length.
  bool is_pinhole() const { return !column_slopes_.empty(); }

  // Return a pinhole's slopes: the x slopes of the pixels (4 bx, ...) ... (4 bx + 3, ...), and the
  // y slopes of the pixels (..., 4 by) ... (..., 4 by + 3), in the order of a RayBlock. They are
  // NaN outside of the picture.
  using Slopes = std::array<float, RayBlock::kSize>;
  const Slopes& ColumnSlopes(int bx) const { return column_slopes_[static_cast<size_t>(bx)]; }
  const Slopes& RowSlopes(int by) const { return row_slopes_[static_cast<size_t>(by)]; }

  // Returns, for any other camera, the unit rays of the pixels (4 bx, 4 by) ... (4 bx + 3, 4 by +
  // 3); of zero length where the lens has none, and outside the picture.
  const RayBlock& Block(int bx, int by) const {
    return blocks_[static_cast<size_t>(by) * static_cast<size_t>(blocks_per_row_) +
                   static_cast<size_t>(bx)];
  }

  // Returns the unit ray of a pixel of any camera, in float; zero where there is none.
  Eigen::Vector3f UnitRay(int x, int y) const;

  // The change of the unit ray from one pixel to the next, for textures.
  struct Differential {
    Eigen::Vector3f along_x = Eigen::Vector3f::Zero();
    Eigen::Vector3f along_y = Eigen::Vector3f::Zero();

    double SolidAngle() const { return double{along_x.cross(along_y).norm()}; }
  };
  Differential DifferentialAt(int x, int y) const;

  size_t MemoryBytes() const {
    return blocks_.size() * sizeof(RayBlock) +
           (column_slopes_.size() + row_slopes_.size()) * sizeof(Slopes);
  }

 private:
  void MakeSlopes();
  void MakeBlocks(int threads);
  int NumBlockRows() const;

  Camera camera_;
  int blocks_per_row_;
  std::vector<RayBlock> blocks_;       // empty for a pinhole
  std::vector<Slopes> column_slopes_;  // empty for any other camera
  std::vector<Slopes> row_slopes_;
};

}  // namespace raylift
