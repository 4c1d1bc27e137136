#include "estimation/ransac/samplers.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <span>
#include <utility>

#include "base/rng.h"
#include "base/statistics.h"
#include "estimation/solvers/minimal_solvers.h"
#include <Eigen/LU>

namespace raylift {
namespace {

// Draws `kCount` different indices in [0, n); n >= kCount.
template <int kCount>
std::array<int, kCount> DrawDistinct(Rng& rng, int n) {
  std::array<int, kCount> indices;
  for (int i = 0; i < kCount;) {
    const int index = static_cast<int>(rng.UniformIndex(static_cast<uint32_t>(n)));
    if (std::find(indices.begin(), indices.begin() + i, index) == indices.begin() + i) {
      indices[i++] = index;
    }
  }
  return indices;
}

// D3+1 tries so many fourth matches for each solution of P3P.
constexpr int kFourthMatchesPerSample = 2;

// Draws one match of all groups, whose sizes sum to `total`: returns its group, and its position
// there.
template <typename Group>
std::pair<const Group&, int> DrawMatch(Rng& rng, const std::vector<Group>& groups, int total) {
  int position = static_cast<int>(rng.UniformIndex(static_cast<uint32_t>(total)));
  auto group = groups.begin();
  while (position >= group->size()) position -= (group++)->size();
  return {*group, position};
}

// Returns the query's pose from that of one of its cameras relative to a reference.
CamFromLocal QueryPoseOf(const NormalizedProblem& problem, const MatchGroup& group,
                         const RelativePose& relative, double length) {
  CamFromLocal pose = QueryPose(relative, problem.centers[group.reference], length);
  pose.translation += problem.camera_centers[group.camera];
  return pose;
}

// Adds the poses that a camera has relative to a reference, each with the length that a match of
// another reference or camera gives it.
void AddPosesByLength(const NormalizedProblem& problem, const MatchGroup& group,
                      std::span<const RelativePose> relative, const NormalizedMatch2D2D& pair,
                      std::vector<CamFromLocal>& poses) {
  const RayPair rays = {pair.query_ray, pair.reference_ray};
  // The other camera sees its reference as this one would see it if it stood by so much elsewhere.
  const Eigen::Vector3d lever =
      problem.camera_centers[group.camera] - problem.camera_centers[pair.camera];
  for (const RelativePose& pose : relative) {
    const Eigen::Vector3d sixth_center =
        problem.centers[pair.reference] + pose.rotation.transpose() * lever;
    if (const auto length =
            TranslationLength(pose, problem.centers[group.reference], rays, sixth_center)) {
      poses.push_back(QueryPoseOf(problem, group, pose, *length));
    }
  }
}

// Returns how many sets of k there are of n things.
double NumSets(double n, int k) {
  double sets = 1;
  for (int i = 0; i < k; ++i) sets *= (n - i) / (i + 1);
  return std::max(sets, 0.0);
}

}  // namespace

P3pSampler::P3pSampler(const NormalizedProblem& problem) : problem_(problem) {}

bool P3pSampler::CanSample(const NormalizedProblem& problem) {
  return problem.matches_2d3d.size() >= 3;
}

void P3pSampler::Sample(Rng& rng, std::vector<CamFromLocal>& poses) const {
  poses.clear();
  const auto sample = DrawDistinct<3>(rng, static_cast<int>(problem_.matches_2d3d.size()));
  const NormalizedMatch2D3D& a = problem_.matches_2d3d[sample[0]];
  const NormalizedMatch2D3D& b = problem_.matches_2d3d[sample[1]];
  const NormalizedMatch2D3D& c = problem_.matches_2d3d[sample[2]];
  std::array<CamFromLocal, kMaxGeneralizedP3pSolutions> solutions;
  int count = 0;
  if (a.camera == b.camera && a.camera == c.camera) {
    count = SolveP3p({a.ray, b.ray, c.ray}, {a.point, b.point, c.point},
                     std::span(solutions).first<4>());
    for (int i = 0; i < count; ++i) {
      solutions[i].translation += problem_.camera_centers[a.camera];
    }
  } else {
    const auto& centers = problem_.camera_centers;
    count = SolveGeneralizedP3p({centers[a.camera], centers[b.camera], centers[c.camera]},
                                {a.ray, b.ray, c.ray}, {a.point, b.point, c.point}, solutions);
  }
  poses.assign(solutions.begin(), solutions.begin() + count);
  // If the matches cannot tell solutions apart (three of them fit each exactly), the one nearest to
  // the references, whose center is the origin, is the likeliest: they were retrieved for what the
  // query sees.
  std::sort(poses.begin(), poses.end(), [](const CamFromLocal& left, const CamFromLocal& right) {
    return left.translation.squaredNorm() < right.translation.squaredNorm();
  });
}

double P3pSampler::SuccessProbability(const InlierCounts& inliers) const {
  const double ratio = inliers.of_2d3d / static_cast<double>(problem_.matches_2d3d.size());
  return ratio * ratio * ratio;
}

double P3pSampler::NumSamples() const {
  return NumSets(static_cast<double>(problem_.matches_2d3d.size()), 3);
}

MatchesElsewhere::MatchesElsewhere(const NormalizedProblem& problem, const MatchGroup& group) {
  const auto are_apart = [](const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
    return (a - b).norm() > 1e-6;
  };
  for (const MatchGroup& other : problem.groups_2d2d) {
    if (are_apart(problem.centers[other.reference], problem.centers[group.reference]) ||
        are_apart(problem.camera_centers[other.camera], problem.camera_centers[group.camera])) {
      groups_.push_back(other);
      count_ += other.size();
    }
  }
}

const NormalizedMatch2D2D& MatchesElsewhere::Draw(const NormalizedProblem& problem,
                                                  Rng& rng) const {
  const auto [group, position] = DrawMatch(rng, groups_, count_);
  return problem.matches_2d2d[group.begin + position];
}

double MatchesElsewhere::InlierRatio(const InlierCounts& inliers) const {
  double sum = 0;
  for (const MatchGroup& group : groups_) sum += inliers.of_2d2d[group.camera_reference];
  return sum / count_;
}

E5p1Sampler::E5p1Sampler(const NormalizedProblem& problem, int sixth_matches)
    : problem_(problem), sixth_matches_(sixth_matches) {
  for (const MatchGroup& group : problem.groups_2d2d) {
    if (group.size() < 5) {
      continue;
    }
    sources_.push_back({group, MatchesElsewhere(problem, group)});
    position_observable_ = position_observable_ || !sources_.back().sixth.empty();
  }
  if (position_observable_) {
    std::erase_if(sources_, [](const FiveSource& source) { return source.sixth.empty(); });
  }
  for (const FiveSource& source : sources_) {
    num_five_ += source.group.size();
  }
}

bool E5p1Sampler::CanSample(const NormalizedProblem& problem) {
  return std::any_of(problem.groups_2d2d.begin(), problem.groups_2d2d.end(),
                     [](const MatchGroup& group) { return group.size() >= 5; });
}

void E5p1Sampler::Sample(Rng& rng, std::vector<CamFromLocal>& poses) const {
  poses.clear();
  const FiveSource& source = DrawMatch(rng, sources_, num_five_).first;
  const auto sample = DrawDistinct<5>(rng, source.size());
  std::array<Eigen::Vector3d, 5> query_rays;
  std::array<Eigen::Vector3d, 5> reference_rays;
  for (int i = 0; i < 5; ++i) {
    const NormalizedMatch2D2D& pair = problem_.matches_2d2d[source.group.begin + sample[i]];
    query_rays[i] = pair.query_ray;
    reference_rays[i] = pair.reference_ray;
  }
  std::array<RelativePose, kMaxFivePointSolutions> relative;
  const int count = SolveRelativePose(query_rays, reference_rays, relative);
  if (!position_observable_) {
    for (int i = 0; i < count; ++i) {
      poses.push_back(QueryPoseOf(problem_, source.group, relative[i], 1));
    }
    return;
  }
  for (int k = 0; k < sixth_matches_; ++k) {
    AddPosesByLength(problem_, source.group, std::span(relative).first(count),
                     source.sixth.Draw(problem_, rng), poses);
  }
}

double E5p1Sampler::SuccessProbability(const InlierCounts& inliers) const {
  double success = 0;
  for (const FiveSource& source : sources_) {
    const double ratio =
        inliers.of_2d2d[source.group.camera_reference] / static_cast<double>(source.size());
    const double sixth = position_observable_
                             ? 1 - std::pow(1 - source.sixth.InlierRatio(inliers), sixth_matches_)
                             : 1;
    success += std::pow(ratio, 5) * sixth * source.size() / num_five_;
  }
  return success;
}

double E5p1Sampler::NumSamples() const {
  double samples = 0;
  for (const FiveSource& source : sources_) {
    samples += NumSets(source.size(), 5) * (position_observable_ ? source.sixth.size() : 1);
  }
  return samples;
}

namespace {

// Returns an observation's point in the geometry, from the reference's center: on its ray where it
// has a depth; else the first unanchored point nearby, as SfM's are, which lie on no ray as they
// are the mean of many. nullopt where there is none.
std::optional<Eigen::Vector3d> PointFromCenter(const Observation& observation,
                                               std::span<const UnanchoredPoint> unanchored,
                                               double threshold_px) {
  if (observation.has_depth) return std::exp(observation.log_distance) * observation.ray;
  for (const UnanchoredPoint& point : unanchored) {
    if (IsShownBy(observation, point.point, threshold_px)) {
      return point.point - observation.center;
    }
  }
  return std::nullopt;
}

}  // namespace

D3p1Sampler::D3p1Sampler(const NormalizedProblem& problem, const KeypointEvidence& evidence)
    : problem_(problem) {
  std::vector<std::vector<LiftedMatch>> lifted(problem.num_camera_references());
  const double threshold_px = problem.reprojection_threshold_px;
  for (const KeypointObservations& keypoint : evidence.keypoints) {
    const Eigen::Vector3d query_ray = keypoint.image_from_cam.inverse().col(2).normalized();
    Eigen::Matrix3d image_from_ray = keypoint.image_from_cam;
    image_from_ray.topRows<2>() /= threshold_px;
    for (const Observation& observation : evidence.ObservationsOf(keypoint)) {
      const auto point =
          PointFromCenter(observation, evidence.UnanchoredOf(keypoint), threshold_px);
      if (!point) continue;
      lifted[problem.CameraReferenceIndex(keypoint.camera, observation.reference)].push_back(
          {query_ray, image_from_ray, *point});
    }
  }
  for (const MatchGroup& group : problem.groups_2d2d) {
    if (lifted[group.camera_reference].size() < 3) continue;
    MatchesElsewhere fourth(problem, group);
    if (fourth.empty()) continue;
    sources_.push_back({group, std::move(lifted[group.camera_reference]), std::move(fourth)});
    num_lifted_ += sources_.back().size();
  }
}

void D3p1Sampler::Sample(Rng& rng, std::vector<CamFromLocal>& poses) const {
  poses.clear();
  const DepthSource& source = DrawMatch(rng, sources_, num_lifted_).first;
  const auto sample = DrawDistinct<3>(rng, source.size());
  std::array<Eigen::Vector3d, 3> query_rays;
  std::array<Eigen::Vector3d, 3> points;
  for (int i = 0; i < 3; ++i) {
    query_rays[i] = source.lifted[sample[i]].query_ray;
    points[i] = source.lifted[sample[i]].point_from_center;
  }
  std::array<RelativePose, 4> relative;
  const int count = SolveRelativePoseByDepth(query_rays, points, relative);
  for (int k = 0; k < kFourthMatchesPerSample; ++k) {
    AddPosesByLength(problem_, source.group, std::span(relative).first(count),
                     source.fourth.Draw(problem_, rng), poses);
  }
}

double D3p1Sampler::SuccessProbability(const InlierCounts& inliers) const {
  double success = 0;
  for (const DepthSource& source : sources_) {
    const double ratio = InlierRatio(source, inliers.pose);
    const double fourth =
        1 - std::pow(1 - source.fourth.InlierRatio(inliers), kFourthMatchesPerSample);
    success += std::pow(ratio, 3) * fourth * source.size() / num_lifted_;
  }
  return success;
}

double D3p1Sampler::NumSamples() const {
  double samples = 0;
  for (const DepthSource& source : sources_) {
    samples += NumSets(source.size(), 3) * source.fourth.size();
  }
  return samples;
}

double D3p1Sampler::InlierRatio(const DepthSource& source, const CamFromLocal& pose) const {
  const Eigen::Vector3d center = pose.rotation * problem_.centers[source.group.reference] +
                                 problem_.PoseOfCamera(pose, source.group.camera).translation;
  // Each match near its epipolar line asks for the factor by which its point comes nearest to the
  // query's ray.
  std::vector<double> factors;
  for (const LiftedMatch& match : source.lifted) {
    const Eigen::Vector3d point = pose.rotation * match.point_from_center;
    const Eigen::Vector3d plane_normal = center.cross(point);
    const double off_plane = match.query_ray.dot(plane_normal) * match.image_from_ray.row(0).norm();
    if (std::abs(off_plane) > plane_normal.norm()) continue;
    const Eigen::Vector3d across = match.query_ray.cross(point);
    const double factor = -across.dot(match.query_ray.cross(center)) / across.squaredNorm();
    if (std::isfinite(factor)) factors.push_back(factor);
  }
  const double factor = UpperMedianOr(std::move(factors), 1);
  const auto inliers =
      std::count_if(source.lifted.begin(), source.lifted.end(), [&](const LiftedMatch& match) {
        const Eigen::Vector3d n =
            match.image_from_ray * (factor * (pose.rotation * match.point_from_center) + center);
        return n.z() > 0 && n.head<2>().squaredNorm() < kNearSquared * n.z() * n.z();
      });
  return static_cast<double>(inliers) / source.size();
}

namespace {

using Eigen::Vector3d;

Vector3d DrawNormal(Rng& rng) {
  const double x = rng.Normal();
  const double y = rng.Normal();
  return {x, y, rng.Normal()};
}

// Returns the ray on which the query's own camera sees a point at this distance from it that
// another camera of a rig sees along `ray`; nullopt where that ray nowhere is so far away.
std::optional<Vector3d> RayFromQuery(const Vector3d& camera_center, const Vector3d& ray,
                                     double distance) {
  if (camera_center.isZero(0)) return ray;
  const double along = camera_center.dot(ray);
  const double squared = along * along + distance * distance - camera_center.squaredNorm();
  const double length = std::sqrt(std::max(squared, 0.0)) - along;
  if (!(squared > 0) || !(length > 0)) return std::nullopt;
  return (camera_center + length * ray).normalized();
}

// Returns the angle by which a ray may turn before its pixel leaves the threshold.
double ToleratedAngle(const NormalizedMatch2D3D& point) {
  return std::numbers::sqrt2 / point.image_from_ray.topRows<2>().norm();
}

// Returns about the share of normal draws within the tolerance, along one axis.
double ShareWithin(double tolerance, double sigma) { return std::min(1.0, tolerance / sigma); }

}  // namespace

PriorSampler::TwoPoints PriorSampler::Draw(Rng& rng) const {
  const auto sample = DrawDistinct<2>(rng, static_cast<int>(problem_.matches_2d3d.size()));
  const NormalizedMatch2D3D& a = problem_.matches_2d3d[sample[0]];
  const NormalizedMatch2D3D& b = problem_.matches_2d3d[sample[1]];
  return {{problem_.camera_centers[a.camera], problem_.camera_centers[b.camera]},
          {a.ray, b.ray},
          {a.point, b.point}};
}

double PriorSampler::SuccessProbability(const InlierCounts& inliers) const {
  const double ratio = inliers.of_2d3d / static_cast<double>(problem_.matches_2d3d.size());
  return ratio * ratio * share_near_ * ProbabilityOfPrior(inliers.pose);
}

KnownCenterSampler::KnownCenterSampler(const NormalizedProblem& problem) : PriorSampler(problem) {
  if (!CanSample(problem)) return;
  const auto& prior = *problem.priors.position();
  std::vector<double> tolerated;
  for (const NormalizedMatch2D3D& point : problem.matches_2d3d) {
    tolerated.push_back((point.point - prior.center).norm() * ToleratedAngle(point));
  }
  const double tolerance = UpperMedianOr(std::move(tolerated), 0);
  share_near_ = 1;
  for (int axis = 0; axis < 3; ++axis) share_near_ *= ShareWithin(tolerance, prior.sigma[axis]);
}

bool KnownCenterSampler::CanSample(const NormalizedProblem& problem) {
  return problem.priors.position() && problem.matches_2d3d.size() >= 2;
}

void KnownCenterSampler::Sample(Rng& rng, std::vector<CamFromLocal>& poses) const {
  poses.clear();
  const auto& prior = *problem_.priors.position();
  const TwoPoints sample = Draw(rng);
  const Vector3d center = prior.center + prior.sigma.cwiseProduct(DrawNormal(rng));
  const auto ray = [&](size_t i) {
    return RayFromQuery(sample.centers[i], sample.rays[i], (sample.points[i] - center).norm());
  };
  const auto first = ray(0);
  const auto second = ray(1);
  if (!first || !second) return;
  if (const auto pose = SolvePoseAtCenter({*first, *second}, sample.points, center)) {
    poses.push_back(*pose);
  }
}

double KnownCenterSampler::ProbabilityOfPrior(const CamFromLocal& pose) const {
  return problem_.priors.ProbabilityOfPosition(pose);
}

UprightSampler::UprightSampler(const NormalizedProblem& problem) : PriorSampler(problem) {
  if (!CanSample(problem)) return;
  std::vector<double> tolerated;
  for (const NormalizedMatch2D3D& point : problem.matches_2d3d)
    tolerated.push_back(ToleratedAngle(point));
  const double share =
      ShareWithin(UpperMedianOr(std::move(tolerated), 0), problem.priors.gravity()->sigma);
  share_near_ = share * share;
}

bool UprightSampler::CanSample(const NormalizedProblem& problem) {
  return problem.priors.gravity() && problem.matches_2d3d.size() >= 2;
}

void UprightSampler::Sample(Rng& rng, std::vector<CamFromLocal>& poses) const {
  const auto& prior = *problem_.priors.gravity();
  const TwoPoints sample = Draw(rng);
  const Vector3d down = (prior.down_in_cam + prior.sigma * DrawNormal(rng)).normalized();
  std::array<CamFromLocal, 2> solutions;
  const int count = SolveUprightPose(sample.centers, sample.rays, sample.points, down,
                                     prior.down_in_local, solutions);
  poses.assign(solutions.begin(), solutions.begin() + count);
}

double UprightSampler::ProbabilityOfPrior(const CamFromLocal& pose) const {
  return problem_.priors.ProbabilityOfGravity(pose);
}

}  // namespace raylift
