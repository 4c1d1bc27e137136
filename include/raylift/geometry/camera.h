// A camera's intrinsics: the projection of points to pixels and its inverse, from pixels to rays.
// The frame is COLMAP's: x right, y down, z forward; pixels are COLMAP's, too: the center of the
// first pixel is (0.5, 0.5).
//
// A panorama (EQUIRECTANGULAR) sees all directions: azimuth from x / width and elevation from y /
// height, z in the middle of the image. Its focal lengths are in pixels per radian.

#pragma once

#include <array>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include <Eigen/Core>

namespace raylift {

// The camera models of COLMAP (src/colmap/sensor/models.h): names, ids and parameters, in COLMAP's
// order, since every format of the field uses them.
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
  // 1 for f, 2 for fx fy, before the principal point; 0 for a panorama, which has neither.
  int num_focal_lengths;
};

// Returns all models, in the order of their ids.
std::span<const CameraModelInfo> AllCameraModels();
const CameraModelInfo& GetCameraModelInfo(CameraModel model);
std::optional<CameraModel> CameraModelFromName(std::string_view name);
std::optional<CameraModel> CameraModelFromId(int id);

// A lens is what precedes focal lengths and principal point on a point's way to a pixel: the point
// is projected to two coordinates (on the plane z = 1, or by its angle for fisheye lenses) and
// distorted. All of COLMAP's models fit one normal form:
//
//   u = projection(point),  q = |u|^2,
//   x = u (1 + n1 q + ... + n6 q^6) / (1 + d1 q + d2 q^2 + d3 q^3),
//   distorted = x + tangential(y) + prism(y),
//
// where y = u, or y = x for RAD_TAN_THIN_PRISM_FISHEYE. A panorama's two coordinates are azimuth
// and elevation (downward), in radians.
//
// The valid domain is where this is one-to-one: |u| below the first radius at which |x| stops
// growing with |u|, and the Jacobian of the distortion positive all the way from the axis. For the
// plane z must be positive; fisheye, division and unified lenses may see beyond 90 degrees off the
// axis, and a panorama everywhere.
class Lens {
 public:
  // Makes the lens of a pinhole.
  Lens() = default;

  // Takes the model's parameters behind focal lengths and principal point; they must be finite and
  // of the right count.
  Lens(CameraModel model, std::span<const double> params);

  // Returns the distorted coordinates of a point; nullopt outside the valid domain.
  std::optional<Eigen::Vector2d> Project(const Eigen::Vector3d& point_in_cam) const;

  struct Projection {
    Eigen::Vector2d distorted;
    Eigen::Matrix<double, 2, 3> jacobian;  // d distorted / d point_in_cam
  };
  std::optional<Projection> ProjectWithJacobian(const Eigen::Vector3d& point_in_cam) const;

  // Returns the unit ray that projects to `distorted`; nullopt outside the image of the valid
  // domain.
  std::optional<Eigen::Vector3d> Unproject(const Eigen::Vector2d& distorted) const;

 private:
  // A point becomes two coordinates by (x, y) / z; angle * (x, y) / |(x, y)|; or the division
  // model's (x, y) r with r so that (u, 1 + k |u|^2) is parallel to the point; the unified model's
  // (x, y) / (alpha rho + (1 - alpha) z) with rho^2 = beta (x^2 + y^2) + z^2; azimuth and
  // elevation.
  enum class ProjectionType { kPerspective, kEquidistant, kDivision, kUnified, kPanorama };
  enum class Radial { kNone, kRational, kFov };
  // The tangential and thin prism terms are functions of the projected point u or of x.
  enum class NonRadial { kNone, kOfProjected, kOfRadial };

  struct Scale {
    double value;
    double slope;  // d value / d squared radius
  };
  struct Distortion {
    Eigen::Vector2d distorted;
    Eigen::Matrix2d jacobian;
  };

  void LimitRadialDomain();
  void LimitNonRadialDomain();

  double UnifiedRho(const Eigen::Vector3d& point) const;
  std::optional<Eigen::Vector2d> ApplyProjection(const Eigen::Vector3d& point) const;
  Eigen::Matrix<double, 2, 3> ProjectionJacobian(const Eigen::Vector3d& point,
                                                 const Eigen::Vector2d& projected) const;
  Eigen::Vector3d InvertProjection(const Eigen::Vector2d& projected) const;

  Scale RationalScale(double squared_radius) const;
  Scale FovScale(double squared_radius) const;
  Distortion RadialPart(const Eigen::Vector2d& projected) const;
  Distortion NonRadialPart(const Eigen::Vector2d& point) const;
  Distortion Distort(const Eigen::Vector2d& projected) const;
  Eigen::Vector2d GridPoint(int direction, int radius) const;
  bool IsInDomain(const Eigen::Vector2d& projected) const;

  std::optional<Eigen::Vector2d> Undistort(const Eigen::Vector2d& distorted) const;
  double UndistortRadius(double distorted_radius) const;
  Eigen::Vector2d NearestOnGrid(const Eigen::Vector2d& distorted) const;
  std::optional<Eigen::Vector2d> UndistortByNewton(const Eigen::Vector2d& start,
                                                   const Eigen::Vector2d& distorted) const;

  ProjectionType projection_type_ = ProjectionType::kPerspective;
  Radial radial_ = Radial::kNone;
  NonRadial non_radial_ = NonRadial::kNone;
  std::array<double, 6> numerator_ = {};    // of q, q^2, ...; before them a 1
  std::array<double, 3> denominator_ = {};  // likewise
  size_t num_numerator_terms_ = 0;
  size_t num_denominator_terms_ = 0;
  std::array<double, 2> tangential_ = {};  // OpenCV's p1 p2
  std::array<double, 2> prism_x_ = {};     // of |y|^2, |y|^4
  std::array<double, 2> prism_y_ = {};     // likewise
  double fov_omega_ = 0;
  double division_k_ = 0;
  double unified_alpha_ = 0;
  double unified_beta_ = 1;
  double safe_radius_ = std::numeric_limits<double>::infinity();  // of u: all below it is valid
  double max_radius_ = std::numeric_limits<double>::infinity();   // of u, excluded
  double max_distorted_radius_ = std::numeric_limits<double>::infinity();  // of x, excluded
};

class Camera {
 public:
  // Makes a 1 x 1 pinhole camera, so that a Camera can stand in a container.
  Camera() = default;

  // Throws InputError (without a file: add it at the border) if the count of parameters is wrong,
  // a parameter is not finite, a focal length (or a panorama's size) is not positive or the size is
  // not positive.
  Camera(CameraModel model, int width_px, int height_px, std::span<const double> params);

  // Returns a panorama of all directions that fills its image.
  static Camera Panorama(int width_px, int height_px) {
    const std::array<double, 2> size = {static_cast<double>(width_px),
                                        static_cast<double>(height_px)};
    return {CameraModel::kEquirectangular, width_px, height_px, size};
  }

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

  // Returns the unit ray through a pixel, by Newton's method, so that ImgFromCam(ray) is the pixel
  // within 1e-10 px times the focal length's order. nullopt if the pixel is outside the model's
  // valid domain (for instance beyond the radius at which barrel distortion folds over).
  std::optional<Eigen::Vector3d> RayInCam(const Eigen::Vector2d& pixel) const;

  // Returns the depth of a point: z, or the distance for a panorama.
  double DepthOf(const Eigen::Vector3d& point_in_cam) const {
    return is_panorama() ? point_in_cam.norm() : point_in_cam.z();
  }

  // Returns whether the pixel lies in the image rectangle [0, width] x [0, height].
  bool Contains(const Eigen::Vector2d& pixel) const;

  // Returns the same lens for an image whose sides are scaled: principal point, focal lengths and
  // size are multiplied by the ratios. COLMAP's pixel convention makes this exact (no half-pixel
  // shift). Where the ratios differ, a model with one focal length becomes its sibling with two.
  Camera Scaled(int new_width_px, int new_height_px) const;

  // Returns "MODEL width height params...", as in COLMAP's cameras.txt and hloc's query lists.
  std::string ToString() const;

  // Returns whether model, size and parameters are the same.
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
