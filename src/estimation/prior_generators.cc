#include "estimation/prior_generators.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>

#include "base/statistics.h"
#include "estimation/draw_distinct.h"
#include "estimation/solvers/p2p.h"

namespace raylift {
namespace {

using Eigen::Vector3d;

Vector3d DrawNormal(Rng& rng) {
  const double x = rng.Normal();
  const double y = rng.Normal();
  return {x, y, rng.Normal()};
}

// Where the query's own camera sees a point that lies so far from it, if another camera of a rig
// sees it along this ray; none where that ray nowhere is so far away.
std::optional<Vector3d> RayFromQuery(const Vector3d& camera_center, const Vector3d& ray,
                                     double distance) {
  if (camera_center.isZero(0)) return ray;
  const double along = camera_center.dot(ray);
  const double squared = along * along + distance * distance - camera_center.squaredNorm();
  const double length = std::sqrt(std::max(squared, 0.0)) - along;
  if (!(squared > 0) || !(length > 0)) return std::nullopt;
  return (camera_center + length * ray).normalized();
}

// By how much a ray may turn before its pixel leaves the threshold.
double ToleratedTurn(const PreparedPoint& point) {
  return std::numbers::sqrt2 / point.image_from_ray.topRows<2>().norm();
}

// The share of normal draws within the tolerance, about: along one axis.
double ShareWithin(double tolerance, double sigma) { return std::min(1.0, tolerance / sigma); }

}  // namespace

PriorGenerator::TwoPoints PriorGenerator::Draw(Rng& rng) const {
  const auto sample = DrawDistinct<2>(rng, static_cast<int>(problem_.points.size()));
  const PreparedPoint& a = problem_.points[sample[0]];
  const PreparedPoint& b = problem_.points[sample[1]];
  return {{problem_.camera_centers[a.camera], problem_.camera_centers[b.camera]},
          {a.ray, b.ray},
          {a.point, b.point}};
}

double PriorGenerator::SuccessProbability(const InlierCounts& inliers) const {
  const double ratio = inliers.points / static_cast<double>(problem_.points.size());
  return ratio * ratio * share_near_ * ProbabilityOfPrior(inliers.pose);
}

KnownCenterGenerator::KnownCenterGenerator(const PreparedProblem& problem)
    : PriorGenerator(problem) {
  if (!CanSample(problem)) return;
  const auto& prior = *problem.priors.position();
  std::vector<double> tolerated;
  for (const PreparedPoint& point : problem.points) {
    tolerated.push_back((point.point - prior.center).norm() * ToleratedTurn(point));
  }
  const double tolerance = UpperMedianOr(std::move(tolerated), 0);
  share_near_ = 1;
  for (int axis = 0; axis < 3; ++axis) share_near_ *= ShareWithin(tolerance, prior.sigma[axis]);
}

bool KnownCenterGenerator::CanSample(const PreparedProblem& problem) {
  return problem.priors.position() && problem.points.size() >= 2;
}

void KnownCenterGenerator::Generate(Rng& rng, std::vector<SolverPose>& poses) const {
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

double KnownCenterGenerator::ProbabilityOfPrior(const SolverPose& pose) const {
  return problem_.priors.ProbabilityOfPosition(pose);
}

UprightGenerator::UprightGenerator(const PreparedProblem& problem) : PriorGenerator(problem) {
  if (!CanSample(problem)) return;
  std::vector<double> tolerated;
  for (const PreparedPoint& point : problem.points) tolerated.push_back(ToleratedTurn(point));
  const double share =
      ShareWithin(UpperMedianOr(std::move(tolerated), 0), problem.priors.gravity()->sigma);
  share_near_ = share * share;
}

bool UprightGenerator::CanSample(const PreparedProblem& problem) {
  return problem.priors.gravity() && problem.points.size() >= 2;
}

void UprightGenerator::Generate(Rng& rng, std::vector<SolverPose>& poses) const {
  const auto& prior = *problem_.priors.gravity();
  const TwoPoints sample = Draw(rng);
  const Vector3d down = (prior.down_in_cam + prior.sigma * DrawNormal(rng)).normalized();
  std::array<SolverPose, 2> solutions;
  const int count = SolveUprightPose(sample.centers, sample.rays, sample.points, down,
                                     prior.down_in_local, solutions);
  poses.assign(solutions.begin(), solutions.begin() + count);
}

double UprightGenerator::ProbabilityOfPrior(const SolverPose& pose) const {
  return problem_.priors.ProbabilityOfGravity(pose);
}

}  // namespace raylift
