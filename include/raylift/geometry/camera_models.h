// The camera models of COLMAP (src/colmap/sensor/models.h): names, ids and parameters, in COLMAP's
// order, since every format of the field uses them.

#pragma once

#include <optional>
#include <span>
#include <string_view>

namespace raylift {

// The values are COLMAP's model ids.
enum class CameraModel {
  kSimplePinhole = 0,            // f cx cy
  kPinhole = 1,                  // fx fy cx cy
  kSimpleRadial = 2,             // f cx cy k
  kRadial = 3,                   // f cx cy k1 k2
  kOpenCv = 4,                   // fx fy cx cy k1 k2 p1 p2
  kOpenCvFisheye = 5,            // fx fy cx cy k1 k2 k3 k4
  kFullOpenCv = 6,               // fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6
  kFov = 7,                      // fx fy cx cy omega
  kSimpleRadialFisheye = 8,      // f cx cy k
  kRadialFisheye = 9,            // f cx cy k1 k2
  kThinPrismFisheye = 10,        // fx fy cx cy k1 k2 p1 p2 k3 k4 sx1 sy1
  kRadTanThinPrismFisheye = 11,  // fx fy cx cy k0 k1 k2 k3 k4 k5 p0 p1 s0 s1 s2 s3
  kSimpleDivision = 12,          // f cx cy k
  kDivision = 13,                // fx fy cx cy k
  kSimpleFisheye = 14,           // f cx cy
  kFisheye = 15,                 // fx fy cx cy
  kEucm = 16,                    // fx fy cx cy alpha beta (COLMAP 4.1)
  kEquirectangular = 17,         // w h: a panorama of all directions (COLMAP 4.1)
};

inline constexpr int kMaxCameraParams = 16;

struct CameraModelInfo {
  CameraModel model;
  std::string_view name;  // COLMAP's, e.g. "SIMPLE_RADIAL"
  int num_params;
  // 1: f; 2: fx fy. They come first, the principal point follows. 0: a panorama, which has neither.
  int num_focal_lengths;
};

// All models, in the order of their ids.
std::span<const CameraModelInfo> AllCameraModels();
const CameraModelInfo& GetCameraModelInfo(CameraModel model);
std::optional<CameraModel> CameraModelFromName(std::string_view name);
std::optional<CameraModel> CameraModelFromId(int id);

}  // namespace raylift
