#include "estimation/hypothesis_generators.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <utility>

#include "base/statistics.h"
#include "estimation/draw_distinct.h"
#include "estimation/match_residuals.h"
#include "estimation/solvers/d3p1.h"
#include "estimation/solvers/e5p1.h"
#include "estimation/solvers/gp3p.h"
#include <Eigen/LU>

namespace raylift {
namespace {

// Sixth matches tried per essential matrix: they cost little beside the five-point solver.
constexpr int kSixthMatchesPerSample = 2;
constexpr int kFourthMatchesPerSample = 2;

// One match of all groups, whose sizes sum to `total`: its group, and its position there.
template <typename Group>
std::pair<const Group&, int> DrawMatch(Rng& rng, const std::vector<Group>& groups, int total) {
  int position = static_cast<int>(rng.UniformIndex(static_cast<uint32_t>(total)));
  auto group = groups.begin();
  while (position >= group->size()) position -= (group++)->size();
  return {*group, position};
}

// The query's pose, from one of its cameras relative to a reference.
SolverPose QueryPoseOf(const PreparedProblem& problem, const ReferenceRun& run,
                       const RelativePose& relative, double length) {
  SolverPose pose = QueryPose(relative, problem.centers[run.reference], length);
  pose.translation += problem.camera_centers[run.camera];
  return pose;
}

// Adds the poses that a camera has relative to a reference, each with the length that a pair of
// another reference or camera gives it.
void AddPosesByLength(const PreparedProblem& problem, const ReferenceRun& run,
                      std::span<const RelativePose> relative, const PreparedPair& pair,
                      std::vector<SolverPose>& poses) {
  const RayPair rays = {pair.query_ray, pair.reference_ray};
  // The other camera sees its reference as this one would see it if it stood by so much elsewhere.
  const Eigen::Vector3d lever =
      problem.camera_centers[run.camera] - problem.camera_centers[pair.camera];
  for (const RelativePose& pose : relative) {
    const Eigen::Vector3d sixth_center =
        problem.centers[pair.reference] + pose.rotation.transpose() * lever;
    if (const auto length =
            TranslationLength(pose, problem.centers[run.reference], rays, sixth_center)) {
      poses.push_back(QueryPoseOf(problem, run, pose, *length));
    }
  }
}

// Of n things, how many sets of k there are.
double NumSets(double n, int k) {
  double sets = 1;
  for (int i = 0; i < k; ++i) sets *= (n - i) / (i + 1);
  return std::max(sets, 0.0);
}

}  // namespace

P3pGenerator::P3pGenerator(const PreparedProblem& problem) : problem_(problem) {}

bool P3pGenerator::CanSample(const PreparedProblem& problem) { return problem.points.size() >= 3; }

void P3pGenerator::Generate(Rng& rng, std::vector<SolverPose>& poses) const {
  poses.clear();
  const auto sample = DrawDistinct<3>(rng, static_cast<int>(problem_.points.size()));
  const PreparedPoint& a = problem_.points[sample[0]];
  const PreparedPoint& b = problem_.points[sample[1]];
  const PreparedPoint& c = problem_.points[sample[2]];
  std::array<SolverPose, kMaxGeneralizedP3pSolutions> solutions;
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
  // Where the matches cannot tell solutions apart (three of them fit each exactly), the one nearest
  // to the references, whose center is the origin, is the likeliest: they were retrieved for what
  // the query sees.
  std::sort(poses.begin(), poses.end(), [](const SolverPose& left, const SolverPose& right) {
    return left.translation.squaredNorm() < right.translation.squaredNorm();
  });
}

double P3pGenerator::SuccessProbability(const InlierCounts& inliers) const {
  const double ratio = inliers.points / static_cast<double>(problem_.points.size());
  return ratio * ratio * ratio;
}

double P3pGenerator::NumSamples() const {
  return NumSets(static_cast<double>(problem_.points.size()), 3);
}

PairsElsewhere::PairsElsewhere(const PreparedProblem& problem, const ReferenceRun& run) {
  const auto are_apart = [](const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
    return (a - b).norm() > 1e-6;
  };
  for (const ReferenceRun& other : problem.runs) {
    if (are_apart(problem.centers[other.reference], problem.centers[run.reference]) ||
        are_apart(problem.camera_centers[other.camera], problem.camera_centers[run.camera])) {
      runs_.push_back(other);
      count_ += other.size();
    }
  }
}

const PreparedPair& PairsElsewhere::Draw(const PreparedProblem& problem, Rng& rng) const {
  const auto [run, position] = DrawMatch(rng, runs_, count_);
  return problem.pairs[run.begin + position];
}

double PairsElsewhere::InlierRatio(const InlierCounts& inliers) const {
  double sum = 0;
  for (const ReferenceRun& run : runs_) sum += inliers.pairs[run.view];
  return sum / count_;
}

E5p1Generator::E5p1Generator(const PreparedProblem& problem) : problem_(problem) {
  for (const ReferenceRun& run : problem.runs) {
    if (run.size() < 5) {
      continue;
    }
    sources_.push_back({run, PairsElsewhere(problem, run)});
    position_observable_ = position_observable_ || !sources_.back().sixth.empty();
  }
  if (position_observable_) {
    std::erase_if(sources_, [](const FiveSource& source) { return source.sixth.empty(); });
  }
  for (const FiveSource& source : sources_) {
    num_five_ += source.run.size();
  }
}

bool E5p1Generator::CanSample(const PreparedProblem& problem) {
  return std::any_of(problem.runs.begin(), problem.runs.end(),
                     [](const ReferenceRun& run) { return run.size() >= 5; });
}

void E5p1Generator::Generate(Rng& rng, std::vector<SolverPose>& poses) const {
  poses.clear();
  const FiveSource& source = DrawMatch(rng, sources_, num_five_).first;
  const auto sample = DrawDistinct<5>(rng, source.size());
  std::array<Eigen::Vector3d, 5> query_rays;
  std::array<Eigen::Vector3d, 5> reference_rays;
  for (int i = 0; i < 5; ++i) {
    const PreparedPair& pair = problem_.pairs[source.run.begin + sample[i]];
    query_rays[i] = pair.query_ray;
    reference_rays[i] = pair.reference_ray;
  }
  std::array<RelativePose, kMaxFivePointSolutions> relative;
  const int count = SolveRelativePose(query_rays, reference_rays, relative);
  if (!position_observable_) {
    for (int i = 0; i < count; ++i) {
      poses.push_back(QueryPoseOf(problem_, source.run, relative[i], 1));
    }
    return;
  }
  for (int k = 0; k < kSixthMatchesPerSample; ++k) {
    AddPosesByLength(problem_, source.run, std::span(relative).first(count),
                     source.sixth.Draw(problem_, rng), poses);
  }
}

double E5p1Generator::SuccessProbability(const InlierCounts& inliers) const {
  double success = 0;
  for (const FiveSource& source : sources_) {
    const double ratio = inliers.pairs[source.run.view] / static_cast<double>(source.size());
    const double sixth = position_observable_ ? 1 - std::pow(1 - source.sixth.InlierRatio(inliers),
                                                             kSixthMatchesPerSample)
                                              : 1;
    success += std::pow(ratio, 5) * sixth * source.size() / num_five_;
  }
  return success;
}

double E5p1Generator::NumSamples() const {
  double samples = 0;
  for (const FiveSource& source : sources_) {
    samples += NumSets(source.size(), 5) * (position_observable_ ? source.sixth.size() : 1);
  }
  return samples;
}

D3p1Generator::D3p1Generator(const PreparedProblem& problem, const KeypointEvidence& evidence)
    : problem_(problem) {
  std::vector<std::vector<LiftedMatch>> lifted(problem.num_views());
  for (const KeypointParts& keypoint : evidence.keypoints) {
    const auto sightings = evidence.SightingsOf(keypoint);
    if (std::none_of(sightings.begin(), sightings.end(),
                     [](const Sighting& sighting) { return sighting.has_depth; })) {
      continue;
    }
    const Eigen::Vector3d query_ray = keypoint.image_from_cam.inverse().col(2).normalized();
    Eigen::Matrix3d image_from_ray = keypoint.image_from_cam;
    image_from_ray.topRows<2>() /= problem.reprojection_threshold_px;
    for (const Sighting& sighting : sightings) {
      if (!sighting.has_depth) continue;
      lifted[problem.ViewOf(keypoint.camera, sighting.reference)].push_back(
          {query_ray, image_from_ray, std::exp(sighting.log_distance) * sighting.ray});
    }
  }
  for (const ReferenceRun& run : problem.runs) {
    if (lifted[run.view].size() < 3) continue;
    PairsElsewhere fourth(problem, run);
    if (fourth.empty()) continue;
    sources_.push_back({run, std::move(lifted[run.view]), std::move(fourth)});
    num_lifted_ += sources_.back().size();
  }
}

void D3p1Generator::Generate(Rng& rng, std::vector<SolverPose>& poses) const {
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
    AddPosesByLength(problem_, source.run, std::span(relative).first(count),
                     source.fourth.Draw(problem_, rng), poses);
  }
}

double D3p1Generator::SuccessProbability(const InlierCounts& inliers) const {
  double success = 0;
  for (const DepthSource& source : sources_) {
    const double ratio = InlierRatio(source, inliers.pose);
    const double fourth =
        1 - std::pow(1 - source.fourth.InlierRatio(inliers), kFourthMatchesPerSample);
    success += std::pow(ratio, 3) * fourth * source.size() / num_lifted_;
  }
  return success;
}

double D3p1Generator::NumSamples() const {
  double samples = 0;
  for (const DepthSource& source : sources_) {
    samples += NumSets(source.size(), 3) * source.fourth.size();
  }
  return samples;
}

double D3p1Generator::InlierRatio(const DepthSource& source, const SolverPose& pose) const {
  const Eigen::Vector3d center = pose.rotation * problem_.centers[source.run.reference] +
                                 problem_.PoseOfCamera(pose, source.run.camera).translation;
  // The factor that each match near its epipolar line asks for: by which its point comes nearest to
  // the query's ray.
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

}  // namespace raylift
