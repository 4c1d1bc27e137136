#include "estimation/hypothesis_generators.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "estimation/solvers/e5p1.h"

namespace raylift {
namespace {

// Sixth matches tried per essential matrix: they cost little beside the five-point solver.
constexpr int kSixthMatchesPerSample = 2;

// `kCount` different indices in [0, n).
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

RayPair ToRayPair(const PreparedPair& pair) { return {pair.query_ray, pair.reference_ray}; }

}  // namespace

P3pGenerator::P3pGenerator(const PreparedProblem& problem) : problem_(problem) {}

bool P3pGenerator::CanSample(const PreparedProblem& problem) { return problem.points.size() >= 3; }

void P3pGenerator::Generate(Rng& rng, std::vector<SolverPose>& poses) const {
  poses.clear();
  const auto sample = DrawDistinct<3>(rng, static_cast<int>(problem_.points.size()));
  const PreparedPoint& a = problem_.points[sample[0]];
  const PreparedPoint& b = problem_.points[sample[1]];
  const PreparedPoint& c = problem_.points[sample[2]];
  std::array<SolverPose, 4> solutions;
  const int count = SolveP3p({a.ray, b.ray, c.ray}, {a.point, b.point, c.point}, solutions);
  poses.assign(solutions.begin(), solutions.begin() + count);
  // Where the matches cannot tell solutions apart (three of them fit each exactly), the one nearest
  // to the references, whose centre is the origin, is the likeliest: they were retrieved for what
  // the query sees.
  std::sort(poses.begin(), poses.end(), [](const SolverPose& left, const SolverPose& right) {
    return left.translation.squaredNorm() < right.translation.squaredNorm();
  });
}

double P3pGenerator::SuccessProbability(const InlierCounts& inliers) const {
  const double ratio = inliers.points / static_cast<double>(problem_.points.size());
  return ratio * ratio * ratio;
}

E5p1Generator::E5p1Generator(const PreparedProblem& problem) : problem_(problem) {
  for (const ReferenceRun& run : problem.runs) {
    if (run.size() < 5) {
      continue;
    }
    FiveSource source;
    source.run = run;
    for (const ReferenceRun& other : problem.runs) {
      const double distance =
          (problem.centres[other.reference] - problem.centres[run.reference]).norm();
      if (distance > 1e-6) {
        source.sixth_runs.push_back(other);
        source.num_sixth += other.size();
      }
    }
    position_observable_ = position_observable_ || source.num_sixth > 0;
    sources_.push_back(std::move(source));
  }
  if (position_observable_) {
    std::erase_if(sources_, [](const FiveSource& source) { return source.num_sixth == 0; });
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
  int position = static_cast<int>(rng.UniformIndex(static_cast<uint32_t>(num_five_)));
  const FiveSource* source = sources_.data();
  while (position >= source->run.size()) {
    position -= source->run.size();
    ++source;
  }
  const auto sample = DrawDistinct<5>(rng, source->run.size());
  std::array<Eigen::Vector3d, 5> query_rays;
  std::array<Eigen::Vector3d, 5> reference_rays;
  for (int i = 0; i < 5; ++i) {
    const PreparedPair& pair = problem_.pairs[source->run.begin + sample[i]];
    query_rays[i] = pair.query_ray;
    reference_rays[i] = pair.reference_ray;
  }
  std::array<RelativePose, kMaxFivePointSolutions> relative;
  const int count = SolveRelativePose(query_rays, reference_rays, relative);
  const Eigen::Vector3d& centre = problem_.centres[source->run.reference];
  if (!position_observable_) {
    for (int i = 0; i < count; ++i) {
      poses.push_back(QueryPose(relative[i], centre, 1));
    }
    return;
  }
  for (int k = 0; k < kSixthMatchesPerSample; ++k) {
    int sixth = static_cast<int>(rng.UniformIndex(static_cast<uint32_t>(source->num_sixth)));
    auto run = source->sixth_runs.begin();
    while (sixth >= run->size()) {
      sixth -= run->size();
      ++run;
    }
    const PreparedPair& pair = problem_.pairs[run->begin + sixth];
    for (int i = 0; i < count; ++i) {
      const auto length =
          TranslationLength(relative[i], centre, ToRayPair(pair), problem_.centres[run->reference]);
      if (length) {
        poses.push_back(QueryPose(relative[i], centre, *length));
      }
    }
  }
}

double E5p1Generator::SuccessProbability(const InlierCounts& inliers) const {
  double success = 0;
  for (const FiveSource& source : sources_) {
    const double ratio =
        inliers.pairs[source.run.reference] / static_cast<double>(source.run.size());
    double sixth = 1;
    if (position_observable_) {
      double sixth_inliers = 0;
      for (const ReferenceRun& run : source.sixth_runs) {
        sixth_inliers += inliers.pairs[run.reference];
      }
      sixth = 1 - std::pow(1 - sixth_inliers / source.num_sixth, kSixthMatchesPerSample);
    }
    success += std::pow(ratio, 5) * sixth * source.run.size() / num_five_;
  }
  return success;
}

}  // namespace raylift
