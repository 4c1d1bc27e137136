#include "estimation/solvers/gp3p.h"

#include <cmath>
#include <cstddef>
#include <optional>

#include "estimation/solvers/polynomial_roots.h"
#include <Eigen/Geometry>
#include <Eigen/LU>

namespace raylift {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Coefficients by ascending powers.
template <int kDegree>
using Polynomial = std::array<double, static_cast<size_t>(kDegree + 1)>;

template <size_t A, size_t B>
std::array<double, A + B - 1> operator*(const std::array<double, A>& a,
                                        const std::array<double, B>& b) {
  std::array<double, A + B - 1> product{};
  for (size_t i = 0; i < A; ++i) {
    for (size_t k = 0; k < B; ++k) product[i + k] += a[i] * b[k];
  }
  return product;
}
template <size_t N>
std::array<double, N> operator*(double factor, std::array<double, N> a) {
  for (double& c : a) c *= factor;
  return a;
}
template <size_t N>
std::array<double, N> operator+(std::array<double, N> a, const std::array<double, N>& b) {
  for (size_t i = 0; i < N; ++i) a[i] += b[i];
  return a;
}
template <size_t N>
std::array<double, N> operator-(const std::array<double, N>& a, const std::array<double, N>& b) {
  return a + -1.0 * b;
}
template <size_t N>
double At(const std::array<double, N>& a, double x) {
  double value = 0;
  for (size_t i = N; i-- > 0;) value = value * x + a[i];
  return value;
}

// The distance of two points, of which the first lies x along its ray and the second y:
//   x^2 + y^2 + xy * x y + x * x + y * y + constant = 0.
struct DistanceEquation {
  double xy, by_x, by_y, constant;

  DistanceEquation(const Vector3d& from_second_center, const Vector3d& first_ray,
                   const Vector3d& second_ray, double squared_distance)
      : xy(-2 * first_ray.dot(second_ray)),
        by_x(2 * first_ray.dot(from_second_center)),
        by_y(-2 * second_ray.dot(from_second_center)),
        constant(from_second_center.squaredNorm() - squared_distance) {}

  // As a quadratic y^2 + Linear(x) y + Constant(x).
  Polynomial<1> Linear() const { return {by_y, xy}; }
  Polynomial<2> Constant() const { return {constant, by_x, 1}; }

  double Value(double x, double y) const {
    return x * x + y * y + xy * x * y + by_x * x + by_y * y + constant;
  }
  double SlopeByX(double x, double y) const { return 2 * x + xy * y + by_x; }
  double SlopeByY(double x, double y) const { return 2 * y + xy * x + by_y; }
};

struct TriangleOfRays {
  DistanceEquation e12, e13, e23;

  Vector3d Values(const Vector3d& x) const {
    return {e12.Value(x[0], x[1]), e13.Value(x[0], x[2]), e23.Value(x[1], x[2])};
  }

  // Newton's method; none where it ends elsewhere than at a solution in front of the cameras.
  std::optional<Vector3d> Polished(Vector3d x) const {
    constexpr int kSteps = 5;
    constexpr double kSolved = 1e-10;
    for (int i = 0; i < kSteps; ++i) {
      Matrix3d slopes;
      slopes << e12.SlopeByX(x[0], x[1]), e12.SlopeByY(x[0], x[1]), 0, e13.SlopeByX(x[0], x[2]), 0,
          e13.SlopeByY(x[0], x[2]), 0, e23.SlopeByX(x[1], x[2]), e23.SlopeByY(x[1], x[2]);
      const Vector3d step = slopes.inverse() * Values(x);
      if (!step.allFinite()) break;
      x -= step;
      if (step.squaredNorm() < 1e-24 * x.squaredNorm()) break;
    }
    const double size = 1 + x.squaredNorm();
    if (!(Values(x).norm() < kSolved * size) || !(x.minCoeff() > 0)) return std::nullopt;
    return x;
  }
};

// Right-handed axes of a triangle: along its first side, in its plane, across.
Matrix3d AxesOf(const Vector3d& first_side, const Vector3d& second_side) {
  Matrix3d axes;
  axes.col(0) = first_side.normalized();
  axes.col(2) = first_side.cross(second_side).normalized();
  axes.col(1) = axes.col(2).cross(axes.col(0));
  return axes;
}

}  // namespace

int SolveGeneralizedP3p(const std::array<Vector3d, 3>& centers, const std::array<Vector3d, 3>& rays,
                        const std::array<Vector3d, 3>& points_in_world,
                        std::span<SolverPose, kMaxGeneralizedP3pSolutions> poses) {
  const Vector3d side12 = points_in_world[1] - points_in_world[0];
  const Vector3d side13 = points_in_world[2] - points_in_world[0];
  const Vector3d side23 = points_in_world[2] - points_in_world[1];
  const double squares = side12.squaredNorm() + side13.squaredNorm() + side23.squaredNorm();
  if (!(side12.cross(side13).squaredNorm() > 1e-20 * squares * squares)) return 0;
  // The unit is about how far away the points are.
  const double angles2 = (rays[0] - rays[1]).squaredNorm() + (rays[0] - rays[2]).squaredNorm() +
                         (rays[1] - rays[2]).squaredNorm();
  const double scale = std::sqrt(squares / angles2);
  if (!std::isfinite(scale)) return 0;
  const auto equation = [&](size_t first, size_t second, const Vector3d& side) {
    return DistanceEquation((centers[first] - centers[second]) / scale, rays[first], rays[second],
                            side.squaredNorm() / (scale * scale));
  };
  const TriangleOfRays triangle = {equation(0, 1, side12), equation(0, 2, side13),
                                   equation(1, 2, side23)};
  const auto& [e12, e13, e23] = triangle;

  // e12 + e13 - e23 holds no square of the second and third unknowns, y and z:
  //   (n0 + n1 y) + (m0 + m1 y) z = 0, with polynomials of the first, x.
  const Polynomial<2> n0 = {e12.constant + e13.constant - e23.constant, e12.by_x + e13.by_x, 2};
  const Polynomial<1> n1 = {e12.by_y - e23.by_x, e12.xy};
  const Polynomial<1> m0 = {e13.by_y - e23.by_y, e13.xy};
  const Polynomial<0> m1 = {-e23.xy};
  // With this z, e13 is f0 + f1 y + f2 y^2 = 0,
  const Polynomial<1> b13 = e13.Linear();
  const Polynomial<2> c13 = e13.Constant();
  const Polynomial<4> f0 = n0 * n0 - b13 * (n0 * m0) + c13 * (m0 * m0);
  const Polynomial<3> f1 = 2.0 * (n0 * n1) - b13 * (n0 * m1 + n1 * m0) + 2.0 * (c13 * (m0 * m1));
  const Polynomial<2> f2 = n1 * n1 - b13 * (n1 * m1) + c13 * (m1 * m1);
  // and by e12, which has y^2, p y + q = 0,
  const Polynomial<1> b12 = e12.Linear();
  const Polynomial<2> c12 = e12.Constant();
  const Polynomial<3> p = f1 - f2 * b12;
  const Polynomial<4> q = f0 - f2 * c12;
  // and that again in e12 leaves x alone.
  const Polynomial<8> of_x = q * q - b12 * (p * q) + c12 * (p * p);
  std::array<double, 8> roots;
  const int num_roots = RealRoots<8>(of_x, roots);

  const Matrix3d axes_in_world = AxesOf(side12, side13);
  int count = 0;
  for (int i = 0; i < num_roots; ++i) {
    const double x = roots[static_cast<size_t>(i)];
    if (!(x > 0)) continue;
    const double y = -At(q, x) / At(p, x);
    const double z = -(At(n0, x) + At(n1, x) * y) / (At(m0, x) + m1[0] * y);
    const auto along = triangle.Polished({x, y, z});
    if (!along) continue;
    std::array<Vector3d, 3> points_in_rig;
    for (size_t k = 0; k < 3; ++k) {
      points_in_rig[k] = centers[k] + scale * (*along)[static_cast<Eigen::Index>(k)] * rays[k];
    }
    SolverPose& pose = poses[static_cast<size_t>(count)];
    pose.rotation =
        AxesOf(points_in_rig[1] - points_in_rig[0], points_in_rig[2] - points_in_rig[0]) *
        axes_in_world.transpose();
    pose.translation = points_in_rig[0] - pose.rotation * points_in_world[0];
    if (pose.rotation.allFinite() && pose.translation.allFinite()) ++count;
  }
  return count;
}

}  // namespace raylift
