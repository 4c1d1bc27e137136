#include "localization/alignment/scene_edges.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "base/rng.h"
#include "base/statistics.h"
#include <Eigen/Eigenvalues>

namespace raylift {
namespace {

// Half of the pixels across a crease whose normals are averaged on either side.
constexpr int kSide = 3;
// The least edges, as smaller ones are rarely seen: a turn of the surface by this angle, a jump by
// this share of the distance.
constexpr double kLeastTurnDeg = 12;
constexpr double kLeastJump = 0.02;
// Edges must be this many times as strong as the median of all places, which the roughness of the
// mesh makes.
constexpr double kAboveRoughness = 5;
// The medians are over every so manieth line.
constexpr int kLinesPerMedian = 4;
// The direction of an edge follows from its pieces within this distance.
constexpr int kAlongPx = 3;

// A position between two neighboring pixels.
struct Crossing {
  Eigen::Vector2f place_px;
  float distance;  // of the nearer side
  SceneEdgeKind kind;
};

// The strengths of edges along one row or column of the frame.
class Strengths {
 public:
  Strengths(const Frame& frame, bool along_x)
      : frame_(frame),
        step_(along_x ? 1 : static_cast<size_t>(frame.width_px)),
        size_(along_x ? frame.width_px : frame.height_px) {}

  int size() const { return size_; }
  size_t At(size_t begin, int i) const { return begin + static_cast<size_t>(i) * step_; }
  bool Hit(size_t begin, int i) const {
    return i >= 0 && i < size_ && frame_.distance[At(begin, i)] > 0;
  }
  double Inverse(size_t begin, int i) const { return 1.0 / frame_.distance[At(begin, i)]; }

  // Returns the jump between i and i + 1 beyond the slopes on both sides, as a share of the nearer
  // one's inverse distance.
  double Jump(size_t begin, int i) const {
    const double a = Inverse(begin, i);
    const double b = Inverse(begin, i + 1);
    double jump = std::abs(b - a);
    if (Hit(begin, i - 1)) jump = std::min(jump, std::abs(b - a - (a - Inverse(begin, i - 1))));
    if (Hit(begin, i + 2)) jump = std::min(jump, std::abs(b - a - (Inverse(begin, i + 2) - b)));
    return jump / std::max(a, b);
  }

  // Returns 1 - cos of the turn of the surface between i and i + 1.
  double Turn(size_t begin, int i) const {
    bool is_flat = true;
    for (int k = 1 - kSide; is_flat && k < kSide; ++k) is_flat = HaveOneNormal(begin, i + k);
    if (is_flat) return 0;
    return 1 - Normal(begin, i, -1).dot(Normal(begin, i + 1, 1));
  }

 private:
  bool HaveOneNormal(size_t begin, int i) const {
    if (!Hit(begin, i) || !Hit(begin, i + 1)) return false;
    const float* first = &frame_.normals[3 * At(begin, i)];
    return std::equal(first, first + 3, &frame_.normals[3 * At(begin, i + 1)]);
  }

  Eigen::Vector3d Normal(size_t begin, int from, int sign) const {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (int k = 0; k < kSide && Hit(begin, from + sign * k); ++k) {
      sum += Eigen::Map<const Eigen::Vector3f>(&frame_.normals[3 * At(begin, from + sign * k)])
                 .cast<double>();
    }
    return sum.normalized();
  }

  const Frame& frame_;
  size_t step_;
  int size_;
};

double Median(std::vector<float> values) {
  return values.empty() ? 0 : UpperMedianInPlace(std::span(values));
}

// Finds the crossings of one direction.
class CrossingFinder {
 public:
  CrossingFinder(const Frame& frame, bool along_x)
      : frame_(frame), along_x_(along_x), strengths_(frame, along_x) {
    const size_t count = frame.distance.size();
    jump_.assign(count, -1);
    turn_.assign(count, -1);
    std::vector<float> jumps;
    std::vector<float> turns;
    ForEachLine([&](size_t begin, int line) {
      for (int i = 0; i + 1 < strengths_.size(); ++i) {
        if (!strengths_.Hit(begin, i) || !strengths_.Hit(begin, i + 1)) continue;
        const size_t at = strengths_.At(begin, i);
        jump_[at] = static_cast<float>(strengths_.Jump(begin, i));
        turn_[at] = static_cast<float>(strengths_.Turn(begin, i));
        if (line % kLinesPerMedian != 0) continue;
        jumps.push_back(jump_[at]);
        turns.push_back(turn_[at]);
      }
    });
    least_jump_ = std::max(kLeastJump, kAboveRoughness * Median(std::move(jumps)));
    const double rough = std::acos(std::clamp(1 - Median(std::move(turns)), -1.0, 1.0));
    const double least_turn =
        std::max(kLeastTurnDeg * std::numbers::pi / 180, kAboveRoughness * rough);
    least_turn_ = 1 - std::cos(std::min(least_turn, std::numbers::pi / 2));
  }

  void AddTo(std::vector<Crossing>& crossings) const {
    ForEachLine([&](size_t begin, int line) {
      for (int i = 0; i + 1 < strengths_.size(); ++i) {
        const auto kind = KindAt(begin, i);
        if (!kind) continue;
        const float a = frame_.distance[strengths_.At(begin, i)];
        const float b = frame_.distance[strengths_.At(begin, i + 1)];
        const float nearer = a > 0 && b > 0 ? std::min(a, b) : std::max(a, b);
        const Eigen::Vector2f place(static_cast<float>(i) + 1, static_cast<float>(line) + 0.5f);
        crossings.push_back({along_x_ ? place : Eigen::Vector2f(place.y(), place.x()),
                             *kind == SceneEdgeKind::kCrease ? 0.5f * (a + b) : nearer, *kind});
      }
    });
  }

 private:
  template <typename Body>
  void ForEachLine(const Body& body) const {
    const int lines = along_x_ ? frame_.height_px : frame_.width_px;
    for (int line = 0; line < lines; ++line) {
      body(static_cast<size_t>(line) * static_cast<size_t>(along_x_ ? frame_.width_px : 1), line);
    }
  }

  std::optional<SceneEdgeKind> KindAt(size_t begin, int i) const {
    const bool first = strengths_.Hit(begin, i);
    const bool second = strengths_.Hit(begin, i + 1);
    if (!first && !second) return std::nullopt;
    if (first != second) return SceneEdgeKind::kSkyline;
    const size_t at = strengths_.At(begin, i);
    if (jump_[at] > least_jump_) return SceneEdgeKind::kOccluding;
    if (!(turn_[at] > least_turn_)) return std::nullopt;
    // The sharpest of those around it, the first among equals; none beside a jump.
    for (int k = 1 - kSide; k < kSide; ++k) {
      if (k == 0 || i + k < 0 || i + k + 1 >= strengths_.size()) continue;
      const size_t beside = strengths_.At(begin, i + k);
      if (turn_[beside] < 0 || jump_[beside] > least_jump_) return std::nullopt;
      if (k < 0 ? turn_[beside] >= turn_[at] : turn_[beside] > turn_[at]) return std::nullopt;
    }
    return SceneEdgeKind::kCrease;
  }

  const Frame& frame_;
  bool along_x_;
  Strengths strengths_;
  std::vector<float> jump_, turn_;
  double least_jump_ = 0, least_turn_ = 0;
};

// Finds crossings by the pixel that they lie in.
class CrossingGrid {
 public:
  CrossingGrid(const std::vector<Crossing>& crossings, int width, int height)
      : crossings_(crossings), width_(width), height_(height) {
    first_.assign(static_cast<size_t>(width) * static_cast<size_t>(height) + 1, 0);
    for (const Crossing& crossing : crossings) ++first_[Cell(crossing) + 1];
    for (size_t i = 1; i < first_.size(); ++i) first_[i] += first_[i - 1];
    std::vector<uint32_t> next(first_.begin(), first_.end() - 1);
    order_.resize(crossings.size());
    for (uint32_t i = 0; i < crossings.size(); ++i) order_[next[Cell(crossings[i])]++] = i;
  }

  // Returns the direction of the edge through a crossing; nullopt where it has none (a corner).
  std::optional<Eigen::Vector2f> TangentAt(const Crossing& crossing) const {
    Eigen::Vector2f mean = Eigen::Vector2f::Zero();
    Eigen::Matrix2f moments = Eigen::Matrix2f::Zero();
    int count = 0;
    ForEachNear(crossing, [&](const Crossing& near) {
      const Eigen::Vector2f from = near.place_px - crossing.place_px;
      mean += from;
      moments += from * from.transpose();
      ++count;
    });
    // A straight edge is crossed at least once per pixel.
    if (count < 2 * kAlongPx - 1) return std::nullopt;
    mean /= static_cast<float>(count);
    const Eigen::Matrix2f scatter = moments / static_cast<float>(count) - mean * mean.transpose();
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2f> axes(scatter);
    constexpr float kMostWidth = 0.15f;  // across over along, squared
    if (axes.eigenvalues()[0] > kMostWidth * axes.eigenvalues()[1]) return std::nullopt;
    return axes.eigenvectors().col(1);
  }

 private:
  size_t Cell(const Crossing& crossing) const {
    const int x = std::min(static_cast<int>(crossing.place_px.x()), width_ - 1);
    const int y = std::min(static_cast<int>(crossing.place_px.y()), height_ - 1);
    return static_cast<size_t>(y) * static_cast<size_t>(width_) + static_cast<size_t>(x);
  }

  template <typename Body>
  void ForEachNear(const Crossing& crossing, const Body& body) const {
    const int x = static_cast<int>(crossing.place_px.x());
    const int y = static_cast<int>(crossing.place_px.y());
    for (int row = std::max(0, y - kAlongPx); row <= std::min(height_ - 1, y + kAlongPx); ++row) {
      const size_t begin = static_cast<size_t>(row) * static_cast<size_t>(width_);
      const size_t from = begin + static_cast<size_t>(std::max(0, x - kAlongPx));
      const size_t to = begin + static_cast<size_t>(std::min(width_ - 1, x + kAlongPx));
      for (uint32_t i = first_[from]; i < first_[to + 1]; ++i) {
        const Crossing& near = crossings_[order_[i]];
        if (near.kind != crossing.kind) continue;
        if ((near.place_px - crossing.place_px).squaredNorm() > kAlongPx * kAlongPx) continue;
        body(near);
      }
    }
  }

  const std::vector<Crossing>& crossings_;
  int width_, height_;
  std::vector<uint32_t> first_, order_;
};

// Returns the edge through a crossing, by its ray and that of a place a little further along the
// edge.
std::optional<SceneEdge> EdgeAt(const Crossing& crossing, const Eigen::Vector2f& tangent_px,
                                const PixelRays& rays, const Rigid3& world_from_cam) {
  const int x = static_cast<int>(crossing.place_px.x());
  const int y = static_cast<int>(crossing.place_px.y());
  const int x0 = std::clamp(x, 0, rays.width_px() - 1);
  const int y0 = std::clamp(y, 0, rays.height_px() - 1);
  const auto base = rays.RayInCam(x0, y0);
  if (!base) return std::nullopt;
  const PixelRays::Differential change = rays.DifferentialAt(x0, y0);
  const Eigen::Vector2f offset = crossing.place_px - Eigen::Vector2f(static_cast<float>(x0) + 0.5f,
                                                                     static_cast<float>(y0) + 0.5f);
  const Eigen::Vector3d ray =
      (*base + (offset.x() * change.along_x + offset.y() * change.along_y).cast<double>())
          .normalized();
  Eigen::Vector3d tangent =
      (tangent_px.x() * change.along_x + tangent_px.y() * change.along_y).cast<double>();
  tangent -= tangent.dot(ray) * ray;
  if (!(tangent.norm() > 0)) return std::nullopt;
  // A piece of an edge of slope (c, s) is crossed |c| + |s| times per pixel of its length.
  const double length = 1 / (std::abs(tangent_px.x()) + std::abs(tangent_px.y()));
  return SceneEdge{world_from_cam * (double{crossing.distance} * ray),
                   world_from_cam.rotation * tangent.normalized(), length, crossing.kind};
}

}  // namespace

FrameOptions FrameOfEdges() {
  FrameOptions options;
  options.distance = true;
  options.normals = true;
  return options;
}

std::vector<SceneEdge> SceneEdges(const Frame& frame, const PixelRays& rays,
                                  const Rigid3& cam_from_world, size_t most) {
  std::vector<Crossing> crossings;
  for (const bool along_x : {true, false}) CrossingFinder(frame, along_x).AddTo(crossings);
  const CrossingGrid grid(crossings, frame.width_px, frame.height_px);
  std::vector<uint32_t> order(crossings.size());
  for (uint32_t i = 0; i < order.size(); ++i) order[i] = i;
  Rng rng(order.size());
  const size_t count = std::min(most, order.size());
  const Rigid3 world_from_cam = cam_from_world.Inverse();
  std::vector<SceneEdge> edges;
  for (size_t i = 0; i < count; ++i) {
    std::swap(order[i], order[i + rng.UniformIndex(static_cast<uint32_t>(order.size() - i))]);
    const Crossing& crossing = crossings[order[i]];
    const auto tangent = grid.TangentAt(crossing);
    if (!tangent) continue;
    if (auto edge = EdgeAt(crossing, *tangent, rays, world_from_cam)) edges.push_back(*edge);
  }
  const double share =
      count == 0 ? 1 : static_cast<double>(order.size()) / static_cast<double>(count);
  for (SceneEdge& edge : edges) edge.length_px *= share;
  return edges;
}

}  // namespace raylift
