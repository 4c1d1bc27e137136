#include "diagnosis/depth_misalignment.h"

#include <cmath>
#include <numbers>
#include <string>

#include "lifting/depth_sampling.h"

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/geometry/rigid3.h"

namespace raylift {

void DepthMisalignment::Validate() const {
  RequirePositive("zoom", zoom);
  const auto require_finite = [](const char* name, double value) {
    if (!std::isfinite(value)) throw OptionError(name, FormatDouble(value), "must be finite");
  };
  for (const double value : shift_px) require_finite("shift", value);
  for (const double value : rotation_deg) require_finite("rotate", value);
  require_finite("lens", lens);
}

bool DepthMisalignment::IsNone() const {
  return shift_px.isZero(0) && zoom == 1 && lens == 0 && rotation_deg.isZero(0);
}

DepthMap MisalignDepth(const DepthMap& map, const Camera& camera,
                       const DepthMisalignment& misalignment) {
  if (misalignment.IsNone()) return map;
  const Camera seen = camera.Scaled(map.width_px, map.height_px);
  const Eigen::Vector2d shift_px(misalignment.shift_px.x() * map.width_px / camera.width_px(),
                                 misalignment.shift_px.y() * map.height_px / camera.height_px());
  const Eigen::Vector2d center = seen.principal_point_px();
  const Eigen::Quaterniond cam_from_map_camera =
      RotationFromVector(misalignment.rotation_deg * (std::numbers::pi / 180));
  const bool is_turned = !misalignment.rotation_deg.isZero(0);
  DepthMap result{map.width_px, map.height_px, std::vector<float>(map.z.size(), 0.0F)};
  size_t i = 0;
  for (int y = 0; y < map.height_px; ++y) {
    for (int x = 0; x < map.width_px; ++x, ++i) {
      Eigen::Vector2d pixel = Eigen::Vector2d(x + 0.5, y + 0.5) - shift_px;
      pixel = center + (pixel - center) / misalignment.zoom;
      const double squared = (pixel - center).squaredNorm() / std::pow(seen.MeanFocalPx(), 2);
      pixel = center + (pixel - center) * (1 + misalignment.lens * squared);
      double z_ratio = 1;  // of the misaligned camera's depth to the camera's
      if (is_turned) {
        const auto ray = seen.RayInCam(pixel);
        if (!ray || !(ray->z() > 0)) continue;
        const Eigen::Vector3d turned = cam_from_map_camera * *ray;
        const auto projected = seen.ImgFromCam(turned);
        if (!projected || !(turned.z() > 0)) continue;
        pixel = *projected;
        z_ratio = ray->z() / turned.z();
      }
      if (const auto sample = SampleDepth(map, pixel, {})) {
        result.z[i] = static_cast<float>(sample->z * z_ratio);
      }
    }
  }
  return result;
}

}  // namespace raylift
