#include "comparison/surface_distance.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"

namespace raylift {
namespace {

constexpr size_t kLeafSize = 4;

// Mixes by the finalizer of splitmix64.
uint64_t MixIn(uint64_t hash, int64_t value) {
  uint64_t x = hash + 0x9e3779b97f4a7c15ULL + static_cast<uint64_t>(value);
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
  return x ^ (x >> 31);
}

// Returns the squared distance of a point to a triangle, which may be a segment or a point
// (Ericson, "Real-Time Collision Detection", 5.1.5).
double SquaredDistanceToTriangle(const Eigen::Vector3d& point, const Eigen::Vector3d& a,
                                 const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
  const Eigen::Vector3d ab = b - a, ac = c - a, ap = point - a;
  const double d1 = ab.dot(ap), d2 = ac.dot(ap);
  if (d1 <= 0 && d2 <= 0) return ap.squaredNorm();
  const Eigen::Vector3d bp = point - b;
  const double d3 = ab.dot(bp), d4 = ac.dot(bp);
  if (d3 >= 0 && d4 <= d3) return bp.squaredNorm();
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) {
    return (ap - d1 / (d1 - d3) * ab).squaredNorm();
  }
  const Eigen::Vector3d cp = point - c;
  const double d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d6 >= 0 && d5 <= d6) return cp.squaredNorm();
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) {
    return (ap - d2 / (d2 - d6) * ac).squaredNorm();
  }
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) {
    const double w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
    return (bp - w * (c - b)).squaredNorm();
  }
  const double sum = va + vb + vc;
  return (ap - vb / sum * ab - vc / sum * ac).squaredNorm();
}

}  // namespace

SurfaceTree::SurfaceTree(const TriangleMesh& mesh) {
  corners_.reserve(mesh.vertices.size());
  for (const Eigen::Vector3f& vertex : mesh.vertices) {
    corners_.push_back(mesh.origin_in_world + vertex.cast<double>());
  }
  triangles_.assign(mesh.triangles.begin(), mesh.triangles.end());
  Build();
}

SurfaceTree::SurfaceTree(std::span<const Eigen::Vector3d> points)
    : corners_(points.begin(), points.end()) {
  triangles_.reserve(corners_.size());
  for (uint32_t i = 0; i < corners_.size(); ++i) triangles_.push_back({i, i, i});
  Build();
}

void SurfaceTree::Build() {
  if (triangles_.empty()) return;
  std::vector<Eigen::Vector3d> centers;
  centers.reserve(triangles_.size());
  for (const Triangle& t : triangles_) {
    centers.push_back((corners_[t[0]] + corners_[t[1]] + corners_[t[2]]) / 3);
  }
  nodes_.reserve(2 * triangles_.size() / kLeafSize + 1);
  BuildNode(0, triangles_.size(), centers);
}

// Splits at the median along the longest side of the box.
void SurfaceTree::BuildNode(size_t begin, size_t end, std::vector<Eigen::Vector3d>& centers) {
  const size_t index = nodes_.size();
  nodes_.emplace_back();
  Eigen::AlignedBox3d box, box_of_centers;
  for (size_t i = begin; i < end; ++i) {
    for (const uint32_t corner : triangles_[i]) box.extend(corners_[corner]);
    box_of_centers.extend(centers[i]);
  }
  nodes_[index].box = box;
  if (end - begin <= kLeafSize) {
    nodes_[index].first = static_cast<uint32_t>(begin);
    nodes_[index].count = static_cast<uint32_t>(end - begin);
    return;
  }
  int axis = 0;
  box_of_centers.sizes().maxCoeff(&axis);
  const size_t middle = begin + (end - begin) / 2;
  std::vector<size_t> order(end - begin);
  std::iota(order.begin(), order.end(), begin);
  std::nth_element(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(middle - begin),
                   order.end(), [&](size_t a, size_t b) {
                     return std::pair(centers[a][axis], a) < std::pair(centers[b][axis], b);
                   });
  std::vector<Triangle> triangles;
  std::vector<Eigen::Vector3d> moved;
  for (const size_t i : order) {
    triangles.push_back(triangles_[i]);
    moved.push_back(centers[i]);
  }
  std::copy(triangles.begin(), triangles.end(),
            triangles_.begin() + static_cast<std::ptrdiff_t>(begin));
  std::copy(moved.begin(), moved.end(), centers.begin() + static_cast<std::ptrdiff_t>(begin));
  BuildNode(begin, middle, centers);
  nodes_[index].first = static_cast<uint32_t>(nodes_.size());
  BuildNode(middle, end, centers);
}

double SurfaceTree::Distance(const Eigen::Vector3d& point, double max_distance) const {
  double best = max_distance * max_distance;
  if (nodes_.empty()) return max_distance;
  constexpr size_t kMaxDepth = 64;
  std::array<uint32_t, kMaxDepth> stack{};
  size_t depth = 0;
  stack[depth++] = 0;
  while (depth > 0) {
    const uint32_t index = stack[--depth];
    const Node& node = nodes_[index];
    if (node.box.squaredExteriorDistance(point) >= best) continue;
    if (node.count > 0) {
      for (uint32_t i = node.first; i < node.first + node.count; ++i) {
        const auto& [a, b, c] = triangles_[i];
        best =
            std::min(best, SquaredDistanceToTriangle(point, corners_[a], corners_[b], corners_[c]));
      }
      continue;
    }
    uint32_t near = index + 1, far = node.first;
    if (nodes_[far].box.squaredExteriorDistance(point) <
        nodes_[near].box.squaredExteriorDistance(point)) {
      std::swap(near, far);
    }
    stack[depth++] = far;
    stack[depth++] = near;
  }
  return std::sqrt(best);
}

ThinnedCloud::ThinnedCloud(double cell_size, size_t max_points)
    : cell_size_(cell_size), max_points_(max_points) {
  RAYLIFT_CHECK(cell_size > 0 && max_points > 0);
}

void ThinnedCloud::Add(std::span<const Eigen::Vector3d> points) {
  for (const Eigen::Vector3d& point : points) {
    const Eigen::Vector3d scaled = point / cell_size_;
    if (!(scaled.cwiseAbs().maxCoeff() < 1e15)) continue;
    uint64_t cell = 0;
    for (const double coordinate : scaled) {
      cell = MixIn(cell, static_cast<int64_t>(std::floor(coordinate)));
    }
    if (cell > largest_cell_ || !cells_.insert(cell).second) continue;
    points_.push_back(point);
    cell_of_point_.push_back(cell);
    while (points_.size() > max_points_) GiveUpHalf();
  }
}

void ThinnedCloud::GiveUpHalf() {
  largest_cell_ /= 2;
  size_t kept = 0;
  for (size_t i = 0; i < points_.size(); ++i) {
    if (cell_of_point_[i] > largest_cell_) {
      cells_.erase(cell_of_point_[i]);
      continue;
    }
    points_[kept] = points_[i];
    cell_of_point_[kept] = cell_of_point_[i];
    ++kept;
  }
  points_.resize(kept);
  cell_of_point_.resize(kept);
}

namespace {

constexpr int kPixelStride = 4;
// Shares of so many points are known to a fifth of a percent.
constexpr size_t kMaxPoints = 100000;
constexpr size_t kBlock = 4096;

// Returns the distance below which points count as one.
double CellSize(std::span<const double> thresholds) { return 0.5 * thresholds.front(); }

// Returns the distance beyond which all distances count alike.
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
