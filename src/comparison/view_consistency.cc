#include "comparison/view_consistency.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/index_sets.h"
#include "base/statistics.h"
#include "lifting/source_view.h"

#include "raylift/base/parallel.h"

namespace raylift {
namespace {

constexpr int kOverlapPixels = 120;
constexpr size_t kCandidates = 60;
constexpr double kMinOverlap = 0.2;
constexpr double kSameSurface = 0.25;
constexpr size_t kMinPairPixels = 30;
constexpr double kMaxScaleCost = 0.1;
constexpr double kSampleShareOfScale = 0.3;
constexpr int kSamples = 800;  // pixels per image, on a grid
// Factors that are tried on all depths at once, to find the common scale.
constexpr double kMaxLogScale = 0.24;
constexpr int kScaleSteps = 13;

std::vector<Eigen::Vector3d> PointsOf(const GeometrySource& source, const PosedImage& image,
                                      int count) {
  std::vector<Eigen::Vector3d> points;
  for (const auto& point : source.Lift(image, GridPixels(image.camera, count))) {
    if (point) points.push_back(point->point_in_world);
  }
  return points;
}

std::vector<size_t> NearestImages(std::span<const PosedImage> images, size_t image) {
  const Eigen::Vector3d center = images[image].cam_from_world.OriginInSource();
  std::vector<std::pair<double, size_t>> others;
  for (size_t i = 0; i < images.size(); ++i) {
    if (i == image) continue;
    others.emplace_back((images[i].cam_from_world.OriginInSource() - center).squaredNorm(), i);
  }
  return Nearest(std::move(others), kCandidates);
}

// Returns rho of every point that falls on depth in the other image.
std::vector<double> RhosIn(const GeometrySource& source, const PosedImage& other,
                           std::span<const Eigen::Vector3d> points, double depth_factor) {
  std::vector<Eigen::Vector2d> pixels;
  std::vector<double> depths;
  for (const Eigen::Vector3d& point : points) {
    const Eigen::Vector3d in_cam = other.cam_from_world * point;
    const auto pixel = other.camera.ImgFromCam(in_cam);
    if (!pixel || !other.camera.Contains(*pixel) || !(in_cam.z() > 0)) continue;
    pixels.push_back(*pixel);
    depths.push_back(in_cam.z());
  }
  std::vector<double> rhos;
  const auto there = source.Lift(other, pixels);
  for (size_t i = 0; i < there.size(); ++i) {
    if (there[i] && there[i]->depth_z > 0) {
      rhos.push_back(std::log(depths[i] / (depth_factor * there[i]->depth_z)));
    }
  }
  return rhos;
}

std::optional<PairConsistency> SummarizePair(size_t other, std::span<const double> rhos) {
  std::vector<double> close;
  for (const double rho : rhos) {
    if (std::abs(rho) < kSameSurface) close.push_back(rho);
  }
  if (close.size() < kMinPairPixels) return std::nullopt;
  return PairConsistency{other, close.size(), MidpointMedianInPlace(std::span(close))};
}

double LogScaleOfStep(int step) { return kMaxLogScale * (2.0 * step / (kScaleSteps - 1) - 1); }

}  // namespace

std::vector<std::vector<size_t>> FindOverlaps(const GeometrySource& source,
                                              std::span<const PosedImage> images, int max_overlaps,
                                              int threads) {
  std::vector<std::vector<size_t>> overlaps(images.size());
  ParallelFor(images.size(), threads, [&](size_t i) {
    const auto points = PointsOf(source, images[i], kOverlapPixels);
    if (points.empty()) return;
    std::vector<std::pair<double, size_t>> shares;
    for (const size_t other : NearestImages(images, i)) {
      size_t seen = 0;
      for (const Eigen::Vector3d& point : points) seen += images[other].Sees(point) ? 1 : 0;
      const double share = static_cast<double>(seen) / static_cast<double>(points.size());
      if (share >= kMinOverlap) shares.emplace_back(-share, other);
    }
    std::sort(shares.begin(), shares.end());
    // Every second of the best ones: the best alone are those with the smallest baselines, which
    // say the least.
    const auto wanted = static_cast<size_t>(max_overlaps);
    const size_t stride = shares.size() >= 2 * wanted ? 2 : 1;
    for (size_t k = 0; k < shares.size() && overlaps[i].size() < wanted; k += stride) {
      overlaps[i].push_back(shares[k].second);
    }
  });
  return overlaps;
}

ImageConsistency MeasureConsistency(const GeometrySource& source,
                                    std::span<const PosedImage> images, size_t image,
                                    std::span<const size_t> others) {
  ImageConsistency result;
  result.cost_of_scale.assign(static_cast<size_t>(kScaleSteps), 0);
  const PosedImage& own = images[image];
  const auto points = PointsOf(source, own, kSamples);
  const auto few = PointsOf(source, own, static_cast<int>(kSamples * kSampleShareOfScale));
  const Eigen::Vector3d center = own.cam_from_world.OriginInSource();
  std::vector<double> all;
  for (const size_t other : others) {
    const auto rhos = RhosIn(source, images[other], points, 1);
    all.insert(all.end(), rhos.begin(), rhos.end());
    if (const auto pair = SummarizePair(other, rhos)) result.pairs.push_back(*pair);
    for (int step = 0; step < kScaleSteps; ++step) {
      const double factor = std::exp(LogScaleOfStep(step));
      std::vector<Eigen::Vector3d> scaled = few;
      for (Eigen::Vector3d& point : scaled) point = center + factor * (point - center);
      const auto scaled_rhos = RhosIn(source, images[other], scaled, factor);
      double cost = kMaxScaleCost * static_cast<double>(few.size() - scaled_rhos.size());
      for (const double rho : scaled_rhos) cost += std::min(std::abs(rho), kMaxScaleCost);
      result.cost_of_scale[static_cast<size_t>(step)] += cost;
    }
  }
  result.count = all.size();
  if (all.empty()) return result;
  constexpr std::array<double, 3> kWithin = {0.01, 0.02, 0.05};
  std::array<size_t, 3> within = {0, 0, 0};
  size_t contradicted = 0, behind = 0;
  for (const double rho : all) {
    contradicted += rho < -kWithin[2];
    behind += rho > kWithin[2];
    for (size_t k = 0; k < within.size(); ++k) within[k] += std::abs(rho) < kWithin[k];
  }
  for (size_t k = 0; k < within.size(); ++k) {
    result.within_percent[k] = Percent(within[k], all.size());
  }
  result.contradicted_percent = Percent(contradicted, all.size());
  result.behind_percent = Percent(behind, all.size());
  return result;
}

std::vector<std::optional<double>> RelativeLogScales(std::span<const ImageConsistency> images) {
  std::vector<std::optional<double>> scales(images.size());
  std::vector<bool> has_pair(images.size(), false);
  for (size_t i = 0; i < images.size(); ++i) {
    for (const PairConsistency& pair : images[i].pairs) {
      has_pair[i] = has_pair[pair.other] = true;
    }
  }
  // Gauss-Seidel on the normal equations x_i = mean over its pairs of (x_j + rho_ij): the graph is
  // sparse, and thousands of images are no problem.
  std::vector<std::vector<std::pair<size_t, double>>> links(images.size());
  for (size_t i = 0; i < images.size(); ++i) {
    for (const PairConsistency& pair : images[i].pairs) {
      links[i].emplace_back(pair.other, pair.median_rho);
      links[pair.other].emplace_back(i, -pair.median_rho);
    }
  }
  std::vector<double> x(images.size(), 0);
  constexpr int kSweeps = 300;
  for (int sweep = 0; sweep < kSweeps; ++sweep) {
    for (size_t i = 0; i < x.size(); ++i) {
      if (links[i].empty()) continue;
      double sum = 0;
      for (const auto& [other, rho] : links[i]) sum += x[other] + rho;
      x[i] = sum / static_cast<double>(links[i].size());
    }
  }
  double mean = 0, count = 0;
  for (size_t i = 0; i < x.size(); ++i) {
    if (has_pair[i]) {
      mean += x[i];
      count += 1;
    }
  }
  for (size_t i = 0; i < x.size(); ++i) {
    if (has_pair[i]) scales[i] = x[i] - mean / count;
  }
  return scales;
}

std::optional<double> CommonLogScale(std::span<const ImageConsistency> images) {
  std::vector<double> cost(static_cast<size_t>(kScaleSteps), 0);
  for (const ImageConsistency& image : images) {
    for (size_t k = 0; k < image.cost_of_scale.size(); ++k) cost[k] += image.cost_of_scale[k];
  }
  const auto best = std::min_element(cost.begin(), cost.end());
  const double worst = *std::max_element(cost.begin(), cost.end());
  constexpr double kMinContrast = 0.15;
  if (!(worst > 0) || *best > (1 - kMinContrast) * worst) return std::nullopt;
  const auto k = static_cast<size_t>(best - cost.begin());
  double offset = 0;
  if (k > 0 && k + 1 < cost.size()) {
    const double curvature = cost[k - 1] - 2 * cost[k] + cost[k + 1];
    if (curvature > 0) offset = 0.5 * (cost[k - 1] - cost[k + 1]) / curvature;
  }
  const double step = 2 * kMaxLogScale / (kScaleSteps - 1);
  // The factor that repairs the depths is the inverse of that by which they are too large.
  return -(LogScaleOfStep(static_cast<int>(k)) + offset * step);
}

}  // namespace raylift
