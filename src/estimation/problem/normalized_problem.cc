#include "estimation/problem/normalized_problem.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/statistics.h"

#include "raylift/geometry/residuals.h"

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

// Returns a frame centered on the references that have matches and scaled by their spread; where
// they share one center (or there are none) by the median distance of the 3D points.
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
    // The sum is of differences to the first center, as large coordinates would lose digits.
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

std::optional<NormalizedMatch2D3D> Normalize2D3D(const Camera& camera, const Match2D3D& match,
                                                 const Frame& frame, double threshold_px,
                                                 double point_sigma, int index) {
  if (!match.query_px.allFinite() || !match.point_in_world.allFinite()) {
    return std::nullopt;
  }
  const auto pixel_frame = MakePixelFrame(camera, match.query_px);
  if (!pixel_frame) {
    return std::nullopt;
  }
  NormalizedMatch2D3D point;
  point.ray = pixel_frame->ray_from_image.col(2).normalized();
  point.image_from_ray = pixel_frame->image_from_ray;
  point.image_from_ray.topRows<2>() /= threshold_px;
  point.point = (match.point_in_world - frame.origin) / frame.scale;
  point.sigma = match.point_sigma.value_or(point_sigma) / frame.scale;
  // An isotropic error of the point shows in the image as an error of both pixel rows' mean scale.
  const double widened = kSigmasOfThreshold * point.sigma;
  point.variance_at_unit_depth =
      0.5 * point.image_from_ray.topRows<2>().squaredNorm() * widened * widened;
  point.match = index;
  if (!(point.point.norm() < kFarthest) || !std::isfinite(point.variance_at_unit_depth)) {
    return std::nullopt;
  }
  return point;
}

std::optional<NormalizedMatch2D2D> Normalize2D2D(const PoseProblem& problem, const Match2D2D& match,
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
  NormalizedMatch2D2D pair;
  pair.query_ray = query_frame->ray_from_image.col(2) / query_norm;
  pair.query_gradient = query_frame->ray_from_image.leftCols<2>() * (threshold_px / query_norm);
  pair.reference_sigma_px = match.reference_sigma_px.value_or(0);
  pair.reference_ray = world_from_cam * (reference_frame->ray_from_image.col(2) / reference_norm);
  pair.reference_gradient =
      world_from_cam * reference_frame->ray_from_image.leftCols<2>() *
      (threshold_px / reference_norm * ReferenceSigmaFactor(pair.reference_sigma_px, threshold_px));
  pair.parallax = std::sqrt(pair.query_gradient.colwise().squaredNorm().maxCoeff() +
                            pair.reference_gradient.colwise().squaredNorm().maxCoeff());
  if (!std::isfinite(pair.parallax)) {
    return std::nullopt;
  }
  pair.reference = match.reference;
  pair.match = index;
  return pair;
}

// Turns a match from a camera's own axes to those of the query's own camera.
void TurnToQueryAxes(const Matrix3d& cam_from_query, NormalizedMatch2D3D& point) {
  point.ray = cam_from_query.transpose() * point.ray;
  point.image_from_ray = point.image_from_ray * cam_from_query;
}
void TurnToQueryAxes(const Matrix3d& cam_from_query, NormalizedMatch2D2D& pair) {
  pair.query_ray = cam_from_query.transpose() * pair.query_ray;
  pair.query_gradient = cam_from_query.transpose() * pair.query_gradient;
}

std::vector<int> AllIndices(size_t count) {
  std::vector<int> indices(count);
  std::iota(indices.begin(), indices.end(), 0);
  return indices;
}

// Returns the indices below `count` in random order.
std::vector<int> RandomOrder(size_t count, Rng& rng) {
  std::vector<int> order = AllIndices(count);
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

// Returns the 2D-2D matches' indices grouped by reference and camera, in random order within a
// group; without those of a reference or a camera that does not exist.
std::vector<int> RandomOrderByCameraReference(const PoseProblem& problem, Rng& rng) {
  const auto num_cameras = static_cast<size_t>(problem.num_cameras());
  std::vector<std::vector<int>> by_camera_reference(problem.references.size() * num_cameras);
  for (const int i : RandomOrder(problem.matches_2d2d.size(), rng)) {
    const Match2D2D& match = problem.matches_2d2d[static_cast<size_t>(i)];
    if (match.reference >= 0 && match.reference < static_cast<int>(problem.references.size()) &&
        problem.HasCamera(match.camera)) {
      by_camera_reference[static_cast<size_t>(match.reference) * num_cameras +
                          static_cast<size_t>(match.camera)]
          .push_back(i);
    }
  }
  return Joined(by_camera_reference, problem.matches_2d2d.size());
}

// Returns the 2D-3D matches' indices grouped by camera, in the same way.
std::vector<int> RandomOrderByCamera(const PoseProblem& problem, Rng& rng) {
  std::vector<std::vector<int>> by_camera(static_cast<size_t>(problem.num_cameras()));
  for (const int i : RandomOrder(problem.matches_2d3d.size(), rng)) {
    const int camera = problem.matches_2d3d[static_cast<size_t>(i)].camera;
    if (problem.HasCamera(camera)) by_camera[static_cast<size_t>(camera)].push_back(i);
  }
  return Joined(by_camera, problem.matches_2d3d.size());
}

// Counts the matches that repeat no other one.
int CountFirst(const std::vector<size_t>& repeats) {
  int count = 0;
  for (size_t i = 0; i < repeats.size(); ++i) count += repeats[i] == i ? 1 : 0;
  return count;
}

}  // namespace

NormalizedProblem::NormalizedProblem(const PoseProblem& problem, double threshold_2d3d_px,
                                     double threshold_2d2d_px, Rng& rng, double point_sigma,
                                     double same_within_px)
    : reference_sigmas(problem.reference_sigmas),
      reprojection_threshold_px(threshold_2d3d_px),
      sampson_threshold_px(threshold_2d2d_px) {
  const Frame frame = ChooseFrame(problem);
  origin_in_world = frame.origin;
  scale = frame.scale;
  repeats = FindRepeats(problem, same_within_px, frame.origin);
  num_matches_2d3d = CountFirst(repeats.of_2d3d);
  num_matches_2d2d = CountFirst(repeats.of_2d2d);
  num_keypoints = repeats.keypoints.count;
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
    if (camera > 0) TurnToQueryAxes(cam_from_query[static_cast<size_t>(camera - 1)], match);
  };
  priors = NormalizedPriors(problem.priors, frame.origin, frame.scale, centers);
  matches_2d3d.reserve(problem.matches_2d3d.size());
  for (const int i : RandomOrderByCamera(problem, rng)) {
    const auto index = static_cast<size_t>(i);
    const Match2D3D& match = problem.matches_2d3d[index];
    if (repeats.of_2d3d[index] != index || !is_near(match.camera)) continue;
    if (const auto point = Normalize2D3D(problem.CameraAt(match.camera), match, frame,
                                         reprojection_threshold_px, point_sigma, i)) {
      matches_2d3d.push_back(*point);
      finish(matches_2d3d.back(), match.camera, repeats.keypoints.of_2d3d[index]);
    }
  }
  matches_2d2d.reserve(problem.matches_2d2d.size());
  for (const int i : RandomOrderByCameraReference(problem, rng)) {
    const auto index = static_cast<size_t>(i);
    const Match2D2D& match = problem.matches_2d2d[index];
    if (repeats.of_2d2d[index] != index || !is_near(match.camera)) continue;
    if (const auto pair = Normalize2D2D(problem, match, sampson_threshold_px, i)) {
      matches_2d2d.push_back(*pair);
      finish(matches_2d2d.back(), match.camera, repeats.keypoints.of_2d2d[index]);
      matches_2d2d.back().camera_reference = CameraReferenceIndex(match.camera, match.reference);
    }
  }
  for (int i = 0; i < static_cast<int>(matches_2d2d.size()); ++i) {
    if (groups_2d2d.empty() ||
        groups_2d2d.back().camera_reference != matches_2d2d[i].camera_reference) {
      groups_2d2d.push_back({matches_2d2d[i].reference, matches_2d2d[i].camera,
                             matches_2d2d[i].camera_reference, i, i});
    }
    groups_2d2d.back().end = i + 1;
  }
  Blocks2D3D<float> by_camera =
      MakeBlocks2D3D<float>(matches_2d3d, AllIndices(matches_2d3d.size()));
  if (problem.other_cameras.empty()) {
    blocks_2d3d = std::move(by_camera.blocks);
    block_camera_2d3d = std::move(by_camera.block_camera);
  } else {
    // The order is random, so that a prefix of the blocks sees all cameras.
    for (const int i : RandomOrder(by_camera.blocks.size(), rng)) {
      blocks_2d3d.push_back(by_camera.blocks[i]);
      block_camera_2d3d.push_back(by_camera.block_camera[i]);
    }
  }

  const Blocks2D2D<float> grouped =
      MakeBlocks2D2D<float>(matches_2d2d, AllIndices(matches_2d2d.size()));
  blocks_2d2d.reserve(grouped.blocks.size());
  // The order is random, so that a prefix of the blocks sees all references.
  for (const int i : RandomOrder(grouped.blocks.size(), rng)) {
    blocks_2d2d.push_back(grouped.blocks[i]);
    block_camera_reference_2d2d.push_back(grouped.block_camera_reference[i]);
  }
  FillExactBlocks();
}

void NormalizedProblem::FillExactBlocks() {
  exact_2d3d = MakeBlocks2D3D<double>(matches_2d3d, AllIndices(matches_2d3d.size()));
  exact_2d2d = MakeBlocks2D2D<double>(matches_2d2d, AllIndices(matches_2d2d.size()));
}

void NormalizedProblem::TakeFocalSigma(const PoseProblem& original, double sigma) {
  focal = {.sigma = sigma, .px_2d3d = {}, .px_2d2d = {}};
  if (sigma == 0) return;
  const auto moves = [&](const auto& matches, const auto& of) {
    std::vector<Eigen::Vector2d> px;
    px.reserve(matches.size());
    for (const auto& match : matches) {
      px.push_back(PxByLogFocal(original.CameraAt(match.camera),
                                of[static_cast<size_t>(match.match)].query_px));
    }
    return px;
  };
  focal.px_2d3d = moves(matches_2d3d, original.matches_2d3d);
  focal.px_2d2d = moves(matches_2d2d, original.matches_2d2d);
}

void NormalizedProblem::TakeFocalError(double share) {
  for (size_t i = 0; i < matches_2d3d.size(); ++i) {
    NormalizedMatch2D3D& point = matches_2d3d[i];
    point.image_from_ray.topRows<2>() +=
        share / reprojection_threshold_px * focal.px_2d3d[i] * point.image_from_ray.row(2);
    const Vector3d ray = point.image_from_ray.row(0).cross(point.image_from_ray.row(1));
    point.ray = (ray.dot(point.ray) > 0 ? ray : -ray).normalized();
  }
  for (size_t i = 0; i < matches_2d2d.size(); ++i) {
    NormalizedMatch2D2D& pair = matches_2d2d[i];
    pair.query_ray -= pair.query_gradient * (share / sampson_threshold_px * focal.px_2d2d[i]);
    const double length = pair.query_ray.norm();
    pair.query_ray /= length;
    pair.query_gradient /= length;
  }
  Blocks2D3D<float> points = MakeBlocks2D3D<float>(matches_2d3d, AllIndices(matches_2d3d.size()));
  blocks_2d3d = std::move(points.blocks);
  block_camera_2d3d = std::move(points.block_camera);
  Blocks2D2D<float> pairs = MakeBlocks2D2D<float>(matches_2d2d, AllIndices(matches_2d2d.size()));
  blocks_2d2d = std::move(pairs.blocks);
  block_camera_reference_2d2d = std::move(pairs.block_camera_reference);
  FillExactBlocks();
}

CamFromLocal NormalizedProblem::ToLocal(const Rigid3& cam_from_world) const {
  return {cam_from_world.rotation.toRotationMatrix(), (cam_from_world * origin_in_world) / scale};
}

Rigid3 NormalizedProblem::ToWorld(const CamFromLocal& cam_from_local) const {
  Rigid3 pose;
  pose.rotation = Eigen::Quaterniond(cam_from_local.rotation).normalized();
  if (pose.rotation.w() < 0) {  // one of the two signs, so that equal poses print alike
    pose.rotation.coeffs() *= -1;
  }
  pose.translation = scale * cam_from_local.translation - pose.rotation * origin_in_world;
  return pose;
}

}  // namespace raylift
