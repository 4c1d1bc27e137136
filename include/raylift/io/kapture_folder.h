// Posed images as a kapture data set (format 1.1), for kapture's tools.

#pragma once

#include <filesystem>
#include <span>

#include "raylift/scene/photographs.h"

namespace raylift {

// Writes sensors.txt, trajectories.txt and records_camera.txt to `folder`/sensors. Equal cameras are
// one sensor; the timestamp of an image is its place. InputError where kapture has no such camera
// model or cannot hold a name; photographs belong to `folder`/sensors/records_data.
void WriteKapture(const std::filesystem::path& folder, std::span<const PosedImage> images);

}  // namespace raylift
