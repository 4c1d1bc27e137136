// A source of scene geometry gives the 3D point that a pixel of a reference photograph shows.

#pragma once

#include <cstddef>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "raylift/base/enum_names.h"
#include "raylift/scene/image.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// The point in which the ray of a pixel meets the scene, and its quality.
struct SurfacePoint {
  Eigen::Vector3d point_in_world;
  // Unit normal, turned toward the camera; it points straight at the camera where the source does
  // not know the surface.
  Eigen::Vector3d normal_in_world;
  double depth_z;        // along the reference's optical axis (Camera::DepthOf), scene units
  double incidence_deg;  // angle between the normal and the ray back to the camera
  bool back_face;        // the surface was met from behind (by its winding)
  // The largest relative difference of depth, close around the keypoint, between the scene and the
  // point's plane: large near a silhouette, small in the middle of a slanted wall. nullopt where
  // the source did not measure it.
  std::optional<double> depth_jump = std::nullopt;
  // The track of a triangulated point.
  struct Track {
    size_t length = 0;               // images that observe it
    std::optional<double> error_px;  // its mean reprojection error in them
  };
  std::optional<Track> track = std::nullopt;
  // Standard deviation in scene units (isotropic), where the source knows it.
  std::optional<double> point_sigma = std::nullopt;
  // Standard deviation of ln(distance) along the ray, where it was learned from confidences.
  std::optional<double> log_depth_sigma = std::nullopt;
};

class GeometrySource {
 public:
  virtual ~GeometrySource() = default;

  // Returns a name for messages and diagnostics, e.g. "mesh:room.ply".
  virtual std::string Description() const = 0;

  // Returns the surface points of a batch of pixels of one reference, in order; nullopt where the
  // source has no surface. Thread safe.
  virtual std::vector<std::optional<SurfacePoint>> Lift(
      const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const = 0;
};

// A source seen by a camera at every pixel center: row-major, of the size of the camera.
struct SourceView {
  DepthMap depth;
  std::vector<float> normals_in_world;  // x, y, z per pixel; 0, 0, 0 = not known
  std::vector<float> incidence_deg;     // -1 = not known
};

// Limits on the surface points that a source gives: points that are seen too obliquely, too far
// away or at a silhouette are lifted badly.

struct SurfaceLimits {
  enum class BackFaces { kKeep, kDrop };

  double near_z = 0;  // surfaces that are closer do not count: a mesh is looked through
  double far_z = std::numeric_limits<double>::infinity();
  double max_incidence_deg = 90;
  double max_depth_jump = std::numeric_limits<double>::infinity();
  BackFaces back_faces = BackFaces::kKeep;

  bool Keep(const SurfacePoint& point) const {
    return point.depth_z >= near_z && point.depth_z <= far_z &&
           point.incidence_deg <= max_incidence_deg &&
           point.depth_jump.value_or(0) <= max_depth_jump &&
           !(point.back_face && back_faces == BackFaces::kDrop);
  }
};
template <>
inline constexpr auto kEnumNames<SurfaceLimits::BackFaces> =
    std::to_array<EnumName<SurfaceLimits::BackFaces>>({
        {SurfaceLimits::BackFaces::kKeep, "keep"},
        {SurfaceLimits::BackFaces::kDrop, "drop"},
    });

}  // namespace raylift
