#include "estimation/prepared_problem.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>

#include "base/statistics.h"

#include "raylift/geometry/residuals.h"
#include "raylift/scene/keypoints.h"

namespace raylift {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Points and cameras so far away that float arithmetic would overflow cannot be told from none.
constexpr double kFarthest = 1e15;

struct Frame {
  Vector3d origin = Vector3d::Zero();
  double scale = 1;
};

// Centered on the references that have matches and scaled by their spread; where they share one
// center (or there are none) by the median distance of the 3D points.
Frame ChooseFrame(const PoseProblem& problem) {
  std::vector<bool> used(problem.references.size(), false);
  for (const Match2D2D& match : problem.matches_2d2d) {
    if (match.reference >= 0 && match.reference < static_cast<int>(used.size())) {
      used[match.reference] = true;
    }
  }
  std::vector<Vector3d> centers;
  for (size_t i = 0; i < used.size(); ++i) {
    const Vector3d center = problem.references[i].cam_from_world.OriginInSource();
    if (used[i] && center.allFinite()) {
      centers.push_back(center);
    }
  }
  std::vector<Vector3d> points;
  for (const Match2D3D& match : problem.matches_2d3d) {
    if (match.point_in_world.allFinite()) {
      points.push_back(match.point_in_world);
    }
  }
  Frame frame;
  if (!centers.empty()) {
    // Differences to the first center, as sums of large coordinates would lose digits.
    Vector3d sum = Vector3d::Zero();
    for (const Vector3d& c : centers) sum += c - centers[0];
    frame.origin = centers[0] + sum / static_cast<double>(centers.size());
    double squares = 0;
    for (const Vector3d& c : centers) squares += (c - frame.origin).squaredNorm();
    frame.scale = std::sqrt(squares / static_cast<double>(centers.size()));
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
  if (!(point.point.norm() < kFarthest) || !std::isfinite(point.spread)) {
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
  const auto query_frame = MakePixelFrame(problem.CameraAt(match.camera), match.query_px);
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

// From a camera's own axes to those of the query's own camera.
void Turn(const Matrix3d& cam_from_query, PreparedPoint& point) {
  point.ray = cam_from_query.transpose() * point.ray;
  point.image_from_ray = point.image_from_ray * cam_from_query;
}
void Turn(const Matrix3d& cam_from_query, PreparedPair& pair) {
  pair.query_ray = cam_from_query.transpose() * pair.query_ray;
  pair.query_gradient = cam_from_query.transpose() * pair.query_gradient;
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

std::vector<int> Joined(const std::vector<std::vector<int>>& groups, size_t count) {
  std::vector<int> joined;
  joined.reserve(count);
  for (const std::vector<int>& group : groups) {
    joined.insert(joined.end(), group.begin(), group.end());
  }
  return joined;
}

// The 2D-2D matches grouped by reference and camera, in random order within a group; without those
// of a reference or a camera that does not exist.
std::vector<int> RandomOrderByView(const PoseProblem& problem, Rng& rng) {
  const auto num_cameras = static_cast<size_t>(problem.num_cameras());
  std::vector<std::vector<int>> by_view(problem.references.size() * num_cameras);
  for (const int i : RandomOrder(problem.matches_2d2d.size(), rng)) {
    const Match2D2D& match = problem.matches_2d2d[static_cast<size_t>(i)];
    if (match.reference >= 0 && match.reference < static_cast<int>(problem.references.size()) &&
        problem.HasCamera(match.camera)) {
      by_view[static_cast<size_t>(match.reference) * num_cameras +
              static_cast<size_t>(match.camera)]
          .push_back(i);
    }
  }
  return Joined(by_view, problem.matches_2d2d.size());
}

// The 2D-3D matches grouped by camera, as those.
std::vector<int> RandomOrderByCamera(const PoseProblem& problem, Rng& rng) {
  std::vector<std::vector<int>> by_camera(static_cast<size_t>(problem.num_cameras()));
  for (const int i : RandomOrder(problem.matches_2d3d.size(), rng)) {
    const int camera = problem.matches_2d3d[static_cast<size_t>(i)].camera;
    if (problem.HasCamera(camera)) by_camera[static_cast<size_t>(camera)].push_back(i);
  }
  return Joined(by_camera, problem.matches_2d3d.size());
}

// How many blocks some matches fill, each with those of one `group`.
template <typename Match>
size_t CountBlocks(const std::vector<Match>& matches, int Match::*group,
                   const std::vector<int>& selection, int lanes) {
  size_t count = 0;
  int used = 0;
  for (size_t i = 0; i < selection.size(); ++i) {
    const bool same = i > 0 && matches[selection[i]].*group == matches[selection[i - 1]].*group;
    used = same && used < lanes ? used + 1 : 1;
    count += used == 1 ? 1 : 0;
  }
  return count;
}

}  // namespace

template <typename T>
PointBlocks<T> MakePointBlocks(const std::vector<PreparedPoint>& points,
                               const std::vector<int>& selection) {
  constexpr int kLanes = kernels::kLanes<T>;
  PointBlocks<T> result;
  const size_t num_blocks = CountBlocks(points, &PreparedPoint::camera, selection, kLanes);
  result.blocks.resize(num_blocks);
  if (num_blocks > 0) {
    std::memset(static_cast<void*>(result.blocks.data()), 0, num_blocks * sizeof(result.blocks[0]));
  }
  result.block_camera.reserve(num_blocks);
  result.lane_point.assign(num_blocks * kLanes, -1);
  int lane = kLanes;
  for (const int index : selection) {
    const PreparedPoint& point = points[index];
    if (lane == kLanes || result.block_camera.back() != point.camera) {
      lane = 0;
      result.block_camera.push_back(point.camera);
    }
    const size_t last = result.block_camera.size() - 1;
    kernels::PointBlock<T>& block = result.blocks[last];
    result.lane_point[last * kLanes + lane] = index;
    block.spread[lane] = static_cast<T>(point.spread);
    for (int k = 0; k < 3; ++k) {
      block.x[k][lane] = static_cast<T>(point.point[k]);
      for (int c = 0; c < 3; ++c) {
        block.image_from_ray[3 * k + c][lane] = static_cast<T>(point.image_from_ray(k, c));
      }
    }
    ++lane;
  }
  return result;
}

template <typename T>
PairBlocks<T> MakePairBlocks(const std::vector<PreparedPair>& pairs,
                             const std::vector<int>& selection) {
  constexpr int kLanes = kernels::kLanes<T>;
  PairBlocks<T> result;
  const size_t num_blocks = CountBlocks(pairs, &PreparedPair::view, selection, kLanes);
  result.blocks.reserve(num_blocks);
  result.block_view.reserve(num_blocks);
  result.lane_pair.reserve(num_blocks * kLanes);
  int lane = kLanes;
  for (const int index : selection) {
    const PreparedPair& pair = pairs[index];
    if (lane == kLanes || result.block_view.back() != pair.view) {
      lane = 0;
      result.blocks.emplace_back();
      std::memset(static_cast<void*>(&result.blocks.back()), 0, sizeof(result.blocks.back()));
      result.block_view.push_back(pair.view);
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

template PointBlocks<float> MakePointBlocks<float>(const std::vector<PreparedPoint>&,
                                                   const std::vector<int>&);
template PointBlocks<double> MakePointBlocks<double>(const std::vector<PreparedPoint>&,
                                                     const std::vector<int>&);
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
    centers.push_back((reference.cam_from_world.OriginInSource() - frame.origin) / frame.scale);
  }
  std::vector<Matrix3d> cam_from_query;  // of the other cameras
  camera_centers.assign(1, Vector3d::Zero());
  for (const RigCamera& other : problem.other_cameras) {
    cam_from_query.push_back(other.cam_from_query.rotation.toRotationMatrix());
    camera_centers.push_back(other.cam_from_query.OriginInSource() / frame.scale);
  }
  const auto is_near = [&](int camera) {
    return camera_centers[static_cast<size_t>(camera)].norm() < kFarthest;
  };
  const auto finish = [&](auto& match, int camera, size_t keypoint) {
    match.camera = camera;
    match.keypoint = keypoint;
    if (camera > 0) Turn(cam_from_query[static_cast<size_t>(camera - 1)], match);
  };
  priors = PreparedPriors(problem.priors, frame.origin, frame.scale, centers);
  const KeypointNumbers numbers = NumberQueryKeypoints(problem.matches_2d2d, problem.matches_2d3d);
  num_keypoints = numbers.count;
  points.reserve(problem.matches_2d3d.size());
  for (const int i : RandomOrderByCamera(problem, rng)) {
    const Match2D3D& match = problem.matches_2d3d[static_cast<size_t>(i)];
    if (!is_near(match.camera)) continue;
    if (const auto point = PreparePoint(problem.CameraAt(match.camera), match, frame,
                                        reprojection_threshold_px, point_sigma, i)) {
      points.push_back(*point);
      finish(points.back(), match.camera, numbers.of_2d3d[static_cast<size_t>(i)]);
    }
  }
  pairs.reserve(problem.matches_2d2d.size());
  for (const int i : RandomOrderByView(problem, rng)) {
    const Match2D2D& match = problem.matches_2d2d[static_cast<size_t>(i)];
    if (!is_near(match.camera)) continue;
    if (const auto pair = PreparePair(problem, match, sampson_threshold_px, i)) {
      pairs.push_back(*pair);
      finish(pairs.back(), match.camera, numbers.of_2d2d[static_cast<size_t>(i)]);
      pairs.back().view = ViewOf(match.camera, match.reference);
    }
  }
  for (int i = 0; i < static_cast<int>(pairs.size()); ++i) {
    if (runs.empty() || runs.back().view != pairs[i].view) {
      runs.push_back({pairs[i].reference, pairs[i].camera, pairs[i].view, i, i});
    }
    runs.back().end = i + 1;
  }
  std::vector<int> all_points(points.size());
  std::iota(all_points.begin(), all_points.end(), 0);
  PointBlocks<float> by_camera = MakePointBlocks<float>(points, all_points);
  if (problem.other_cameras.empty()) {
    point_blocks = std::move(by_camera.blocks);
    point_block_camera = std::move(by_camera.block_camera);
  } else {
    // So that a prefix of the blocks sees all cameras.
    for (const int i : RandomOrder(by_camera.blocks.size(), rng)) {
      point_blocks.push_back(by_camera.blocks[i]);
      point_block_camera.push_back(by_camera.block_camera[i]);
    }
  }

  std::vector<int> all_pairs(pairs.size());
  std::iota(all_pairs.begin(), all_pairs.end(), 0);
  const PairBlocks<float> grouped = MakePairBlocks<float>(pairs, all_pairs);
  pair_blocks.reserve(grouped.blocks.size());
  // So that a prefix of the blocks sees all references.
  for (const int i : RandomOrder(grouped.blocks.size(), rng)) {
    pair_blocks.push_back(grouped.blocks[i]);
    pair_block_view.push_back(grouped.block_view[i]);
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
