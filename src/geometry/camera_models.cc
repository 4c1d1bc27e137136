#include "raylift/geometry/camera_models.h"

#include <array>

namespace raylift {
namespace {

using enum CameraModel;

constexpr std::array<CameraModelInfo, 18> kModels = {{
    {kSimplePinhole, "SIMPLE_PINHOLE", 3, 1},
    {kPinhole, "PINHOLE", 4, 2},
    {kSimpleRadial, "SIMPLE_RADIAL", 4, 1},
    {kRadial, "RADIAL", 5, 1},
    {kOpenCv, "OPENCV", 8, 2},
    {kOpenCvFisheye, "OPENCV_FISHEYE", 8, 2},
    {kFullOpenCv, "FULL_OPENCV", 12, 2},
    {kFov, "FOV", 5, 2},
    {kSimpleRadialFisheye, "SIMPLE_RADIAL_FISHEYE", 4, 1},
    {kRadialFisheye, "RADIAL_FISHEYE", 5, 1},
    {kThinPrismFisheye, "THIN_PRISM_FISHEYE", 12, 2},
    {kRadTanThinPrismFisheye, "RAD_TAN_THIN_PRISM_FISHEYE", 16, 2},
    {kSimpleDivision, "SIMPLE_DIVISION", 4, 1},
    {kDivision, "DIVISION", 5, 2},
    {kSimpleFisheye, "SIMPLE_FISHEYE", 3, 1},
    {kFisheye, "FISHEYE", 4, 2},
    {kEucm, "EUCM", 6, 2},
    {kEquirectangular, "EQUIRECTANGULAR", 2, 0},
}};

}  // namespace

std::span<const CameraModelInfo> AllCameraModels() { return kModels; }

const CameraModelInfo& GetCameraModelInfo(CameraModel model) {
  return kModels[static_cast<size_t>(model)];
}

std::optional<CameraModel> CameraModelFromName(std::string_view name) {
  for (const CameraModelInfo& info : kModels) {
    if (info.name == name) {
      return info.model;
    }
  }
  return std::nullopt;
}

std::optional<CameraModel> CameraModelFromId(int id) {
  if (id < 0 || id >= static_cast<int>(kModels.size())) {
    return std::nullopt;
  }
  return static_cast<CameraModel>(id);
}

}  // namespace raylift
