#include <algorithm>
#include <cmath>

#include "estimation/solvers/minimal_solvers.h"
#include "estimation/solvers/polynomial_roots.h"
#include <Eigen/Geometry>

#include "raylift/geometry/rigid3.h"

namespace raylift {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Rays = std::array<Vector3d, 5>;

// These hold polynomials in (x, y, z), where E = x X + y Y + z Z + W.
struct Linear {  // x y z 1
  double c[4];
};
struct Quadric {  // xx xy xz x yy yz y zz z 1
  double c[10];
};
// The coefficients are in Nister's order: the ten monomials of degree two or more in (x, y) first,
// then those of x, y and 1 with their powers of z:
//   xxx yyy xxy xyy xxz xx yyz yy xyz xy | xzz xz x yzz yz y zzz zz z 1
struct Cubic {
  double c[20];
};

inline void AddProduct(const Linear& a, const Linear& b, Quadric& q) {
  q.c[0] += a.c[0] * b.c[0];
  q.c[1] += a.c[0] * b.c[1] + a.c[1] * b.c[0];
  q.c[2] += a.c[0] * b.c[2] + a.c[2] * b.c[0];
  q.c[3] += a.c[0] * b.c[3] + a.c[3] * b.c[0];
  q.c[4] += a.c[1] * b.c[1];
  q.c[5] += a.c[1] * b.c[2] + a.c[2] * b.c[1];
  q.c[6] += a.c[1] * b.c[3] + a.c[3] * b.c[1];
  q.c[7] += a.c[2] * b.c[2];
  q.c[8] += a.c[2] * b.c[3] + a.c[3] * b.c[2];
  q.c[9] += a.c[3] * b.c[3];
}

inline void AddProduct(const Quadric& q, const Linear& l, double* r) {
  r[0] += q.c[0] * l.c[0];                                       // xxx
  r[1] += q.c[4] * l.c[1];                                       // yyy
  r[2] += q.c[0] * l.c[1] + q.c[1] * l.c[0];                     // xxy
  r[3] += q.c[1] * l.c[1] + q.c[4] * l.c[0];                     // xyy
  r[4] += q.c[0] * l.c[2] + q.c[2] * l.c[0];                     // xxz
  r[5] += q.c[0] * l.c[3] + q.c[3] * l.c[0];                     // xx
  r[6] += q.c[4] * l.c[2] + q.c[5] * l.c[1];                     // yyz
  r[7] += q.c[4] * l.c[3] + q.c[6] * l.c[1];                     // yy
  r[8] += q.c[1] * l.c[2] + q.c[2] * l.c[1] + q.c[5] * l.c[0];   // xyz
  r[9] += q.c[1] * l.c[3] + q.c[3] * l.c[1] + q.c[6] * l.c[0];   // xy
  r[10] += q.c[2] * l.c[2] + q.c[7] * l.c[0];                    // xzz
  r[11] += q.c[2] * l.c[3] + q.c[3] * l.c[2] + q.c[8] * l.c[0];  // xz
  r[12] += q.c[3] * l.c[3] + q.c[9] * l.c[0];                    // x
  r[13] += q.c[5] * l.c[2] + q.c[7] * l.c[1];                    // yzz
  r[14] += q.c[5] * l.c[3] + q.c[6] * l.c[2] + q.c[8] * l.c[1];  // yz
  r[15] += q.c[6] * l.c[3] + q.c[9] * l.c[1];                    // y
  r[16] += q.c[7] * l.c[2];                                      // zzz
  r[17] += q.c[7] * l.c[3] + q.c[8] * l.c[2];                    // zz
  r[18] += q.c[8] * l.c[3] + q.c[9] * l.c[2];                    // z
  r[19] += q.c[9] * l.c[3];                                      // 1
}

inline Quadric Difference(const Quadric& a, const Quadric& b) {
  Quadric d;
  for (int i = 0; i < 10; ++i) d.c[i] = a.c[i] - b.c[i];
  return d;
}

// Returns four orthonormal vectors orthogonal to the five epipolar constraints, by Householder
// reflections.
std::array<std::array<double, 9>, 4> EpipolarNullSpace(const Rays& query_rays,
                                                       const Rays& reference_rays) {
  double columns[5][9];
  for (int i = 0; i < 5; ++i) {
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) {
        columns[i][3 * r + c] = query_rays[i][r] * reference_rays[i][c];
      }
    }
  }
  double factor[5];
  for (int k = 0; k < 5; ++k) {
    double* v = columns[k];
    double norm2 = 0;
    for (int i = k; i < 9; ++i) norm2 += v[i] * v[i];
    const double norm = std::sqrt(norm2);
    const double alpha = v[k] > 0 ? -norm : norm;
    v[k] -= alpha;
    const double reflector2 = norm2 - 2 * alpha * (v[k] + alpha) + alpha * alpha;
    factor[k] = reflector2 > 0 ? 2 / reflector2 : 0;
    for (int j = k + 1; j < 5; ++j) {
      double dot = 0;
      for (int i = k; i < 9; ++i) dot += v[i] * columns[j][i];
      dot *= factor[k];
      for (int i = k; i < 9; ++i) columns[j][i] -= dot * v[i];
    }
  }
  std::array<std::array<double, 9>, 4> basis{};
  for (int b = 0; b < 4; ++b) {
    basis[b][5 + b] = 1;
    for (int k = 4; k >= 0; --k) {
      const double* v = columns[k];
      double dot = 0;
      for (int i = k; i < 9; ++i) dot += v[i] * basis[b][i];
      dot *= factor[k];
      for (int i = k; i < 9; ++i) basis[b][i] -= dot * v[i];
    }
  }
  return basis;
}

// Writes the ten cubic constraints of an essential matrix: 2 E E' E - trace(E E') E = 0 and det E =
// 0.
void EssentialConstraints(const std::array<std::array<double, 9>, 4>& basis, Cubic rows[10]) {
  Linear e[9];
  for (int i = 0; i < 9; ++i) {
    for (int b = 0; b < 4; ++b) e[i].c[b] = basis[b][i];
  }
  Quadric gram[6] = {};  // of the rows: 00 01 02 11 12 22
  constexpr int kPairs[6][2] = {{0, 0}, {0, 1}, {0, 2}, {1, 1}, {1, 2}, {2, 2}};
  for (int g = 0; g < 6; ++g) {
    for (int k = 0; k < 3; ++k) {
      AddProduct(e[3 * kPairs[g][0] + k], e[3 * kPairs[g][1] + k], gram[g]);
    }
  }
  // Lambda = E E' - trace / 2.
  for (int i = 0; i < 10; ++i) {
    const double half_trace = 0.5 * (gram[0].c[i] + gram[3].c[i] + gram[5].c[i]);
    gram[0].c[i] -= half_trace;
    gram[3].c[i] -= half_trace;
    gram[5].c[i] -= half_trace;
  }
  constexpr int kSymmetric[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) {
      Cubic& row = rows[3 * r + c];
      row = {};
      for (int k = 0; k < 3; ++k) {
        AddProduct(gram[kSymmetric[r][k]], e[3 * k + c], row.c);
      }
    }
  }
  rows[9] = {};
  for (int c = 0; c < 3; ++c) {
    const int c1 = (c + 1) % 3;
    const int c2 = (c + 2) % 3;
    Quadric plus = {};
    Quadric minus = {};
    AddProduct(e[3 + c1], e[6 + c2], plus);
    AddProduct(e[3 + c2], e[6 + c1], minus);
    AddProduct(Difference(plus, minus), e[c], rows[9].c);
  }
}

// Eliminates the first ten columns by Gauss-Jordan with partial pivoting; only the rows of the six
// last pivots (from xxz on) are reduced fully, as only those are used. Returns false where it is
// singular.
bool EliminateLeadingMonomials(Cubic rows[10]) {
  for (int k = 0; k < 10; ++k) {
    int pivot = k;
    for (int r = k + 1; r < 10; ++r) {
      if (std::abs(rows[r].c[k]) > std::abs(rows[pivot].c[k])) pivot = r;
    }
    if (!(std::abs(rows[pivot].c[k]) > 1e-300)) {
      return false;
    }
    if (pivot != k) std::swap(rows[pivot], rows[k]);
    const double inverse = 1 / rows[k].c[k];
    for (int j = k + 1; j < 20; ++j) rows[k].c[j] *= inverse;
    for (int r = k + 1; r < 10; ++r) {
      const double f = rows[r].c[k];
      for (int j = k + 1; j < 20; ++j) rows[r].c[j] -= f * rows[k].c[j];
    }
  }
  for (int k = 9; k >= 5; --k) {
    for (int r = 4; r < k; ++r) {
      const double f = rows[r].c[k];
      for (int j = 10; j < 20; ++j) rows[r].c[j] -= f * rows[k].c[j];
    }
  }
  return true;
}

// Holds row a - z * row b, a polynomial in z for each of x, y and 1, as coefficients by the power
// of z.
struct EliminatedRow {
  double x[4];
  double y[4];
  double one[5];
};

EliminatedRow Combine(const Cubic& a, const Cubic& b) {
  const double* p = a.c + 10;
  const double* q = b.c + 10;
  return {{p[2], p[1] - q[2], p[0] - q[1], -q[0]},
          {p[5], p[4] - q[5], p[3] - q[4], -q[3]},
          {p[9], p[8] - q[9], p[7] - q[8], p[6] - q[7], -q[6]}};
}

template <int kA, int kB>
void AddProduct(const double (&a)[kA], const double (&b)[kB], double sign, double* result) {
  for (int i = 0; i < kA; ++i) {
    for (int j = 0; j < kB; ++j) result[i + j] += sign * a[i] * b[j];
  }
}

double Evaluate(const double* c, int degree, double z) {
  double value = c[degree];
  for (int i = degree - 1; i >= 0; --i) value = value * z + c[i];
  return value;
}

// Polishes a pose by Newton's method on q' [t] R r = 0 for the five matches, in the rotation and
// the direction; keeps it orthogonal. Returns false if that does not converge.
bool Polish(const Rays& query_rays, const Rays& reference_rays, RelativePose& pose) {
  for (int iteration = 0; iteration < 4; ++iteration) {
    const Vector3d axis = pose.direction;
    Vector3d tangent0 =
        std::abs(axis.x()) < 0.6 ? Vector3d::UnitX().cross(axis) : Vector3d::UnitY().cross(axis);
    tangent0.normalize();
    const Vector3d tangent1 = axis.cross(tangent0);
    double a[5][6];
    double largest = 0;
    for (int i = 0; i < 5; ++i) {
      const Vector3d g = pose.rotation * reference_rays[i];
      const Vector3d n = axis.cross(g);
      const Vector3d by_translation = g.cross(query_rays[i]);
      // d/dw of q . (t x (R r)) with R <- exp(w) R: w . (g x (q x t)).
      const Vector3d by_rotation = g.cross(query_rays[i].cross(axis));
      const double residual = query_rays[i].dot(n);
      largest = std::max(largest, std::abs(residual));
      a[i][0] = by_rotation.x();
      a[i][1] = by_rotation.y();
      a[i][2] = by_rotation.z();
      a[i][3] = by_translation.dot(tangent0);
      a[i][4] = by_translation.dot(tangent1);
      a[i][5] = -residual;
    }
    if (largest < 1e-13) {
      return true;
    }
    for (int k = 0; k < 5; ++k) {
      int pivot = k;
      for (int r = k + 1; r < 5; ++r) {
        if (std::abs(a[r][k]) > std::abs(a[pivot][k])) pivot = r;
      }
      if (!(std::abs(a[pivot][k]) > 1e-14)) {
        return largest < 1e-9;  // singular, but as good as it gets
      }
      if (pivot != k) std::swap(a[pivot], a[k]);
      const double inverse = 1 / a[k][k];
      for (int r = k + 1; r < 5; ++r) {
        const double f = a[r][k] * inverse;
        for (int j = k + 1; j < 6; ++j) a[r][j] -= f * a[k][j];
      }
    }
    double step[5];
    for (int k = 4; k >= 0; --k) {
      double value = a[k][5];
      for (int j = k + 1; j < 5; ++j) value -= a[k][j] * step[j];
      step[k] = value / a[k][k];
    }
    const Vector3d w(step[0], step[1], step[2]);
    const double size2 = w.squaredNorm() + step[3] * step[3] + step[4] * step[4];
    if (!(size2 < 0.25)) {
      return false;
    }
    pose.rotation = RotationFromVector(w).toRotationMatrix() * pose.rotation;
    pose.direction = (axis + step[3] * tangent0 + step[4] * tangent1).normalized();
    // Steps converge quadratically: after one of 1e-6 nothing is left to gain.
    if (size2 < 1e-12) {
      return true;
    }
  }
  return true;
}

bool AllInFront(const Rays& query_rays, const Rays& reference_rays, const RelativePose& pose) {
  for (int i = 0; i < 5; ++i) {
    const Vector3d g = pose.rotation * reference_rays[i];
    const double a = pose.direction.dot(query_rays[i]);
    const double b = pose.direction.dot(g);
    const double c = query_rays[i].dot(g);
    if (!(a - b * c > 0) || !(a * c - b > 0)) {
      return false;
    }
  }
  return true;
}

// Returns about the rotation nearest to an almost orthogonal matrix: two steps of Newton's polar
// iteration would need inverses; Gram-Schmidt is enough, as Newton's method polishes the pose
// afterwards.
Matrix3d Orthogonalized(const Matrix3d& m) {
  const Vector3d x = m.col(0).normalized();
  const Vector3d z = x.cross(m.col(1)).normalized();
  Matrix3d r;
  r << x, z.cross(x), z;
  return r;
}

}  // namespace

int SolveEssential(const Rays& query_rays, const Rays& reference_rays,
                   std::span<Matrix3d, kMaxFivePointSolutions> essentials) {
  const auto basis = EpipolarNullSpace(query_rays, reference_rays);
  Cubic rows[10];
  EssentialConstraints(basis, rows);
  if (!EliminateLeadingMonomials(rows)) {
    return 0;
  }
  const EliminatedRow k = Combine(rows[4], rows[5]);
  const EliminatedRow l = Combine(rows[6], rows[7]);
  const EliminatedRow m = Combine(rows[8], rows[9]);

  // The determinant of the 3 x 3 matrix of these rows is expanded along its last column.
  double minor_lm[7] = {};
  double minor_mk[7] = {};
  double minor_kl[7] = {};
  AddProduct(l.x, m.y, 1, minor_lm);
  AddProduct(l.y, m.x, -1, minor_lm);
  AddProduct(m.x, k.y, 1, minor_mk);
  AddProduct(m.y, k.x, -1, minor_mk);
  AddProduct(k.x, l.y, 1, minor_kl);
  AddProduct(k.y, l.x, -1, minor_kl);
  std::array<double, 11> determinant{};
  AddProduct(minor_lm, k.one, 1, determinant.data());
  AddProduct(minor_mk, l.one, 1, determinant.data());
  AddProduct(minor_kl, m.one, 1, determinant.data());

  std::array<double, 10> roots;
  const int num_roots = RealRoots<10>(determinant, roots);
  int count = 0;
  for (int i = 0; i < num_roots; ++i) {
    const double z = roots[i];
    const Vector3d rows_at_z[3] = {
        {Evaluate(k.x, 3, z), Evaluate(k.y, 3, z), Evaluate(k.one, 4, z)},
        {Evaluate(l.x, 3, z), Evaluate(l.y, 3, z), Evaluate(l.one, 4, z)},
        {Evaluate(m.x, 3, z), Evaluate(m.y, 3, z), Evaluate(m.one, 4, z)}};
    // (x, y, 1) is orthogonal to all three rows: the largest of their cross products.
    Vector3d best = rows_at_z[0].cross(rows_at_z[1]);
    for (const Vector3d& other :
         {rows_at_z[1].cross(rows_at_z[2]), rows_at_z[2].cross(rows_at_z[0])}) {
      if (other.squaredNorm() > best.squaredNorm()) best = other;
    }
    const double x = best[0] / best[2];
    const double y = best[1] / best[2];
    Matrix3d& essential = essentials[count];
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) {
        const int j = 3 * r + c;
        essential(r, c) = x * basis[0][j] + y * basis[1][j] + z * basis[2][j] + basis[3][j];
      }
    }
    const double norm = essential.norm();
    if (std::isfinite(norm) && norm > 0) {
      essential /= norm;
      ++count;
    }
  }
  return count;
}

int SolveRelativePose(const Rays& query_rays, const Rays& reference_rays,
                      std::span<RelativePose, kMaxFivePointSolutions> poses) {
  std::array<Matrix3d, kMaxFivePointSolutions> essentials;
  const int num_essentials = SolveEssential(query_rays, reference_rays, essentials);
  int count = 0;
  for (int i = 0; i < num_essentials; ++i) {
    const Matrix3d& e = essentials[i];
    Matrix3d cofactors;
    cofactors.row(0) = e.row(1).cross(e.row(2));
    cofactors.row(1) = e.row(2).cross(e.row(0));
    cofactors.row(2) = e.row(0).cross(e.row(1));
    // The translation spans the left null space; the cofactor matrix is t t' R.
    int column = 0;
    for (int c = 1; c < 3; ++c) {
      if (cofactors.col(c).squaredNorm() > cofactors.col(column).squaredNorm()) column = c;
    }
    const Vector3d t = cofactors.col(column).normalized();
    const double length2 = 0.5 * e.squaredNorm();  // of the translation in E = [t] R
    const Matrix3d product = Skew(t) * e * std::sqrt(length2);
    if (!t.allFinite()) {
      continue;
    }
    for (const double sign : {1.0, -1.0}) {
      RelativePose pose;
      pose.rotation = Orthogonalized((cofactors - sign * product) / length2);
      // The direction is that of the two which puts the first point in front of the query.
      const Vector3d g = pose.rotation * reference_rays[0];
      const double in_front = t.dot(query_rays[0]) - t.dot(g) * query_rays[0].dot(g);
      pose.direction = in_front > 0 ? t : Vector3d(-t);
      if (!AllInFront(query_rays, reference_rays, pose) ||
          !Polish(query_rays, reference_rays, pose) || !pose.rotation.allFinite() ||
          !pose.direction.allFinite() || !AllInFront(query_rays, reference_rays, pose)) {
        continue;
      }
      if (count < kMaxFivePointSolutions) {
        poses[count++] = pose;
      }
    }
  }
  return count;
}

namespace {

// Rays that leave a plane by no more than this do so by rounding.
constexpr double kLeastParallax = 1e-9;

}  // namespace

CamFromLocal QueryPose(const RelativePose& relative, const Eigen::Vector3d& center, double length) {
  return {relative.rotation, length * relative.direction - relative.rotation * center};
}

std::optional<double> TranslationLength(const RelativePose& relative, const Eigen::Vector3d& center,
                                        const RayPair& sixth, const Eigen::Vector3d& sixth_center) {
  // In the query's frame the sixth reference sits at a + length * direction.
  const Eigen::Vector3d a = relative.rotation * (sixth_center - center);
  const Eigen::Vector3d g = relative.rotation * sixth.reference_ray;
  const Eigen::Vector3d plane_normal = g.cross(sixth.query_ray);
  const double parallax = plane_normal.dot(relative.direction);
  if (!(std::abs(parallax) > kLeastParallax)) return std::nullopt;
  const double length = -plane_normal.dot(a) / parallax;
  if (!(length > 0) || !std::isfinite(length)) {
    return std::nullopt;
  }
  const Eigen::Vector3d baseline = a + length * relative.direction;
  const double along_query = baseline.dot(sixth.query_ray);
  const double along_reference = baseline.dot(g);
  const double cosine = sixth.query_ray.dot(g);
  if (!(along_query - along_reference * cosine > 0) ||
      !(along_query * cosine - along_reference > 0)) {
    return std::nullopt;
  }
  return length;
}

int SolveRelativePoseByDepth(const std::array<Eigen::Vector3d, 3>& query_rays,
                             const std::array<Eigen::Vector3d, 3>& points_from_center,
                             std::span<RelativePose, 4> poses) {
  // A shorter translation than this, beside the points' distances, is rounding.
  constexpr double kLeastTranslation = 1e-9;
  std::array<CamFromLocal, 4> solutions;
  const int num_solutions = SolveP3p(query_rays, points_from_center, solutions);
  double farthest2 = 0;
  for (const Eigen::Vector3d& point : points_from_center) {
    farthest2 = std::max(farthest2, point.squaredNorm());
  }
  int count = 0;
  for (int i = 0; i < num_solutions; ++i) {
    const double length = solutions[i].translation.norm();
    if (!(length * length > kLeastTranslation * kLeastTranslation * farthest2)) continue;
    poses[count++] = {solutions[i].rotation, solutions[i].translation / length};
  }
  return count;
}

}  // namespace raylift
