#include "lifting/frame_alignment.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "base/statistics.h"
#include <Eigen/Geometry>
#include <Eigen/SVD>

#include "raylift/base/error.h"

namespace raylift {
namespace {

constexpr double kMaxRotationDeg = 15;  // networks' rotations are good to a few degrees
constexpr double kMaxSigmas = 3;
constexpr size_t kFewestCameras = 3;
constexpr size_t kMaxPairs = 5000;

struct Similarity {
  double scale;
  Eigen::Matrix3d rotation;
  Eigen::Vector3d translation;
};

Eigen::Matrix3d NearestRotation(const Eigen::Matrix3d& matrix) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(matrix, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d signs = Eigen::Vector3d::Ones();
  signs.z() = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0 ? -1 : 1;
  return svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
}

class Cameras {
 public:
  Cameras(std::span<const Rigid3> cam_from_frame, std::span<const Rigid3> cam_from_world) {
    for (size_t i = 0; i < cam_from_frame.size(); ++i) {
      in_frame_.push_back(cam_from_frame[i].OriginInSource());
      in_world_.push_back(cam_from_world[i].OriginInSource());
      world_from_frame_.emplace_back(cam_from_world[i].rotation.conjugate() *
                                     cam_from_frame[i].rotation);
    }
  }

  size_t size() const { return in_frame_.size(); }

  // Returns the similarity by two cameras: their distance gives the scale, the first one the
  // rotation, and their middle the translation. nullopt where the two are in one place.
  std::optional<Similarity> FromPair(size_t a, size_t b) const {
    const double length_in_frame = (in_frame_[a] - in_frame_[b]).norm();
    const double length_in_world = (in_world_[a] - in_world_[b]).norm();
    if (!(length_in_frame > 0) || !(length_in_world > 0)) return std::nullopt;
    const double scale = length_in_world / length_in_frame;
    const Eigen::Matrix3d rotation = world_from_frame_[a].toRotationMatrix();
    const Eigen::Vector3d middle_in_frame = 0.5 * (in_frame_[a] + in_frame_[b]);
    const Eigen::Vector3d middle_in_world = 0.5 * (in_world_[a] + in_world_[b]);
    return Similarity{scale, rotation, middle_in_world - scale * (rotation * middle_in_frame)};
  }

  // Returns the distances of the centers from where they should be, infinite where a camera is
  // turned.
  std::vector<double> Errors(const Similarity& similarity) const {
    const Eigen::Quaterniond rotation(similarity.rotation);
    std::vector<double> errors;
    for (size_t i = 0; i < size(); ++i) {
      const bool agrees = AngleBetweenDeg(rotation, world_from_frame_[i]) <= kMaxRotationDeg;
      errors.push_back(agrees ? (similarity.scale * (similarity.rotation * in_frame_[i]) +
                                 similarity.translation - in_world_[i])
                                    .norm()
                              : INFINITY);
    }
    return errors;
  }

  // Returns the similarity that fits some of the cameras by least squares: the rotation follows
  // from centers and rotations alike, as centers on a line leave it open.
  Similarity Fit(const std::vector<size_t>& some) const {
    const Eigen::Matrix3Xd in_frame = Columns(in_frame_, some), in_world = Columns(in_world_, some);
    const Eigen::Vector3d mean_in_frame = in_frame.rowwise().mean();
    const Eigen::Vector3d mean_in_world = in_world.rowwise().mean();
    const Eigen::Matrix3Xd x = in_frame.colwise() - mean_in_frame;
    const Eigen::Matrix3Xd y = in_world.colwise() - mean_in_world;
    Eigen::Matrix3d sum = y * x.transpose() / (x.norm() * y.norm());
    for (const size_t i : some) {
      sum += world_from_frame_[i].toRotationMatrix() / static_cast<double>(some.size());
    }
    const Eigen::Matrix3d rotation = NearestRotation(sum);
    const double scale = y.cwiseProduct(rotation * x).sum() / x.squaredNorm();
    return {scale, rotation, mean_in_world - scale * (rotation * mean_in_frame)};
  }

  // Return the square root of the sum of squared distances from the mean.
  double Spread(const std::vector<size_t>& some) const { return SpreadOf(in_world_, some); }
  double SpreadInFrame(const std::vector<size_t>& some) const { return SpreadOf(in_frame_, some); }

 private:
  static double SpreadOf(const std::vector<Eigen::Vector3d>& points,
                         const std::vector<size_t>& some) {
    const Eigen::Matrix3Xd columns = Columns(points, some);
    return (columns.colwise() - columns.rowwise().mean()).norm();
  }
  static Eigen::Matrix3Xd Columns(const std::vector<Eigen::Vector3d>& points,
                                  const std::vector<size_t>& some) {
    Eigen::Matrix3Xd columns(3, some.size());
    for (size_t i = 0; i < some.size(); ++i) {
      columns.col(static_cast<Eigen::Index>(i)) = points[some[i]];
    }
    return columns;
  }

  std::vector<Eigen::Vector3d> in_frame_, in_world_;
  std::vector<Eigen::Quaterniond> world_from_frame_;
};

// A distance has three components: its median is 1.538 standard deviations of one.
constexpr double kMedianDistancePerSigma = 1.538;

std::optional<Similarity> LeastMedian(const Cameras& cameras) {
  const size_t count = cameras.size();
  size_t step = 1 + count * (count - 1) / kMaxPairs;
  while (std::gcd(step, count) > 1 && step > 1) ++step;  // else few cameras would be in all pairs
  std::optional<Similarity> best;
  double least = INFINITY;
  for (size_t pair = 0; pair < count * count; pair += step) {
    const size_t a = pair / count, b = pair % count;
    const auto similarity = a == b ? std::nullopt : cameras.FromPair(a, b);
    if (!similarity) continue;
    const double median = UpperMedianOr(cameras.Errors(*similarity), INFINITY);
    if (median < least) {
      least = median;
      best = similarity;
    }
  }
  return best;
}

std::vector<size_t> Agreeing(const std::vector<double>& errors, double sigma, double spread) {
  constexpr double kRounding = 1e-6;  // of poses that are floats
  std::vector<size_t> agreeing;
  for (size_t i = 0; i < errors.size(); ++i) {
    if (errors[i] <= kMaxSigmas * sigma + kRounding * spread) agreeing.push_back(i);
  }
  return agreeing;
}

}  // namespace

std::optional<FrameAlignment> AlignFrame(std::span<const Rigid3> cam_from_frame,
                                         std::span<const Rigid3> cam_from_world) {
  RAYLIFT_CHECK_EQ(cam_from_frame.size(), cam_from_world.size());
  const Cameras cameras(cam_from_frame, cam_from_world);
  auto similarity = LeastMedian(cameras);
  if (!similarity) return std::nullopt;
  FrameAlignment alignment;
  for (int round = 0; round < 3; ++round) {
    const std::vector<double> errors = cameras.Errors(*similarity);
    const double sigma = UpperMedianOr(errors, INFINITY) / kMedianDistancePerSigma;
    if (!std::isfinite(sigma)) return std::nullopt;  // half of the cameras are turned
    std::vector<size_t> all(errors.size());
    for (size_t i = 0; i < all.size(); ++i) all[i] = i;
    const auto agreeing = Agreeing(errors, sigma, cameras.Spread(all));
    if (agreeing.size() < kFewestCameras || 2 * agreeing.size() < cameras.size()) {
      return std::nullopt;
    }
    similarity = cameras.Fit(agreeing);
    // Centers that have nothing to do with each other fit best where they shrink to one place.
    const double spread = similarity->scale * cameras.SpreadInFrame(agreeing);
    if (!(spread > kMaxSigmas * sigma)) return std::nullopt;
    alignment = {similarity->scale, sigma / spread, sigma, agreeing.size()};
  }
  return alignment;
}

}  // namespace raylift
