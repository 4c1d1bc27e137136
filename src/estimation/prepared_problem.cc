#include "estimation/prepared_problem.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>

#include "raylift/base/median.h"
#include "raylift/geometry/residuals.h"
#include "raylift/scene/keypoints.h"

namespace raylift {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

struct Frame {
  Vector3d origin = Vector3d::Zero();
  double scale = 1;
};

// Centred on the references that have matches and scaled by their spread; where they share one
// centre (or there are none) by the median distance of the 3D points.
Frame ChooseFrame(const PoseProblem& problem) {
  std::vector<bool> used(problem.references.size(), false);
  for (const Match2D2D& match : problem.matches_2d2d) {
    if (match.reference >= 0 && match.reference < static_cast<int>(used.size())) {
      used[match.reference] = true;
    }
  }
  std::vector<Vector3d> centres;
  for (size_t i = 0; i < used.size(); ++i) {
    const Vector3d centre = problem.references[i].cam_from_world.OriginInSource();
    if (used[i] && centre.allFinite()) {
      centres.push_back(centre);
    }
  }
  std::vector<Vector3d> points;
  for (const Match2D3D& match : problem.matches_2d3d) {
    if (match.point_in_world.allFinite()) {
      points.push_back(match.point_in_world);
    }
  }
  Frame frame;
  if (!centres.empty()) {
    // Differences to the first centre, as sums of large coordinates would lose digits.
    Vector3d sum = Vector3d::Zero();
    for (const Vector3d& c : centres) sum += c - centres[0];
    frame.origin = centres[0] + sum / static_cast<double>(centres.size());
    double squares = 0;
    for (const Vector3d& c : centres) squares += (c - frame.origin).squaredNorm();
    frame.scale = std::sqrt(squares / static_cast<double>(centres.size()));
  } else if (!points.empty()) {
    for (int axis = 0; axis < 3; ++axis) {
      std::vector<double> values;
      values.reserve(points.size());
      for (const Vector3d& p : points) values.push_back(p[axis]);
      frame.origin[axis] = UpperMedianOr(std::move(values), 0);
    }
    frame.scale = 0;
  }
  // A spread at the level of the coordinates' rounding is none.
  const double rounding = 1e-10 * frame.origin.norm();
  if (!(frame.scale > rounding) && !points.empty()) {
    std::vector<double> distances;
    distances.reserve(points.size());
    for (const Vector3d& p : points) distances.push_back((p - frame.origin).norm());
    frame.scale = UpperMedianOr(std::move(distances), 0);
  }
  if (!(frame.scale > rounding) || !std::isfinite(frame.scale)) {
    frame.scale = 1;
  }
  return frame;
}

std::optional<PreparedPoint> PreparePoint(const Camera& camera, const Match2D3D& match,
                                          const Frame& frame, double threshold_px,
                                          double point_sigma, int index) {
  if (!match.query_px.allFinite() || !match.point_in_world.allFinite()) {
    return std::nullopt;
  }
  const auto pixel_frame = MakePixelFrame(camera, match.query_px);
  if (!pixel_frame) {
    return std::nullopt;
  }
  PreparedPoint point;
  point.ray = pixel_frame->ray_from_image.col(2).normalized();
  point.image_from_ray = pixel_frame->image_from_ray;
  point.image_from_ray.topRows<2>() /= threshold_px;
  point.point = (match.point_in_world - frame.origin) / frame.scale;
  point.sigma = match.point_sigma.value_or(point_sigma) / frame.scale;
  // An isotropic error of the point shows in the image as an error of both pixel rows' mean scale.
  const double widened = kSigmasOfThreshold * point.sigma;
  point.spread = 0.5 * point.image_from_ray.topRows<2>().squaredNorm() * widened * widened;
  point.match = index;
  // A point so far away that float arithmetic would overflow cannot be told from none.
  if (!(point.point.norm() < 1e15) || !std::isfinite(point.spread)) {
    return std::nullopt;
  }
  return point;
}

std::optional<PreparedPair> PreparePair(const PoseProblem& problem, const Match2D2D& match,
                                        double threshold_px, int index) {
  if (!match.query_px.allFinite() || !match.reference_px.allFinite()) {
    return std::nullopt;
  }
  const PosedImage& reference = problem.references[match.reference];
  if (!reference.cam_from_world.IsFinite()) {
    return std::nullopt;
  }
  const auto query_frame = MakePixelFrame(problem.query_camera, match.query_px);
  const auto reference_frame = MakePixelFrame(reference.camera, match.reference_px);
  if (!query_frame || !reference_frame) {
    return std::nullopt;
  }
  const Matrix3d world_from_cam = reference.cam_from_world.rotation.conjugate().toRotationMatrix();
  const double query_norm = query_frame->ray_from_image.col(2).norm();
  const double reference_norm = reference_frame->ray_from_image.col(2).norm();
  PreparedPair pair;
  pair.query_ray = query_frame->ray_from_image.col(2) / query_norm;
  pair.query_gradient = query_frame->ray_from_image.leftCols<2>() * (threshold_px / query_norm);
  pair.reference_sigma_px = match.reference_sigma_px.value_or(0);
  pair.reference_ray = world_from_cam * (reference_frame->ray_from_image.col(2) / reference_norm);
  pair.reference_gradient =
      world_from_cam * reference_frame->ray_from_image.leftCols<2>() *
      (threshold_px / reference_norm * SpreadOfReference(pair.reference_sigma_px, threshold_px));
  pair.parallax = std::sqrt(pair.query_gradient.colwise().squaredNorm().maxCoeff() +
                            pair.reference_gradient.colwise().squaredNorm().maxCoeff());
  if (!std::isfinite(pair.parallax)) {
    return std::nullopt;
  }
  pair.reference = match.reference;
  pair.match = index;
  return pair;
}

// A random order of `count` things.
std::vector<int> RandomOrder(size_t count, Rng& rng) {
  std::vector<int> order(count);
  std::iota(order.begin(), order.end(), 0);
  for (size_t i = count; i > 1; --i) {
    std::swap(order[i - 1], order[rng.UniformIndex(static_cast<uint32_t>(i))]);
  }
  return order;
}

// The 2D-2D matches grouped by reference, in random order within one; without those of a reference
// that does not exist.
std::vector<int> RandomOrderByReference(const PoseProblem& problem, Rng& rng) {
  std::vector<std::vector<int>> by_reference(problem.references.size());
  for (const int i : RandomOrder(problem.matches_2d2d.size(), rng)) {
    const int reference = problem.matches_2d2d[i].reference;
    if (reference >= 0 && reference < static_cast<int>(by_reference.size())) {
      by_reference[reference].push_back(i);
    }
  }
  std::vector<int> order;
  order.reserve(problem.matches_2d2d.size());
  for (const std::vector<int>& matches : by_reference) {
    order.insert(order.end(), matches.begin(), matches.end());
  }
  return order;
}

// How many blocks some pairs fill, each with those of one reference.
size_t CountBlocks(const std::vector<PreparedPair>& pairs, const std::vector<int>& selection,
                   int lanes) {
  size_t count = 0;
  int used = 0;
  for (size_t i = 0; i < selection.size(); ++i) {
    const bool same = i > 0 && pairs[selection[i]].reference == pairs[selection[i - 1]].reference;
    used = same && used < lanes ? used + 1 : 1;
    count += used == 1 ? 1 : 0;
  }
  return count;
}

}  // namespace

template <typename T>
std::vector<kernels::PointBlock<T>> MakePointBlocks(const std::vector<PreparedPoint>& points,
                                                    const std::vector<int>& selection) {
  constexpr int kLanes = kernels::kLanes<T>;
  std::vector<kernels::PointBlock<T>> blocks((selection.size() + kLanes - 1) / kLanes);
  if (!blocks.empty()) {
    std::memset(static_cast<void*>(blocks.data()), 0, blocks.size() * sizeof(blocks[0]));
  }
  for (size_t i = 0; i < selection.size(); ++i) {
    const PreparedPoint& point = points[selection[i]];
    kernels::PointBlock<T>& block = blocks[i / kLanes];
    const size_t lane = i % kLanes;
    block.spread[lane] = static_cast<T>(point.spread);
    for (int k = 0; k < 3; ++k) {
      block.x[k][lane] = static_cast<T>(point.point[k]);
      for (int c = 0; c < 3; ++c) {
        block.image_from_ray[3 * k + c][lane] = static_cast<T>(point.image_from_ray(k, c));
      }
    }
  }
  return blocks;
}

template <typename T>
PairBlocks<T> MakePairBlocks(const std::vector<PreparedPair>& pairs,
                             const std::vector<int>& selection) {
  constexpr int kLanes = kernels::kLanes<T>;
  PairBlocks<T> result;
  const size_t num_blocks = CountBlocks(pairs, selection, kLanes);
  result.blocks.reserve(num_blocks);
  result.block_reference.reserve(num_blocks);
  result.lane_pair.reserve(num_blocks * kLanes);
  int lane = kLanes;
  for (const int index : selection) {
    const PreparedPair& pair = pairs[index];
    if (lane == kLanes || result.block_reference.back() != pair.reference) {
      lane = 0;
      result.blocks.emplace_back();
      std::memset(static_cast<void*>(&result.blocks.back()), 0, sizeof(result.blocks.back()));
      result.block_reference.push_back(pair.reference);
      result.lane_pair.insert(result.lane_pair.end(), kLanes, -1);
    }
    kernels::PairBlock<T>& block = result.blocks.back();
    result.lane_pair[(result.blocks.size() - 1) * kLanes + lane] = index;
    for (int k = 0; k < 3; ++k) {
      block.query_ray[k][lane] = static_cast<T>(pair.query_ray[k]);
      block.reference_ray[k][lane] = static_cast<T>(pair.reference_ray[k]);
      for (int g = 0; g < 2; ++g) {
        block.query_gradient[3 * g + k][lane] = static_cast<T>(pair.query_gradient(k, g));
        block.reference_gradient[3 * g + k][lane] = static_cast<T>(pair.reference_gradient(k, g));
      }
    }
    block.parallax[lane] = static_cast<T>(pair.parallax);
    ++lane;
  }
  return result;
}

template std::vector<kernels::PointBlock<float>> MakePointBlocks<float>(
    const std::vector<PreparedPoint>&, const std::vector<int>&);
template std::vector<kernels::PointBlock<double>> MakePointBlocks<double>(
    const std::vector<PreparedPoint>&, const std::vector<int>&);
template PairBlocks<float> MakePairBlocks<float>(const std::vector<PreparedPair>&,
                                                 const std::vector<int>&);
template PairBlocks<double> MakePairBlocks<double>(const std::vector<PreparedPair>&,
                                                   const std::vector<int>&);

PreparedProblem::PreparedProblem(const PoseProblem& problem, double point_threshold_px,
                                 double pair_threshold_px, Rng& rng, double point_sigma)
    : reprojection_threshold_px(point_threshold_px),
      sampson_threshold_px(pair_threshold_px),
      num_matches_2d3d(static_cast<int>(problem.matches_2d3d.size())),
      num_matches_2d2d(static_cast<int>(problem.matches_2d2d.size())) {
  const Frame frame = ChooseFrame(problem);
  origin_in_world = frame.origin;
  scale = frame.scale;
  for (const PosedImage& reference : problem.references) {
    centres.push_back((reference.cam_from_world.OriginInSource() - frame.origin) / frame.scale);
  }
  priors = PreparedPriors(problem.priors, frame.origin, frame.scale, centres);
  const KeypointNumbers numbers = NumberQueryKeypoints(problem.matches_2d2d, problem.matches_2d3d);
  num_keypoints = numbers.count;
  points.reserve(problem.matches_2d3d.size());
  for (const int i : RandomOrder(problem.matches_2d3d.size(), rng)) {
    if (const auto point = PreparePoint(problem.query_camera, problem.matches_2d3d[i], frame,
                                        reprojection_threshold_px, point_sigma, i)) {
      points.push_back(*point);
      points.back().keypoint = numbers.of_2d3d[static_cast<size_t>(i)];
    }
  }
  pairs.reserve(problem.matches_2d2d.size());
  for (const int i : RandomOrderByReference(problem, rng)) {
    if (const auto pair = PreparePair(problem, problem.matches_2d2d[i], sampson_threshold_px, i)) {
      pairs.push_back(*pair);
      pairs.back().keypoint = numbers.of_2d2d[static_cast<size_t>(i)];
    }
  }
  for (int i = 0; i < static_cast<int>(pairs.size()); ++i) {
    if (runs.empty() || runs.back().reference != pairs[i].reference) {
      runs.push_back({pairs[i].reference, i, i});
    }
    runs.back().end = i + 1;
  }
  std::vector<int> all_points(points.size());
  std::iota(all_points.begin(), all_points.end(), 0);
  point_blocks = MakePointBlocks<float>(points, all_points);

  std::vector<int> all_pairs(pairs.size());
  std::iota(all_pairs.begin(), all_pairs.end(), 0);
  const PairBlocks<float> grouped = MakePairBlocks<float>(pairs, all_pairs);
  pair_blocks.reserve(grouped.blocks.size());
  // So that a prefix of the blocks sees all references.
  for (const int i : RandomOrder(grouped.blocks.size(), rng)) {
    pair_blocks.push_back(grouped.blocks[i]);
    pair_block_reference.push_back(grouped.block_reference[i]);
  }
}

SolverPose PreparedProblem::CamFromLocal(const Rigid3& cam_from_world) const {
  return {cam_from_world.rotation.toRotationMatrix(), (cam_from_world * origin_in_world) / scale};
}

Rigid3 PreparedProblem::CamFromWorld(const SolverPose& cam_from_local) const {
  Rigid3 pose;
  pose.rotation = Eigen::Quaterniond(cam_from_local.rotation).normalized();
  if (pose.rotation.w() < 0) {  // one of the two signs, so that equal poses print alike
    pose.rotation.coeffs() *= -1;
  }
  pose.translation = scale * cam_from_local.translation - pose.rotation * origin_in_world;
  return pose;
}

}  // namespace raylift
