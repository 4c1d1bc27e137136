#include "renderers/splat_blend.h"

#include <numbers>
#include <utility>

#include "surfaces/space_order.h"
#include <Eigen/Geometry>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"

namespace raylift {
namespace {

constexpr double kMostAlpha = 0.99;
constexpr double kLeastTransmittance = 1e-4;
constexpr double kSurfaceAlpha = 0.5;

constexpr size_t kSplatsOfTask = 4096;

using Whitening = Eigen::Map<const Eigen::Matrix<float, 3, 3, Eigen::RowMajor>>;

Eigen::Vector3d MeanOf(const PackedSplat& splat) {
  return Eigen::Vector3f(splat.mean.data()).cast<double>();
}

Eigen::Matrix3d WhiteningOf(const PackedSplat& splat) {
  return Whitening(splat.whitening.data()).cast<double>();
}

PackedSplat Pack(const Splats& splats, uint32_t index) {
  PackedSplat packed;
  Eigen::Map<Eigen::Vector3f>(packed.mean.data()) = splats.means[index];
  const Eigen::Vector3d inverse_scale = splats.scales[index].cast<double>().cwiseInverse();
  const Eigen::Matrix3d axes =
      splats.rotations[index].cast<double>().normalized().toRotationMatrix();
  Eigen::Map<Eigen::Matrix<float, 3, 3, Eigen::RowMajor>>(packed.whitening.data()) =
      (inverse_scale.asDiagonal() * axes.transpose()).cast<float>();
  packed.opacity = splats.opacities[index];
  packed.reach2 = static_cast<float>(2 * std::log(double{packed.opacity} / kLeastAlpha));
  packed.index = index;
  int flattest = 0;
  inverse_scale.maxCoeff(&flattest);
  packed.flattest = static_cast<uint32_t>(flattest);
  return packed;
}

double DepthOf(SplatDepth depth, double median, double expected, double peak) {
  switch (depth) {
    case SplatDepth::kMedian:
      return median;
    case SplatDepth::kExpected:
      return expected;
    case SplatDepth::kPeak:
      return peak;
  }
  return median;
}

constexpr size_t kMostCoefficients = 16;

// Returns sqrt(numerator / pi), the form of all factors.
double RootOverPi(double numerator) { return std::sqrt(numerator / std::numbers::pi); }

// Returns the real spherical harmonics of degrees 0 to 3 at a unit direction, in the order and with
// the signs of the reference code (Kerbl et al. 2023).
std::array<float, kMostCoefficients> HarmonicsAt(const Eigen::Vector3d& direction) {
  static const double k0 = 0.5 * RootOverPi(1);
  static const double k1 = 0.5 * RootOverPi(3);
  static const std::array<double, 3> k2 = {0.5 * RootOverPi(15), 0.25 * RootOverPi(5),
                                           0.25 * RootOverPi(15)};
  static const std::array<double, 5> k3 = {0.25 * RootOverPi(17.5), 0.5 * RootOverPi(105),
                                           0.25 * RootOverPi(10.5), 0.25 * RootOverPi(7),
                                           0.25 * RootOverPi(105)};
  const double x = direction.x(), y = direction.y(), z = direction.z();
  const double xx = x * x, yy = y * y, zz = z * z;
  const std::array<double, kMostCoefficients> values = {k0,
                                                        -k1 * y,
                                                        k1 * z,
                                                        -k1 * x,
                                                        k2[0] * x * y,
                                                        -k2[0] * y * z,
                                                        k2[1] * (2 * zz - xx - yy),
                                                        -k2[0] * x * z,
                                                        k2[2] * (xx - yy),
                                                        -k3[0] * y * (3 * xx - yy),
                                                        k3[1] * x * y * z,
                                                        -k3[2] * y * (4 * zz - xx - yy),
                                                        k3[3] * z * (2 * zz - 3 * xx - 3 * yy),
                                                        -k3[2] * x * (4 * zz - xx - yy),
                                                        k3[4] * z * (xx - yy),
                                                        -k3[0] * x * (xx - 3 * yy)};
  std::array<float, kMostCoefficients> rounded;
  std::transform(values.begin(), values.end(), rounded.begin(),
                 [](double value) { return static_cast<float>(value); });
  return rounded;
}

Eigen::Vector3f ColorFrom(const Splats& splats, size_t index, const Eigen::Vector3d& eye) {
  const size_t count = splats.NumCoefficients();
  const Eigen::Vector3f* const coefficients = &splats.harmonics[index * count];
  const Eigen::Vector3d from_eye = splats.means[index].cast<double>() - eye;
  // At the eye itself there is no direction, and no place in the picture.
  const double length = std::max(from_eye.norm(), 1e-30);
  const auto harmonics = HarmonicsAt(splats.harmonics_from_world * (from_eye / length));
  Eigen::Vector3f color = Eigen::Vector3f::Constant(0.5f);
  for (size_t i = 0; i < count; ++i) color += harmonics[i] * coefficients[i];
  return color.cwiseMax(0.0f);
}

}  // namespace

// Returns half the sides of the ellipsoid's box. A point x of the ellipsoid is mean + sum over axes
// a of a.length * u[a] * a.direction with |u| = 1; a row of the whitening is an axis over its
// squared length.
Eigen::Vector3f PackedSplat::HalfBox() const {
  const Eigen::Matrix3d rows = WhiteningOf(*this);
  Eigen::Vector3d squares = Eigen::Vector3d::Zero();
  for (int i = 0; i < 3; ++i) {
    const Eigen::Vector3d axis = rows.row(i).transpose() / rows.row(i).squaredNorm();
    squares += axis.cwiseAbs2();
  }
  return (std::sqrt(std::max(double{reach2}, 0.0)) * squares.cwiseSqrt()).cast<float>();
}

std::vector<PackedSplat> PackSplats(const Splats& splats, int threads) {
  const size_t count = splats.means.size();
  RAYLIFT_CHECK_EQ(count, splats.rotations.size());
  RAYLIFT_CHECK_EQ(count, splats.scales.size());
  RAYLIFT_CHECK_EQ(count, splats.opacities.size());
  const std::vector<uint32_t> order = OrderInSpace(splats.means, 21);
  std::vector<PackedSplat> packed(count);
  ParallelFor((count + kSplatsOfTask - 1) / kSplatsOfTask, threads, [&](size_t batch) {
    const size_t end = std::min((batch + 1) * kSplatsOfTask, count);
    for (size_t i = batch * kSplatsOfTask; i < end; ++i) packed[i] = Pack(splats, order[i]);
  });
  return packed;
}

// Works in the Gaussian's own round space: o' = W (o - m), d' = W d. The ray is closest to the
// center at t = -o'.d' / d'.d', at the distance |o' x d'| / |d'|, which stays exact where one axis
// is so short that o' and d' are large.
std::optional<SplatOnRay> MeetSplat(const PackedSplat& splat, uint32_t index, const SplatRay& ray) {
  const Eigen::Matrix3d whitening = WhiteningOf(splat);
  const Eigen::Vector3d origin = whitening * (ray.origin - MeanOf(splat));
  const Eigen::Vector3d direction = whitening * ray.direction;
  const double length2 = direction.squaredNorm();
  const double distance2 = origin.cross(direction).squaredNorm() / length2;
  if (!(distance2 <= double{splat.reach2})) return std::nullopt;
  const double alpha = std::min(kMostAlpha, double{splat.opacity} * std::exp(-0.5 * distance2));
  return SplatOnRay{-origin.dot(direction) / length2, alpha, index};
}

std::optional<double> SortVisible(std::vector<SplatOnRay>& met) {
  std::sort(met.begin(), met.end(), [](const SplatOnRay& a, const SplatOnRay& b) {
    return std::pair(a.t, a.splat) < std::pair(b.t, b.splat);
  });
  double transmittance = 1;
  for (size_t i = 0; i < met.size(); ++i) {
    transmittance *= 1 - met[i].alpha;
    if (transmittance < kLeastTransmittance) {
      const double end = met[i].t;
      // It stays, as the sign that there is an end.
      met.resize(i + 1);
      return end;
    }
  }
  return std::nullopt;
}

SplatBlend BlendSplats(std::span<const PackedSplat> splats, const SplatRay& ray,
                       std::span<const SplatOnRay> met, SplatDepth depth,
                       std::span<const Eigen::Vector3f> colors) {
  SplatBlend blend;
  SplatBlend::Surface surface{0, 0, Eigen::Vector3d::Zero(), 0};
  std::optional<double> median;
  double sum_wt = 0;
  double sum_wtt = 0;
  double largest = 0;
  double peak = 0;
  const double first = met.empty() ? 0 : met.front().t;  // sums of squares are about it
  for (const SplatOnRay& one : met) {
    const PackedSplat& splat = splats[one.splat];
    const double left = blend.transmittance * (1 - one.alpha);
    if (left < kLeastTransmittance) break;
    const double weight = blend.transmittance * one.alpha;
    const Eigen::Matrix3d whitening = WhiteningOf(splat);
    const double from_first = one.t - first;
    const double own_variance = 1 / (whitening * ray.direction).squaredNorm();
    sum_wt += weight * from_first;
    sum_wtt += weight * (from_first * from_first + own_variance);
    if (weight > largest) {
      largest = weight;
      peak = one.t;
      surface.heaviest = splat.index;
    }
    const Eigen::Vector3d normal =
        whitening.row(static_cast<int>(splat.flattest)).transpose().normalized();
    surface.normal += normal.dot(ray.direction) > 0 ? -weight * normal : weight * normal;
    if (!colors.empty()) blend.color += static_cast<float>(weight) * colors[splat.index];
    blend.transmittance = left;
    if (!median && left <= 1 - kSurfaceAlpha) median = one.t;
  }
  if (!median) return blend;
  const double sum_w = 1 - blend.transmittance;
  const double mean = sum_wt / sum_w;
  surface.t = DepthOf(depth, *median, first + mean, peak);
  const double off = surface.t - first;
  surface.sigma_along_ray = std::sqrt(std::max(0.0, sum_wtt / sum_w - 2 * off * mean + off * off));
  surface.normal = surface.normal.dot(ray.direction) < 0 ? surface.normal.normalized()
                                                         : Eigen::Vector3d(-ray.direction);
  blend.surface = surface;
  return blend;
}

size_t Splats::MemoryBytes() const {
  return means.size() *
             (sizeof(means[0]) + sizeof(rotations[0]) + sizeof(scales[0]) + sizeof(opacities[0])) +
         harmonics.size() * sizeof(harmonics[0]);
}

std::vector<Eigen::Vector3f> SplatColors(const Splats& splats, const Eigen::Vector3d& eye_in_world,
                                         int threads) {
  const size_t count = splats.harmonics.empty() ? 0 : splats.means.size();
  RAYLIFT_CHECK_EQ(splats.harmonics.size(), count * splats.NumCoefficients());
  RAYLIFT_CHECK(splats.NumCoefficients() <= kMostCoefficients);
  const Eigen::Vector3d eye = eye_in_world - splats.origin_in_world;
  std::vector<Eigen::Vector3f> colors(count);
  ParallelFor((count + kSplatsOfTask - 1) / kSplatsOfTask, threads, [&](size_t batch) {
    const size_t end = std::min((batch + 1) * kSplatsOfTask, count);
    for (size_t i = batch * kSplatsOfTask; i < end; ++i) colors[i] = ColorFrom(splats, i, eye);
  });
  return colors;
}

}  // namespace raylift
