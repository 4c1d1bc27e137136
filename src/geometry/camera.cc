#include "raylift/geometry/camera.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

// Returns the model with two focal lengths of which `model` is a special case; its further
// parameters start with those of `model`, zeros follow.
CameraModel WithTwoFocalLengths(CameraModel model) {
  switch (model) {
    case CameraModel::kSimplePinhole:
      return CameraModel::kPinhole;
    case CameraModel::kSimpleRadial:
    case CameraModel::kRadial:
      return CameraModel::kOpenCv;
    case CameraModel::kSimpleRadialFisheye:
    case CameraModel::kRadialFisheye:
      return CameraModel::kOpenCvFisheye;
    case CameraModel::kSimpleDivision:
      return CameraModel::kDivision;
    case CameraModel::kSimpleFisheye:
      return CameraModel::kFisheye;
    case CameraModel::kPinhole:
    case CameraModel::kOpenCv:
    case CameraModel::kOpenCvFisheye:
    case CameraModel::kFullOpenCv:
    case CameraModel::kFov:
    case CameraModel::kThinPrismFisheye:
    case CameraModel::kRadTanThinPrismFisheye:
    case CameraModel::kDivision:
    case CameraModel::kFisheye:
    case CameraModel::kEucm:
    case CameraModel::kEquirectangular:
      return model;
  }
  return model;
}

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

Camera::Camera(CameraModel model, int width_px, int height_px, std::span<const double> params)
    : model_(model), width_px_(width_px), height_px_(height_px), params_{} {
  const CameraModelInfo& info = GetCameraModelInfo(model);
  const auto num_params = static_cast<size_t>(info.num_params);
  const auto num_focal_lengths = static_cast<size_t>(info.num_focal_lengths);
  if (params.size() != num_params) {
    throw InputError(fmt::format("camera model {}: expected {} parameters, found {}", info.name,
                                 num_params, params.size()));
  }
  if (width_px <= 0 || height_px <= 0) {
    throw InputError(fmt::format("camera model {}: expected a positive image size, found {} x {}",
                                 info.name, width_px, height_px));
  }
  for (size_t i = 0; i < params.size(); ++i) {
    if (!std::isfinite(params[i])) {
      throw InputError(
          fmt::format("camera model {}: expected finite parameters, found {} as number {}",
                      info.name, params[i], i + 1));
    }
  }
  const bool is_panorama = num_focal_lengths == 0;
  for (size_t i = 0; i < (is_panorama ? num_params : num_focal_lengths); ++i) {
    if (params[i] <= 0) {
      throw InputError(fmt::format("camera model {}: expected a positive {}, found {}", info.name,
                                   is_panorama ? "width and height" : "focal length", params[i]));
    }
  }
  std::copy(params.begin(), params.end(), params_.begin());
  if (is_panorama) {
    focal_px_ = {params[0] / (2 * std::numbers::pi), params[1] / std::numbers::pi};
    principal_point_px_ = {0.5 * params[0], 0.5 * params[1]};
    lens_ = Lens(model, {});
    return;
  }
  focal_px_ = {params[0], params[num_focal_lengths - 1]};
  principal_point_px_ = {params[num_focal_lengths], params[num_focal_lengths + 1]};
  lens_ = Lens(model, params.subspan(num_focal_lengths + 2));
}

std::optional<Eigen::Vector2d> Camera::ImgFromCam(const Eigen::Vector3d& point_in_cam) const {
  const auto distorted = lens_.Project(point_in_cam);
  if (!distorted) return std::nullopt;
  return focal_px_.cwiseProduct(*distorted) + principal_point_px_;
}

std::optional<Camera::Projection> Camera::ImgFromCamWithJacobian(
    const Eigen::Vector3d& point_in_cam) const {
  const auto projection = lens_.ProjectWithJacobian(point_in_cam);
  if (!projection) return std::nullopt;
  return Projection{focal_px_.cwiseProduct(projection->distorted) + principal_point_px_,
                    focal_px_.asDiagonal() * projection->jacobian};
}

std::optional<Eigen::Vector3d> Camera::RayInCam(const Eigen::Vector2d& pixel) const {
  return lens_.Unproject((pixel - principal_point_px_).cwiseQuotient(focal_px_));
}

bool Camera::Contains(const Eigen::Vector2d& pixel) const {
  return pixel.x() >= 0 && pixel.y() >= 0 && pixel.x() <= width_px_ && pixel.y() <= height_px_;
}

Camera Camera::Scaled(int new_width_px, int new_height_px) const {
  const double ratio_x = static_cast<double>(new_width_px) / width_px_;
  const double ratio_y = static_cast<double>(new_height_px) / height_px_;
  if (is_panorama()) {
    const std::array<double, 2> size = {params_[0] * ratio_x, params_[1] * ratio_y};
    return {model_, new_width_px, new_height_px, size};
  }
  const CameraModel model = ratio_x == ratio_y ? model_ : WithTwoFocalLengths(model_);
  const CameraModelInfo& info = GetCameraModelInfo(model);
  std::vector<double> scaled(static_cast<size_t>(info.num_params));
  const auto num_focal_lengths = static_cast<size_t>(info.num_focal_lengths);
  scaled[0] = focal_x_px() * ratio_x;
  scaled[num_focal_lengths - 1] = focal_y_px() * ratio_y;
  scaled[num_focal_lengths] = principal_point_px_.x() * ratio_x;
  scaled[num_focal_lengths + 1] = principal_point_px_.y() * ratio_y;
  const auto lens_params =
      params().subspan(static_cast<size_t>(GetCameraModelInfo(model_).num_focal_lengths) + 2);
  std::copy(lens_params.begin(), lens_params.end(),
            scaled.begin() + static_cast<std::ptrdiff_t>(num_focal_lengths) + 2);
  return {model, new_width_px, new_height_px, scaled};
}

std::string Camera::ToString() const {
  std::string text =
      fmt::format("{} {} {}", GetCameraModelInfo(model_).name, width_px_, height_px_);
  for (const double param : params()) text += ' ' + FormatDouble(param);
  return text;
}

std::span<const CameraModelInfo> AllCameraModels() { return kModels; }

const CameraModelInfo& GetCameraModelInfo(CameraModel model) {
  return kModels[static_cast<size_t>(model)];
}

std::optional<CameraModel> CameraModelFromName(std::string_view name) {
  for (const CameraModelInfo& info : kModels) {
    if (info.name == name) return info.model;
  }
  return std::nullopt;
}

std::optional<CameraModel> CameraModelFromId(int id) {
  if (id < 0 || id >= static_cast<int>(kModels.size())) return std::nullopt;
  return static_cast<CameraModel>(id);
}

}  // namespace raylift
