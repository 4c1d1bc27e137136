// A camera's intrinsics: which pixel a point in front of the camera falls on, and which ray leaves
// through a pixel. The frame is COLMAP's: x right, y down, z forward; pixels are COLMAP's, too: the
// center of the first pixel is (0.5, 0.5).
//
// A panorama (EQUIRECTANGULAR) sees all directions: azimuth from x / width and elevation from
// y / height, z in the middle of the image. What stands for its focal lengths are pixels per
// radian.

#pragma once

#include <array>
#include <optional>
#include <span>
#include <string>

#include <Eigen/Core>

#include "raylift/geometry/lens.h"

namespace raylift {

class Camera {
 public:
  // A 1 x 1 pinhole camera, so that a Camera can stand in a container.
  Camera() = default;

  // Throws InputError (without a file: add it at the border) if the count of parameters is wrong,
  // a parameter is not finite, a focal length (or a panorama's size) is not positive or the size is
  // not positive.
  Camera(CameraModel model, int width_px, int height_px, std::span<const double> params);

  CameraModel model() const { return model_; }
  int width_px() const { return width_px_; }
  int height_px() const { return height_px_; }
  std::span<const double> params() const {
    return {params_.data(), static_cast<size_t>(GetCameraModelInfo(model_).num_params)};
  }
  bool is_panorama() const { return model_ == CameraModel::kEquirectangular; }
  double focal_x_px() const { return focal_px_.x(); }
  double focal_y_px() const { return focal_px_.y(); }
  double MeanFocalPx() const { return 0.5 * (focal_x_px() + focal_y_px()); }
  Eigen::Vector2d principal_point_px() const { return principal_point_px_; }

  // Returns the pixel of a point; nullopt if the point is behind the camera (or at its center) or
  // outside the domain in which the model's distortion is one-to-one. The pixel may lie outside the
  // image.
  std::optional<Eigen::Vector2d> ImgFromCam(const Eigen::Vector3d& point_in_cam) const;

  struct Projection {
    Eigen::Vector2d pixel;
    Eigen::Matrix<double, 2, 3> jacobian;  // d pixel / d point_in_cam, analytic
  };
  std::optional<Projection> ImgFromCamWithJacobian(const Eigen::Vector3d& point_in_cam) const;

  // The unit ray through a pixel, by Newton's method, so that ImgFromCam(ray) is the pixel within
  // 1e-10 px times the focal length's order. nullopt if the pixel is outside the model's valid
  // domain (for instance beyond the radius at which barrel distortion folds over).
  std::optional<Eigen::Vector3d> RayInCam(const Eigen::Vector2d& pixel) const;

  // Returns the depth of a point: z, or the distance for a panorama.
  double DepthOf(const Eigen::Vector3d& point_in_cam) const {
    return is_panorama() ? point_in_cam.norm() : point_in_cam.z();
  }

  // Returns whether the pixel lies in the image rectangle [0, width] x [0, height].
  bool Contains(const Eigen::Vector2d& pixel) const;

  // The same lens on an image whose sides are scaled: principal point, focal lengths and size are
  // multiplied by the ratios. COLMAP's pixel convention makes this exact (no half-pixel shift).
  // Where the ratios differ, a model with one focal length becomes its sibling with two.
  Camera Scaled(int new_width_px, int new_height_px) const;

  // "MODEL width height params...", as in COLMAP's cameras.txt and hloc's query lists.
  std::string ToString() const;

  // The same model, size and parameters.
  bool operator==(const Camera& other) const {
    return model_ == other.model_ && width_px_ == other.width_px_ &&
           height_px_ == other.height_px_ && params_ == other.params_;
  }

 private:
  CameraModel model_ = CameraModel::kPinhole;
  int width_px_ = 1;
  int height_px_ = 1;
  std::array<double, kMaxCameraParams> params_ = {1, 1, 0.5, 0.5};
  // The parameters, unpacked once for every projection.
  Eigen::Vector2d focal_px_ = {1, 1};
  Eigen::Vector2d principal_point_px_ = {0.5, 0.5};
  Lens lens_;
};

}  // namespace raylift
