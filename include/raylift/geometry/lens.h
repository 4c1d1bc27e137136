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

#pragma once

#include <array>
#include <limits>
#include <optional>
#include <span>
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
  // 1: f; 2: fx fy. They come first, the principal point follows. 0: a panorama, which has neither.
  int num_focal_lengths;
};

// All models, in the order of their ids.
std::span<const CameraModelInfo> AllCameraModels();
const CameraModelInfo& GetCameraModelInfo(CameraModel model);
std::optional<CameraModel> CameraModelFromName(std::string_view name);
std::optional<CameraModel> CameraModelFromId(int id);

class Lens {
 public:
  // A pinhole.
  Lens() = default;

  // `params` are the model's, behind focal lengths and principal point; finite, of the right count.
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

}  // namespace raylift
