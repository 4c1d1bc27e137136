// Converts stored depth to DepthMap: patterns of file names, presets, orientation, the part of the
// image, units, and the registration of a sensor's map to the photograph.

#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "raylift/io/depth_file.h"
#include "raylift/lifting/depth_source.h"
#include "raylift/scene/image.h"

namespace raylift {

// Returns the convention of who writes such maps; nullopt for an unknown name.
std::optional<DepthConvention> DepthPreset(std::string_view name);
std::string DepthPresetNames();  // "colmap|nerfstudio|..."

// Returns the file that a pattern means, before {time} is looked up. {index} stays where there is
// no index.
std::string ExpandPattern(std::string_view pattern, std::string_view image_name,
                          std::optional<size_t> index = std::nullopt);

// Returns the z component of the unit ray through each pixel's center (for a panorama, whose depth
// is the distance, 1); 0 where there is no ray.
std::vector<float> RayZOfPixels(const Camera& camera);

// Returns what a stored 1 is in scene units (of kInverse: 1 / scene units), the scale included.
double StoredUnit(const StoredDepth& stored, const DepthConvention& convention);

// Returns the samples in the order of the image.
StoredDepth Oriented(StoredDepth stored, MapOrientation orientation);

// Returns the map on the whole photograph: it is 0 where the map has no samples, and those beyond
// are left out. Throws InputError naming the file where the photograph would take more samples than
// a map can have.
StoredDepth OnWholeImage(StoredDepth map, MapFit fit, PlaneSize image,
                         const std::filesystem::path& file_for_messages);

// Returns the map in our convention, for an image with this camera (of any resolution: the
// intrinsics are scaled by the ratio of the sizes). `ray_z` may hold RayZOfPixels of the scaled
// camera, else it is computed where it is needed. `confidence` (may be null) may be of another
// size. Both are already oriented. With a sensor the camera is its own first, and `ray_z` the
// sensor's.
DepthMap ToDepthMap(const StoredDepth& stored, const Camera& camera,
                    const DepthConvention& convention, const StoredDepth* confidence = nullptr,
                    std::span<const float> ray_z = {});

// Warps the depth of a sensor beside the photograph's camera into that camera. Without this every
// point would be off by the cameras' distance and the ratio of their focal lengths.
//
// Returns the sensor's map as `image` sees it, of its size. Neighbors in the map span triangles, so
// planes stay planes, unless their depths jump by more than 5 %; the nearest surface counts.
DepthMap RegisterDepth(const DepthMap& map, const DepthSensor& sensor, const Camera& image);

}  // namespace raylift
