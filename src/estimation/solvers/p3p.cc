#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <optional>

#include "estimation/solvers/minimal_solvers.h"
#include "estimation/solvers/polynomial_roots.h"
#include <Eigen/Geometry>
#include <Eigen/LU>

namespace raylift {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Returns a real root of p3 x^3 + p2 x^2 + p1 x + p0, p3 != 0: the one at which the cubic is
// steepest, which is the best conditioned.
double SteepestCubicRoot(double p3, double p2, double p1, double p0) {
  const double a = p2 / p3;
  const double b = p1 / p3;
  const double c = p0 / p3;
  const double shift = a / 3;
  const double p = b - a * shift;
  const double q = c + shift * (2 * shift * shift - b);
  const double discriminant = q * q / 4 + p * p * p / 27;
  double root = 0;
  if (discriminant > 0) {
    const double s = std::sqrt(discriminant);
    const double u = std::cbrt(q > 0 ? -q / 2 - s : -q / 2 + s);
    root = u - (u != 0 ? p / (3 * u) : 0) - shift;
  } else {
    const double r = std::sqrt(std::max(0.0, -p / 3));
    const double cosine = r > 0 ? std::clamp(-q / (2 * r * r * r), -1.0, 1.0) : 0.0;
    const double angle = std::acos(cosine) / 3;
    double steepest = -1;
    for (int k = 0; k < 3; ++k) {
      const double x = 2 * r * std::cos(angle - 2 * std::numbers::pi * k / 3) - shift;
      const double slope = std::abs((3 * x + 2 * a) * x + b);
      if (slope > steepest) {
        steepest = slope;
        root = x;
      }
    }
  }
  for (int i = 0; i < 2; ++i) {  // the closed forms lose digits; Newton restores them
    const double slope = (3 * root + 2 * a) * root + b;
    if (slope != 0) {
      root -= (((root + a) * root + b) * root + c) / slope;
    }
  }
  return root;
}

struct Quadratic {
  double roots[2];
  int count;
};

// Returns the real roots of x^2 + b x + c.
Quadratic SolveQuadratic(double b, double c) {
  const double discriminant = b * b - 4 * c;
  if (!(discriminant >= 0)) {
    return {{0, 0}, 0};
  }
  const double s = std::sqrt(discriminant);
  const double q = -0.5 * (b < 0 ? b - s : b + s);
  return {{q, q != 0 ? c / q : 0}, 2};
}

// A symmetric 3 x 3 matrix of rank two.
struct RankTwoForm {
  double a00, a01, a02, a11, a12, a22;
};

// The eigenvectors of the two eigenvalues that are not zero, and the values.
struct EigenPair {
  double large, small;
  Vector3d large_vector, small_vector;
};

EigenPair EigenvectorsOfRankTwo(const RankTwoForm& m) {
  const double b = -m.a00 - m.a11 - m.a22;
  const double c =
      m.a00 * (m.a11 + m.a22) + m.a11 * m.a22 - m.a01 * m.a01 - m.a02 * m.a02 - m.a12 * m.a12;
  const Quadratic values = SolveQuadratic(b, c);
  double large = values.roots[0];
  double small = values.roots[1];
  if (values.count == 0) {  // rounding: the eigenvalues of a symmetric matrix are real
    large = small = -0.5 * b;
  }
  if (std::abs(large) < std::abs(small)) {
    std::swap(large, small);
  }
  const auto vector_of = [&m](double e) -> Vector3d {
    // Orthogonal to two rows of (M - e I); the pair with the largest cross product.
    const Vector3d r0(m.a00 - e, m.a01, m.a02);
    const Vector3d r1(m.a01, m.a11 - e, m.a12);
    const Vector3d r2(m.a02, m.a12, m.a22 - e);
    const Vector3d c01 = r0.cross(r1);
    const Vector3d c02 = r0.cross(r2);
    const Vector3d c12 = r1.cross(r2);
    const double n01 = c01.squaredNorm();
    const double n02 = c02.squaredNorm();
    const double n12 = c12.squaredNorm();
    if (n01 >= n02 && n01 >= n12) return c01 / std::sqrt(n01);
    if (n02 >= n12) return c02 / std::sqrt(n02);
    return c12 / std::sqrt(n12);
  };
  return {large, small, vector_of(large), vector_of(small)};
}

// Holds the squared side lengths of the triangle, and -2 times the cosines between the rays.
struct TriangleEquations {
  double a12, a13, a23;
  double b12, b13, b23;
};

// Polishes the distances by Newton's method on their three equations; converges in one or two steps
// from here.
void PolishDistances(const TriangleEquations& e, Vector3d& l) {
  for (int i = 0; i < 3; ++i) {
    const Vector3d residual(l[0] * l[0] + l[1] * l[1] + e.b12 * l[0] * l[1] - e.a12,
                            l[0] * l[0] + l[2] * l[2] + e.b13 * l[0] * l[2] - e.a13,
                            l[1] * l[1] + l[2] * l[2] + e.b23 * l[1] * l[2] - e.a23);
    if (residual.lpNorm<1>() < 1e-15 * (e.a12 + e.a13 + e.a23)) {
      return;
    }
    const double j00 = 2 * l[0] + e.b12 * l[1];
    const double j01 = 2 * l[1] + e.b12 * l[0];
    const double j10 = 2 * l[0] + e.b13 * l[2];
    const double j12 = 2 * l[2] + e.b13 * l[0];
    const double j21 = 2 * l[1] + e.b23 * l[2];
    const double j22 = 2 * l[2] + e.b23 * l[1];
    const double determinant = -j00 * j12 * j21 - j01 * j10 * j22;
    const Vector3d step(
        -j12 * j21 * residual[0] - j01 * j22 * residual[1] + j01 * j12 * residual[2],
        -j10 * j22 * residual[0] + j00 * j22 * residual[1] - j00 * j12 * residual[2],
        j10 * j21 * residual[0] - j00 * j21 * residual[1] - j01 * j10 * residual[2]);
    const Vector3d polished = l - step / determinant;
    if (!polished.allFinite()) {
      return;
    }
    l = polished;
  }
}

// Returns the rotation nearest to a matrix: where points are nearly on a line, the distances may be
// those of no triangle, and the matrix that takes one triangle to the other is then no rotation.
Matrix3d NearestRotation(const Matrix3d& matrix) {
  constexpr double kRounding = 1e-9;
  const Matrix3d deviation = matrix.transpose() * matrix - Matrix3d::Identity();
  if (deviation.cwiseAbs().maxCoeff() < kRounding || !matrix.allFinite()) return matrix;
  return Eigen::Quaterniond(matrix).normalized().toRotationMatrix();
}

}  // namespace

int SolveP3p(const std::array<Vector3d, 3>& rays, const std::array<Vector3d, 3>& points_in_world,
             std::span<CamFromLocal, 4> poses) {
  const Vector3d d12 = points_in_world[0] - points_in_world[1];
  const Vector3d d13 = points_in_world[0] - points_in_world[2];
  const Vector3d d23 = points_in_world[1] - points_in_world[2];
  const Vector3d normal = d12.cross(d13);
  const double scale = d12.squaredNorm() + d13.squaredNorm() + d23.squaredNorm();
  if (!(normal.squaredNorm() > 1e-20 * scale * scale)) {
    return 0;
  }
  // Unit size, so that no tolerance depends on the scene's.
  const TriangleEquations e = {d12.squaredNorm() / scale, d13.squaredNorm() / scale,
                               d23.squaredNorm() / scale, -2 * rays[0].dot(rays[1]),
                               -2 * rays[0].dot(rays[2]), -2 * rays[1].dot(rays[2])};

  // det(D1 - g D2) = 0 for D1 = a23 M12 - a12 M23, D2 = a23 M13 - a13 M23.
  const double c12 = -0.5 * e.b12;
  const double c13 = -0.5 * e.b13;
  const double c23 = -0.5 * e.b23;
  const double blob = c12 * c23 * c13 - 1;
  const double s12 = 1 - c12 * c12;
  const double s13 = 1 - c13 * c13;
  const double s23 = 1 - c23 * c23;
  const double p3 = e.a13 * (e.a23 * s13 - e.a13 * s23);
  const double p2 =
      2 * blob * e.a23 * e.a13 + e.a13 * (2 * e.a12 + e.a13) * s23 + e.a23 * (e.a23 - e.a12) * s13;
  const double p1 = e.a23 * (e.a13 - e.a23) * s12 - e.a12 * e.a12 * s23 -
                    2 * e.a12 * (blob * e.a23 + e.a13 * s23);
  const double p0 = e.a12 * (e.a12 * s23 - e.a23 * s12);
  if (std::abs(p3) < 1e-300) {
    return 0;
  }
  const double g = SteepestCubicRoot(p3, p2, p1, p0);
  if (!std::isfinite(g)) {
    return 0;
  }
  const EigenPair eigen = EigenvectorsOfRankTwo(
      {e.a23 * (1 - g), 0.5 * e.a23 * e.b12, -0.5 * e.a23 * e.b13 * g, e.a23 - e.a12 + e.a13 * g,
       0.5 * e.b23 * (e.a13 * g - e.a12), g * (e.a13 - e.a23) - e.a12});
  const double ratio = std::sqrt(std::max(0.0, -eigen.small / eigen.large));

  Matrix3d world_basis;
  world_basis << d12, d13, normal;
  const Matrix3d world_basis_inverse = world_basis.inverse();
  const double side = std::sqrt(scale);

  int count = 0;
  for (const double s : {ratio, -ratio}) {
    // The plane n . lambda = 0.
    const Vector3d n = eigen.large_vector - s * eigen.small_vector;
    if (std::abs(n[0]) < 1e-14) {
      continue;
    }
    const double w0 = -n[1] / n[0];
    const double w1 = -n[2] / n[0];
    const double a = (e.a13 - e.a12) * w1 * w1 - e.a12 * e.b13 * w1 - e.a12;
    const double b = e.a13 * e.b12 * w1 - e.a12 * e.b13 * w0 - 2 * w0 * w1 * (e.a12 - e.a13);
    const double c = (e.a13 - e.a12) * w0 * w0 + e.a13 * e.b12 * w0 + e.a13;
    const Quadratic tau = SolveQuadratic(b / a, c / a);
    for (int k = 0; k < tau.count; ++k) {
      const double t = tau.roots[k];
      if (!(t > 0)) {
        continue;
      }
      const double squared = e.a23 / (t * (e.b23 + t) + 1);
      if (!(squared > 0)) {
        continue;
      }
      const double l2 = std::sqrt(squared);
      const double l3 = t * l2;
      Vector3d distances(w0 * l2 + w1 * l3, l2, l3);
      if (!(distances[0] >= 0)) {
        continue;
      }
      PolishDistances(e, distances);
      if (!(distances.minCoeff() > 0)) {
        continue;
      }
      const Vector3d q1 = distances[0] * side * rays[0];
      const Vector3d e12 = q1 - distances[1] * side * rays[1];
      const Vector3d e13 = q1 - distances[2] * side * rays[2];
      Matrix3d camera_basis;
      camera_basis << e12, e13, e12.cross(e13);
      CamFromLocal& pose = poses[count];
      pose.rotation = NearestRotation(camera_basis * world_basis_inverse);
      pose.translation = q1 - pose.rotation * points_in_world[0];
      if (pose.rotation.allFinite() && pose.translation.allFinite() && count < 4) {
        ++count;
      }
      if (count == 4) {
        return count;
      }
    }
  }
  return count;
}

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Holds coefficients by ascending powers.
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

// The equation of the distance of two points, of which the first lies x along its ray and the
// second y:
//   x^2 + y^2 + xy * x y + by_x * x + by_y * y + constant = 0.
struct DistanceEquation {
  double xy, by_x, by_y, constant;

  DistanceEquation(const Vector3d& from_second_center, const Vector3d& first_ray,
                   const Vector3d& second_ray, double squared_distance)
      : xy(-2 * first_ray.dot(second_ray)),
        by_x(2 * first_ray.dot(from_second_center)),
        by_y(-2 * second_ray.dot(from_second_center)),
        constant(from_second_center.squaredNorm() - squared_distance) {}

  // Return the coefficients of the equation as a quadratic, y^2 + Linear(x) y + Constant(x).
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

  // Polishes by Newton's method; nullopt where that ends at no solution in front of the cameras.
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

// Returns right-handed axes of a triangle: x along its first side, y in its plane, z across.
Matrix3d AxesOfTriangle(const Vector3d& first_side, const Vector3d& second_side) {
  Matrix3d axes;
  axes.col(0) = first_side.normalized();
  axes.col(2) = first_side.cross(second_side).normalized();
  axes.col(1) = axes.col(2).cross(axes.col(0));
  return axes;
}

}  // namespace

int SolveGeneralizedP3p(const std::array<Vector3d, 3>& centers, const std::array<Vector3d, 3>& rays,
                        const std::array<Vector3d, 3>& points_in_world,
                        std::span<CamFromLocal, kMaxGeneralizedP3pSolutions> poses) {
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

  const Matrix3d axes_in_world = AxesOfTriangle(side12, side13);
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
    CamFromLocal& pose = poses[static_cast<size_t>(count)];
    pose.rotation =
        AxesOfTriangle(points_in_rig[1] - points_in_rig[0], points_in_rig[2] - points_in_rig[0]) *
        axes_in_world.transpose();
    pose.translation = points_in_rig[0] - pose.rotation * points_in_world[0];
    if (pose.rotation.allFinite() && pose.translation.allFinite()) ++count;
  }
  return count;
}

}  // namespace raylift
