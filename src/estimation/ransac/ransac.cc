#include "estimation/ransac/ransac.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "raylift/base/parallel.h"

namespace raylift {
namespace {

// A sample comes near the best one if its gain over no fit at all is at least this share of the
// best one's.
constexpr double kNearBestGain = 0.85;

// At most so many alternatives are kept, each with at least this share of the best pose's gain.
constexpr size_t kMaxAlternatives = 3;
constexpr double kAlternativeGain = 0.5;

double SamplesForConfidence(double success_probability, double confidence) {
  if (success_probability <= 0) {
    return std::numeric_limits<double>::infinity();
  }
  if (success_probability >= 1) {
    return 1;
  }
  return std::log(1 - confidence) / std::log1p(-success_probability);
}

// A solver, the samples that it has drawn, and how many it requires.
struct SolverProgress {
  RansacSolver solver;
  int samples = 0;
  double success_probability = 0;  // of a sample, by the best pose so far
  double required = std::numeric_limits<double>::infinity();

  bool Done() const { return samples >= required; }
};

// Keeps the poses of E5+1 and of D3+1 that score best on the 2D-2D matches alone, which depths that
// are wrong together may outvote.
class BestOf2D2D {
 public:
  BestOf2D2D(const NormalizedProblem& problem, OptimizedMatches matches)
      : problem_(problem),
        matches_(matches),
        pose_score_(MatchSets::k2D2D, ScoreCombination::kSumMsac, problem.num_matches_2d3d,
                    problem.num_matches_2d2d),
        scorer_(problem, pose_score_) {}
  BestOf2D2D(const BestOf2D2D&) = delete;
  BestOf2D2D& operator=(const BestOf2D2D&) = delete;

  // Does what Scorer::ExpectClusters() does.
  void ExpectClusters(double clustering_2d2d) { scorer_.ExpectClusters(clustering_2d2d); }

  void Consider(const RansacResult& hypothesis) {
    for (BestOfSolver& best : best_) {
      if (hypothesis.solver != best.solver) continue;
      const auto score = scorer_.ScoreIfBetter(hypothesis.pose, best.value);
      if (!score) return;
      best.result = hypothesis;
      best.value = pose_score_.Value(*score);
    }
  }

  // Returns the best hypotheses of the solvers, locally optimized, where they are other answers
  // than the best pose and leave it in doubt. `scorer` scores both.
  std::vector<RansacResult> ApartFrom(const RansacResult& best, const Scorer& scorer) const {
    std::vector<RansacResult> others;
    const SetScores of_best = scorer.ScoreAll(best.pose);
    for (const BestOfSolver& of_solver : best_) {
      if (!of_solver.result) continue;
      RansacResult optimized = *of_solver.result;
      optimized.pose =
          OptimizeLocally(problem_, optimized.pose, MatchSets::k2D2D, kLocalSteps, matches_);
      const bool is_new = AreApart(optimized.pose, best.pose) &&
                          std::all_of(others.begin(), others.end(), [&](const RansacResult& other) {
                            return AreApart(other.pose, optimized.pose);
                          });
      if (is_new && IsInDoubt(of_best, scorer.ScoreAll(optimized.pose)))
        others.push_back(optimized);
    }
    return others;
  }

 private:
  struct BestOfSolver {
    Solver solver;
    std::optional<RansacResult> result = std::nullopt;
    double value = std::numeric_limits<double>::infinity();
  };

  // Returns whether the 2D-2D matches contradict the best pose: their cost is higher by more than
  // three standard deviations of the number of inliers than for the other pose, or it explains a
  // much smaller share of the 2D-3D matches than of the 2D-2D matches. Then depths of some
  // references are wrong together.
  bool IsInDoubt(const SetScores& of_best, const SetScores& of_other) const {
    constexpr double kShare = 0.75;
    const double inliers = of_best.of_2d2d.inliers;
    const double of_2d3d = of_best.of_2d3d.inliers / std::max(1.0, 1.0 * problem_.num_matches_2d3d);
    const double of_2d2d = inliers / std::max(1.0, 1.0 * problem_.num_matches_2d2d);
    return of_2d3d < kShare * of_2d2d ||
           of_best.of_2d2d.cost - of_other.of_2d2d.cost > 3 * std::sqrt(inliers);
  }

  const NormalizedProblem& problem_;
  OptimizedMatches matches_;
  PoseScore pose_score_;
  Scorer scorer_;
  std::array<BestOfSolver, 2> best_ = {{{Solver::kE5p1}, {Solver::kD3p1}}};
};

// The state of one run.
class Ransac {
 public:
  Ransac(const NormalizedProblem& problem, const PoseScore& pose_score,
         const std::vector<RansacSolver>& solvers, SolverSchedule schedule,
         const RansacOptions& options)
      : problem_(problem),
        schedule_(schedule),
        options_(options),
        scorer_(problem, pose_score),
        near_best_left_(options.optimization.max_near_best) {
    for (const RansacSolver& solver : solvers) {
      solvers_.push_back({solver});
    }
    if (options.keeps_best_of_2d2d && pose_score.sets() == MatchSets::kBoth) {
      by_2d2d_.emplace(problem, options.optimization.matches);
    }
    SetScores none;
    none.of_2d3d.cost = problem.num_matches_2d3d;
    none.of_2d2d.cost = problem.num_matches_2d2d;
    none.prior = problem.priors.WorstCost();
    worst_value_ = pose_score.Value(none);
    SetScores all;
    all.of_2d3d.inliers = problem.num_matches_2d3d;
    all.of_2d2d.inliers = problem.num_matches_2d2d;
    best_possible_ = pose_score.Value(all);
  }

  RansacReport Run(Rng& rng) {
    CallWatch* const watch = CallWatch::Current();
    int iteration = 0;
    while (iteration < options_.max_iterations && !IsExact(sample_value_) &&
           (iteration < options_.min_iterations || !AnyDone())) {
      ++iteration;
      if (watch != nullptr) watch->Check();
      if (schedule_ == SolverSchedule::kByProbability) {
        Sample(Choose(rng), rng);
      } else {
        for (SolverProgress& progress : solvers_) {
          Sample(progress, rng);
        }
      }
      if (iteration >= options_.optimization.first_iteration) {
        Optimize();
      }
    }
    Optimize();
    RansacReport report{best_, best_value_, Alternatives(), {}, iteration};
    if (best_ && by_2d2d_) report.best_of_2d2d = by_2d2d_->ApartFrom(*best_, scorer_);
    return report;
  }

 private:
  bool AnyDone() const {
    return std::any_of(solvers_.begin(), solvers_.end(),
                       [](const SolverProgress& progress) { return progress.Done(); });
  }

  // Returns whether nothing can score better: all matches fit but for rounding or, where inliers
  // are counted, all are inliers. Of the solutions of one sample the first is then taken.
  bool IsExact(double value) const {
    return value - best_possible_ < 1e-6 * (worst_value_ - best_possible_);
  }

  // Draws a solver by the probability that its next sample is the first that is of inliers alone
  // (Eq. 1 of Camposeco et al.); uniformly as long as no pose is known.
  SolverProgress& Choose(Rng& rng) {
    std::vector<double> weights;
    double sum = 0;
    for (const SolverProgress& progress : solvers_) {
      weights.push_back(progress.success_probability * std::pow(1 - progress.success_probability,
                                                                std::max(progress.samples - 1, 0)));
      sum += weights.back();
    }
    if (!(sum > 0)) {
      return solvers_[rng.UniformIndex(static_cast<uint32_t>(solvers_.size()))];
    }
    double draw = rng.Uniform(0, sum);
    size_t chosen = 0;
    while (chosen + 1 < weights.size() && draw >= weights[chosen]) {
      draw -= weights[chosen++];
    }
    return solvers_[chosen];
  }

  void Sample(SolverProgress& progress, Rng& rng) {
    ++progress.samples;
    progress.solver.sampler->Sample(rng, poses_);
    for (const CamFromLocal& pose : poses_) {
      const RansacResult hypothesis{pose, progress.solver.solver, progress.solver.optimized_sets};
      Consider(hypothesis);
      if (by_2d2d_) by_2d2d_->Consider(hypothesis);
    }
  }

  // Keeps a sample's pose for optimization if it beats those of all samples before. As the optimum
  // of a second best sample can be the better one (a plane has two, half as many more are made by
  // noise), a few that come near the best are optimized as well.
  void Consider(const RansacResult& hypothesis) {
    if (IsExact(sample_value_)) {
      return;
    }
    const PoseScore& pose_score = scorer_.pose_score();
    const double near_best =
        near_best_left_ > 0
            ? worst_value_ - kNearBestGain * (worst_value_ - std::min(sample_value_, worst_value_))
            : sample_value_;
    const double bound = pending_ ? std::min(near_best, pending_value_) : near_best;
    const auto score = scorer_.ScoreIfBetter(hypothesis.pose, bound);
    if (!score) {
      return;
    }
    pending_ = hypothesis;
    pending_value_ = pose_score.Value(*score);
    near_best_left_ -= pending_value_ < sample_value_ ? 0 : 1;
    sample_value_ = std::min(sample_value_, pending_value_);
  }

  void Optimize() {
    if (!pending_) {
      return;
    }
    bool improved = TakeIfBetter(*pending_, Role::kSample);
    RansacResult optimized = *pending_;
    optimized.pose = OptimizeLocally(problem_, pending_->pose, pending_->optimized_sets,
                                     kLocalSteps, options_.optimization.matches);
    improved = TakeIfBetter(optimized, Role::kOptimized) || improved;
    if (improved) {
      UpdateRequiredSamples();
    }
    pending_.reset();
  }

  enum class Role { kSample, kOptimized };

  // Takes a candidate as the best pose if its exact score is better: so few poses are worth looking
  // at all matches. Returns whether it did.
  bool TakeIfBetter(const RansacResult& candidate, Role role) {
    const double value = scorer_.pose_score().Value(scorer_.ScoreAll(candidate.pose));
    if (role == Role::kOptimized) optimized_.push_back({value, candidate.pose});
    if (!(value < best_value_)) {
      return false;
    }
    best_ = candidate;
    best_value_ = value;
    return true;
  }

  // Returns the best of the optimized poses that are apart from the best one and from each other.
  std::vector<CamFromLocal> Alternatives() {
    if (!best_) return {};
    std::stable_sort(optimized_.begin(), optimized_.end(),
                     [](const Optimized& a, const Optimized& b) { return a.value < b.value; });
    std::vector<CamFromLocal> alternatives;
    for (const Optimized& other : optimized_) {
      if (worst_value_ - other.value < kAlternativeGain * (worst_value_ - best_value_) ||
          alternatives.size() == kMaxAlternatives) {
        break;
      }
      const bool is_new = std::all_of(
          alternatives.begin(), alternatives.end(),
          [&](const CamFromLocal& alternative) { return AreApart(alternative, other.pose); });
      if (is_new && AreApart(best_->pose, other.pose)) alternatives.push_back(other.pose);
    }
    return alternatives;
  }

  void UpdateRequiredSamples() {
    const InlierCounts inliers = scorer_.CountInliers(best_->pose);
    scorer_.ExpectClusters(inliers.clustering_2d2d);
    if (by_2d2d_) by_2d2d_->ExpectClusters(inliers.clustering_2d2d);
    for (SolverProgress& progress : solvers_) {
      progress.success_probability = progress.solver.sampler->SuccessProbability(inliers);
      progress.required = SamplesForConfidence(progress.success_probability, options_.confidence);
    }
  }

  const NormalizedProblem& problem_;
  SolverSchedule schedule_;
  const RansacOptions& options_;
  Scorer scorer_;
  std::optional<BestOf2D2D> by_2d2d_;
  std::vector<SolverProgress> solvers_;
  std::vector<CamFromLocal> poses_;  // of the last sample
  double worst_value_;               // of a pose that nothing fits
  double best_possible_;             // of one that everything fits exactly
  double sample_value_ = std::numeric_limits<double>::infinity();  // of the best sample
  struct Optimized {
    double value;
    CamFromLocal pose;
  };
  std::vector<Optimized> optimized_;
  int near_best_left_;
  std::optional<RansacResult> pending_;  // to be optimized
  double pending_value_ = std::numeric_limits<double>::infinity();
  std::optional<RansacResult> best_;
  double best_value_ = std::numeric_limits<double>::infinity();
};

}  // namespace

bool AreApart(const CamFromLocal& a, const CamFromLocal& b) {
  constexpr double kRotation = 0.01;
  constexpr double kTranslation = 0.1;
  const Eigen::Matrix3d rotation = a.rotation * b.rotation.transpose();
  const Eigen::Vector3d translation =
      a.rotation.transpose() * a.translation - b.rotation.transpose() * b.translation;
  return rotation.trace() < 1 + 2 * std::cos(kRotation) || translation.norm() > kTranslation;
}

RansacReport RunRansac(const NormalizedProblem& problem, const PoseScore& pose_score,
                       const std::vector<RansacSolver>& solvers, SolverSchedule schedule,
                       const RansacOptions& options, Rng& rng) {
  if (solvers.empty()) {
    return {};
  }
  return Ransac(problem, pose_score, solvers, schedule, options).Run(rng);
}

}  // namespace raylift
