// The colors of splats from an eye: real spherical harmonics, in the order and with the signs of the
// reference code (Kerbl et al. 2023).

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include <Eigen/Geometry>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"
#include "raylift/renderers/splats.h"

namespace raylift {
namespace {

constexpr size_t kMostCoefficients = 16;
constexpr size_t kBatch = 4096;

// sqrt(numerator / pi), the form of all factors.
double RootOverPi(double numerator) { return std::sqrt(numerator / std::numbers::pi); }

// The harmonics of degrees 0 to 3 at a unit direction.
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
  ParallelFor((count + kBatch - 1) / kBatch, threads, [&](size_t batch) {
    const size_t end = std::min((batch + 1) * kBatch, count);
    for (size_t i = batch * kBatch; i < end; ++i) colors[i] = ColorFrom(splats, i, eye);
  });
  return colors;
}

}  // namespace raylift
