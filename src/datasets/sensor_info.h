// The metadata that SensReader writes beside the frames of an RGB-D sensor: info.txt of 12 Scenes,
// _info.txt of ScanNet. Private to datasets.

#pragma once

#include <filesystem>

#include "raylift/geometry/camera.h"

namespace raylift {

// The color camera. InputError naming file and key for anything else.
Camera ReadColorCamera(const std::filesystem::path& info);

// A PINHOLE whose center is counted from the center of the first pixel, as SensReader does
// (sensorData.h projects to whole pixels): half a pixel more here.
Camera CameraOfSensor(int width_px, int height_px, double fx, double fy, double cx, double cy);

}  // namespace raylift
