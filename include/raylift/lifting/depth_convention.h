// What the numbers of a folder of depth maps mean. Every pipeline has its own dialect (z or the
// length of the ray, meters or millimeters, holes as 0, 65535 or infinity), and each map is
// converted once, when it is loaded, to the one that everything else knows: DepthMap.

#pragma once

#include <limits>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "raylift/base/enum_names.h"
#include "raylift/geometry/camera.h"
#include "raylift/io/depth_file.h"
#include "raylift/lifting/depth_registration.h"
#include "raylift/scene/image.h"

namespace raylift {

enum class DepthKind {
  kZ,        // along the optical axis
  kRay,      // along the ray of each pixel, from the camera's center
  kInverse,  // 1 / z
};
template <>
inline constexpr auto kEnumNames<DepthKind> = std::to_array<EnumName<DepthKind>>({
    {DepthKind::kZ, "z"},
    {DepthKind::kRay, "ray", "ray length"},
    {DepthKind::kInverse, "inverse", "inverse depth"},
});

// How the samples of a file lie in its image; each undoes itself.
enum class MapOrientation {
  kAsStored,
  kFlippedX,    // left and right exchanged
  kFlippedY,    // the bottom row first
  kHalfTurn,    // both
  kTransposed,  // columns first
};
template <>
inline constexpr auto kEnumNames<MapOrientation> = std::to_array<EnumName<MapOrientation>>({
    {MapOrientation::kAsStored, "as_stored", "as stored"},
    {MapOrientation::kFlippedX, "flipped_x", "left and right exchanged"},
    {MapOrientation::kFlippedY, "flipped_y", "top and bottom exchanged"},
    {MapOrientation::kHalfTurn, "half_turn", "upside down"},
    {MapOrientation::kTransposed, "transposed"},
});

struct DepthConvention {
  DepthKind kind = DepthKind::kZ;
  MapOrientation orientation = MapOrientation::kAsStored;
  // Scene units of a stored 1 (of kInverse: 1 / scene units). None: 1 where the file holds floats,
  // 0.001 (millimeters) where it holds integers.
  std::optional<double> unit = std::nullopt;
  double scale = 1;  // times this, for whole sources whose scale is off
  // Stored values that mean "none"; what is not finite or not positive always does.
  std::vector<double> invalid_values = {};
  double max_depth = std::numeric_limits<double>::infinity();  // scene units; beyond: none

  // Where the map of an image is, relative to the folder, in the order of preference. "{name}" is
  // the image's name in the model, "{dir}" its folder, "{stem}" its file name without extension,
  // "{base}" that up to the first dot, "{flat}" the folder and {base} joined by "_", "{flat7}" the
  // same without the folder's "-", "{time}" the number in the folder nearest to {stem} as seconds
  // (within 20 ms). Empty: the usual ones are tried.
  std::vector<std::string> patterns = {};
  std::string layer = {};   // the channel of an EXR, the key of an NPZ
  bool headerless = false;  // plain floats, of `raw_size` or else of the image's size
  std::optional<PlaneSize> raw_size = std::nullopt;

  // Whose maps these are, where that is not the photograph's camera: they are turned into its own.
  std::optional<DepthSensor> sensor = std::nullopt;

  // A second map that says how far each depth can be trusted; below the threshold there is none.
  std::string confidence_pattern = {};  // empty: there is no such map
  double confidence_threshold = 0.5;    // in stored values
};

// By the name of who writes such maps; none for an unknown name.
std::optional<DepthConvention> DepthPreset(std::string_view name);
std::string DepthPresetNames();  // "colmap|nerfstudio|..."

// The file that a pattern means, before {time} is looked up.
std::string ExpandPattern(std::string_view pattern, std::string_view image_name);

// The z component of the unit ray through each pixel's center (of a panorama, whose depth is the
// distance: 1); 0 where there is no ray.
std::vector<float> RayZOfPixels(const Camera& camera);

// What a stored 1 is in scene units (of kInverse: 1 / scene units), the scale included.
double StoredUnit(const StoredDepth& stored, const DepthConvention& convention);

// The samples as they lie in the image.
StoredDepth Oriented(StoredDepth stored, MapOrientation orientation);

// The map in our convention, for an image with this camera (of any resolution: the intrinsics are
// scaled by the ratio of the sizes). `ray_z` may hold RayZOfPixels of the scaled camera, else it is
// computed where it is needed. `confidence` (may be null) may be of another size. Both
// are already oriented. With a sensor the camera is its own first, and `ray_z` the sensor's.
DepthMap ToDepthMap(const StoredDepth& stored, const Camera& camera,
                    const DepthConvention& convention, const StoredDepth* confidence = nullptr,
                    std::span<const float> ray_z = {});

}  // namespace raylift
