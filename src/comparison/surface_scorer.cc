#include "surface_scorer.h"

#include <algorithm>
#include <utility>

#include "raylift/base/parallel.h"

namespace raylift {
namespace {

constexpr int kPixelStride = 4;
// Shares of so many points are known to a fifth of a percent.
constexpr size_t kMaxPoints = 100000;
constexpr size_t kBlock = 4096;

// Points closer than this say the same.
double CellSize(std::span<const double> thresholds) { return 0.5 * thresholds.front(); }

// Beyond it, distances are all the same.
double FarthestDistance(std::span<const double> thresholds) { return 2 * thresholds.back(); }

std::vector<Eigen::Vector3d> SampleTruth(const GeometrySource& truth,
                                         std::span<const PosedImage> views, double cell_size,
                                         int threads) {
  ThinnedCloud cloud(cell_size, kMaxPoints);
  const size_t batch = 4 * static_cast<size_t>(ResolveThreads(threads));
  for (size_t begin = 0; begin < views.size(); begin += batch) {
    std::vector<std::vector<Eigen::Vector3d>> points(std::min(batch, views.size() - begin));
    ParallelFor(points.size(), threads, [&](size_t k) {
      const PosedImage& view = views[begin + k];
      for (const auto& point : truth.Lift(view, ScoredPixels(view.camera))) {
        if (point) points[k].push_back(point->point_in_world);
      }
    });
    for (const auto& of_view : points) cloud.Add(of_view);
  }
  return cloud.points();
}

}  // namespace

SurfaceScorer::OfSource::OfSource(double cell_size) : cloud(cell_size, kMaxPoints) {}

SurfaceScorer::SurfaceScorer(const TriangleMesh& mesh, const GeometrySource& truth,
                             std::span<const PosedImage> views, size_t num_sources,
                             std::span<const double> thresholds, int threads)
    : thresholds_(thresholds.begin(), thresholds.end()),
      threads_(threads),
      surface_(mesh),
      samples_(SampleTruth(truth, views, CellSize(thresholds), threads)),
      sources_(num_sources, OfSource(CellSize(thresholds))) {
  for (OfSource& source : sources_) {
    source.from_truth.assign(samples_.size(), static_cast<float>(FarthestDistance(thresholds)));
  }
}

void SurfaceScorer::Add(std::span<const std::vector<Eigen::Vector3d>> points_of_source,
                        size_t truth) {
  std::vector<std::unique_ptr<const SurfaceTree>> trees(sources_.size());
  ParallelFor(sources_.size(), threads_, [&](size_t s) {
    if (s == truth || points_of_source[s].empty()) return;
    sources_[s].cloud.Add(points_of_source[s]);
    trees[s] = std::make_unique<const SurfaceTree>(points_of_source[s]);
  });
  const size_t blocks = (samples_.size() + kBlock - 1) / kBlock;
  ParallelFor(sources_.size() * blocks, threads_, [&](size_t item) {
    const size_t s = item / blocks, block = item % blocks;
    if (trees[s] == nullptr) return;
    for (size_t i = block * kBlock; i < std::min(samples_.size(), (block + 1) * kBlock); ++i) {
      float& distance = sources_[s].from_truth[i];
      distance = static_cast<float>(trees[s]->Distance(samples_[i], static_cast<double>(distance)));
    }
  });
}

std::vector<SurfaceScore> SurfaceScorer::Score(size_t source) const {
  const std::vector<Eigen::Vector3d>& points = sources_[source].cloud.points();
  if (points.empty()) return {};
  std::vector<float> to_truth(points.size());
  ParallelFor((points.size() + kBlock - 1) / kBlock, threads_, [&](size_t block) {
    for (size_t i = block * kBlock; i < std::min(points.size(), (block + 1) * kBlock); ++i) {
      to_truth[i] = static_cast<float>(surface_.Distance(points[i], FarthestDistance(thresholds_)));
    }
  });
  std::vector<SurfaceScore> scores;
  for (const double threshold : thresholds_) {
    scores.push_back(ComputeSurfaceScore(to_truth, sources_[source].from_truth, threshold));
  }
  return scores;
}

std::vector<Eigen::Vector2d> ScoredPixels(const Camera& camera) {
  std::vector<Eigen::Vector2d> pixels;
  for (int y = kPixelStride / 2; y < camera.height_px(); y += kPixelStride) {
    for (int x = kPixelStride / 2; x < camera.width_px(); x += kPixelStride) {
      pixels.emplace_back(x + 0.5, y + 0.5);
    }
  }
  return pixels;
}

}  // namespace raylift
