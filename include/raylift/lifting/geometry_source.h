// A source of scene geometry: it says which 3D point a pixel of a reference photograph shows.

#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "raylift/scene/photographs.h"

namespace raylift {

// Where the ray of a pixel meets the scene, and how far that can be trusted.
struct SurfacePoint {
  Eigen::Vector3d point_in_world;
  // Unit, turned toward the camera; straight at it where the source does not know the surface.
  Eigen::Vector3d normal_in_world;
  double depth_z;        // along the reference's optical axis (Camera::DepthOf), scene units
  double incidence_deg;  // angle between the normal and the ray back to the camera
  bool back_face;        // the surface was met from behind (by its winding)
  // The largest relative difference of depth, close around the keypoint, between what is there and
  // the point's plane: near a silhouette it is large, in the middle of a slanted wall it is not.
  // None where the source did not look.
  std::optional<double> depth_jump = std::nullopt;
  // Of a triangulated point.
  struct Track {
    size_t length = 0;               // images that observe it
    std::optional<double> error_px;  // its mean reprojection error in them
  };
  std::optional<Track> track = std::nullopt;
  // Standard deviation in scene units (isotropic), where the source knows it.
  std::optional<double> point_sigma = std::nullopt;
};

class GeometrySource {
 public:
  virtual ~GeometrySource() = default;

  // For messages and diagnostics, e.g. "mesh:room.ply".
  virtual std::string Description() const = 0;

  // The surface points of a batch of pixels of one reference, in order; none where the source has
  // no surface. Thread safe.
  virtual std::vector<std::optional<SurfacePoint>> Lift(
      const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const = 0;
};

}  // namespace raylift
