// Which surface points a source gives away: what is seen too obliquely, too far off or at a
// silhouette is lifted badly.

#pragma once

#include <limits>

#include "raylift/base/enum_names.h"
#include "raylift/lifting/geometry_source.h"

namespace raylift {

struct SurfaceLimits {
  enum class BackFaces { kKeep, kDrop };

  double near_z = 0;  // what is closer is not there: a mesh is looked through
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
