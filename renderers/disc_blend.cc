#include "renderers/disc_blend.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include <Eigen/Geometry>

namespace raylift {
namespace {

// Planes that are further apart than this many standard deviations are different surfaces.
constexpr double kSigmas = 3;

// Surfaces at more oblique angles than this cosine's are searched no further along the ray.
constexpr double kLeastCosine = 0.2;

double Variance(const Surfels& surfels, uint32_t disc) {
  const auto sigma = double{surfels.sigmas[disc]};
  return sigma * sigma;
}

// The point in which a ray meets a disc's plane.
struct DiscHit {
  double t;
  double cosine;           // of the angle between ray and normal
  Eigen::Vector3d offset;  // from the disc's center
  Eigen::Vector3d normal;  // turned against the ray
};
DiscHit MeetDisc(const Surfels& surfels, const DiscRay& ray, uint32_t disc) {
  const Eigen::Vector3d center = surfels.discs[disc].head<3>().cast<double>();
  const Eigen::Vector3d normal = surfels.normals[disc].cast<double>();
  const double cosine = ray.direction.dot(normal);
  const double t = (center - ray.origin).dot(normal) / cosine;
  return {t, std::abs(cosine), ray.origin + t * ray.direction - center,
          cosine > 0 ? Eigen::Vector3d(-normal) : normal};
}

// Returns whether some of the offsets lie on either side of every line through the plane's origin.
class Surroundings {
 public:
  explicit Surroundings(const Eigen::Vector3d& normal)
      : x_(normal.unitOrthogonal()), y_(normal.cross(x_)) {}

  void Add(const Eigen::Vector3d& offset) {
    angles_.push_back(std::atan2(offset.dot(y_), offset.dot(x_)));
  }

  bool Close() {
    std::sort(angles_.begin(), angles_.end());
    double largest_gap = angles_.front() + 2 * std::numbers::pi - angles_.back();
    for (size_t i = 1; i < angles_.size(); ++i) {
      largest_gap = std::max(largest_gap, angles_[i] - angles_[i - 1]);
    }
    return largest_gap < std::numbers::pi;
  }

 private:
  Eigen::Vector3d x_;
  Eigen::Vector3d y_;
  std::vector<double> angles_;
};

}  // namespace

double BlendReach(const Surfels& surfels, const DiscRay& ray, uint32_t first) {
  const double cosine = std::abs(ray.direction.dot(surfels.normals[first].cast<double>()));
  return double{surfels.discs[first].w()} / std::max(cosine, kLeastCosine);
}

Blend BlendDiscs(const Surfels& surfels, const DiscRay& ray, uint32_t first,
                 std::span<const uint32_t> discs, double rounding) {
  const DiscHit front = MeetDisc(surfels, ray, first);
  const double front_variance = Variance(surfels, first);
  Surroundings surroundings(front.normal);
  double last_t = front.t;
  int members = 0;
  double sum = 0;
  double sum_height = 0;  // behind the front plane, along its normal
  double sum_square = 0;
  double sum_variance = 0;
  Eigen::Vector3d sum_normal = Eigen::Vector3d::Zero();
  uint32_t nearest = first;
  double nearest_squared = std::numeric_limits<double>::infinity();
  for (const uint32_t disc : discs) {
    const DiscHit hit = disc == first ? front : MeetDisc(surfels, ray, disc);
    const double height = (hit.t - front.t) * front.cosine;
    const double variance = Variance(surfels, disc);
    if (!(std::abs(height) <= kSigmas * std::sqrt(front_variance + variance) + rounding)) continue;
    last_t = std::max(last_t, hit.t);
    const double squared_distance = hit.offset.squaredNorm();
    const double weight = 1 / (variance + rounding * rounding);
    ++members;
    sum += weight;
    sum_height += weight * height;
    sum_square += weight * height * height;
    sum_variance += weight * variance;
    sum_normal += weight * hit.normal;
    surroundings.Add(hit.offset);
    if (squared_distance < nearest_squared) {
      nearest = disc;
      nearest_squared = squared_distance;
    }
  }
  if (members == 0 || !surroundings.Close()) return {std::nullopt, last_t};
  const double height = sum_height / sum;
  const double spread = std::max(sum_square / sum - height * height, 0.0);
  return {
      BlendedHit{front.t + height / front.cosine, std::sqrt(spread + sum_variance / sum / members),
                 sum_normal.normalized(), nearest},
      last_t};
}

}  // namespace raylift
