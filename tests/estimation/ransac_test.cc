#include "estimation/ransac/ransac.h"

#include <algorithm>
#include <cmath>

#include "estimation/near_truth.h"

namespace raylift {
namespace {

// Gives the same poses every time, and says how likely it is to succeed.
class FixedGenerator final : public HypothesisSampler {
 public:
  FixedGenerator(std::vector<CamFromLocal> poses, double success_probability)
      : poses_(std::move(poses)), success_probability_(success_probability) {}

  void Sample(Rng& /*rng*/, std::vector<CamFromLocal>& poses) const override {
    ++num_samples_;
    poses = poses_;
  }
  double SuccessProbability(const InlierCounts& /*inliers*/) const override {
    return success_probability_;
  }
  double NumSamples() const override { return std::numeric_limits<double>::infinity(); }
  int num_samples() const { return num_samples_; }

 private:
  std::vector<CamFromLocal> poses_;
  double success_probability_;
  mutable int num_samples_ = 0;
};

EstimatorOptions Iterations(int min_iterations, int max_iterations) {
  EstimatorOptions options;
  options.min_iterations = min_iterations;
  options.max_iterations = max_iterations;
  return options;
}

PoseScore SumOfBoth(const NormalizedProblem& problem) {
  return PoseScore(MatchSets::kBoth, ScoreCombination::kSumMsac,
                   static_cast<int>(problem.matches_2d3d.size()),
                   static_cast<int>(problem.matches_2d2d.size()));
}

RansacReport RunWith(const NearTruth& near, const std::vector<RansacSolver>& solvers,
                     const EstimatorOptions& options, Rng& rng,
                     SolverSchedule schedule = SolverSchedule::kAll) {
  return RunRansac(near.prepared, SumOfBoth(near.prepared), solvers, schedule, options, rng);
}

TEST(Ransac, RunsToItsBoundWhereNoSampleIsLikelyToSucceed) {
  Rng rng = TestRng();
  const NearTruth near = MakeNearTruth(rng, {});
  const FixedGenerator hopeless({near.local}, 0);
  const auto report =
      RunWith(near, {{&hopeless, Solver::kP3p, MatchSets::kBoth}}, Iterations(10, 57), rng);
  EXPECT_EQ(report.iterations, 57);
  EXPECT_TRUE(report.best) << "the best of what there was";
}

TEST(Ransac, RunsItsLeastIterationsWhereEverySampleSucceeds) {
  Rng rng = TestRng();
  const NearTruth near = MakeNearTruth(rng, {});
  const FixedGenerator sure({near.local}, 1);
  const auto report =
      RunWith(near, {{&sure, Solver::kP3p, MatchSets::kBoth}}, Iterations(23, 1000), rng);
  EXPECT_EQ(report.iterations, 23);
}

// 1 - (1 - p)^n >= confidence.
TEST(Ransac, DrawsAsManySamplesAsTheConfidenceAsksFor) {
  Rng rng = TestRng();
  const NearTruth near = MakeNearTruth(rng, {});
  for (const double probability : {0.5, 0.125, 0.01}) {
    for (const double confidence : {0.9, 0.9999}) {
      EstimatorOptions options = Iterations(10, 100000);
      options.confidence = confidence;
      const FixedGenerator sampler({near.local}, probability);
      const auto report = RunWith(near, {{&sampler, Solver::kP3p, MatchSets::kBoth}}, options, rng);
      const int needed =
          static_cast<int>(std::ceil(std::log(1 - confidence) / std::log(1 - probability)));
      EXPECT_EQ(report.iterations, std::max(10, needed));
    }
  }
}

TEST(Ransac, EndsWithTheFirstSolverThatIsDone) {
  Rng rng = TestRng();
  const NearTruth near = MakeNearTruth(rng, {});
  const FixedGenerator hopeless({near.local}, 0);
  const FixedGenerator good({near.local}, 0.1);
  const auto report = RunWith(
      near, {{&hopeless, Solver::kP3p, MatchSets::kBoth}, {&good, Solver::kE5p1, MatchSets::kBoth}},
      Iterations(10, 100000), rng);
  EXPECT_EQ(report.iterations, std::ceil(std::log(1e-4) / std::log(0.9)));
  EXPECT_EQ(hopeless.num_samples(), report.iterations) << "each draws in every iteration";
  EXPECT_EQ(good.num_samples(), report.iterations);
}

TEST(Ransac, DrawsOneSolverAtATimeWhereItIsChosenByProbability) {
  Rng rng = TestRng();
  const NearTruth near = MakeNearTruth(rng, {});
  const FixedGenerator hopeless({near.local}, 0);
  const FixedGenerator good({near.local}, 0.01);
  const auto report = RunWith(
      near, {{&hopeless, Solver::kP3p, MatchSets::kBoth}, {&good, Solver::kE5p1, MatchSets::kBoth}},
      Iterations(10, 500), rng, SolverSchedule::kByProbability);
  EXPECT_EQ(hopeless.num_samples() + good.num_samples(), report.iterations);
  EXPECT_LT(hopeless.num_samples(), 15) << "only as long as no pose is known";
}

TEST(Ransac, EndsAtOnceWhereNothingCanFitBetter) {
  Rng rng = TestRng();
  SyntheticOptions perfect;
  perfect.sigma_px = 0;
  perfect.outlier_ratio_2d3d = perfect.outlier_ratio_2d2d = {0, 0};
  const NearTruth near = MakeNearTruth(rng, perfect);
  const P3pSampler p3p(near.prepared);
  const auto report =
      RunWith(near, {{&p3p, Solver::kP3p, MatchSets::kBoth}}, Iterations(100, 1000), rng);
  EXPECT_EQ(report.iterations, 1);
  ASSERT_TRUE(report.best);
  EXPECT_TRUE(near.IsTrue(report.best->pose, 1e-4, 1e-4));
}

TEST(Ransac, KeepsTheBestPoseAndWhoMadeIt) {
  Rng rng = TestRng();
  const NearTruth near = MakeNearTruth(rng, {}, 30, 3);
  const FixedGenerator wrong({near.local}, 0);
  const FixedGenerator right({near.local, near.local_truth}, 0);
  const auto report = RunWith(
      near, {{&wrong, Solver::kP3p, MatchSets::kBoth}, {&right, Solver::kE5p1, MatchSets::kBoth}},
      Iterations(10, 20), rng);
  ASSERT_TRUE(report.best);
  EXPECT_EQ(report.best->solver, Solver::kE5p1);
  EXPECT_TRUE(near.IsTrue(report.best->pose, 0.1, 0.05));
}

TEST(Ransac, HasNoPoseWithoutSolversOrSolutions) {
  Rng rng = TestRng();
  const NearTruth near = MakeNearTruth(rng, {});
  const auto no_solvers = RunWith(near, {}, Iterations(10, 20), rng);
  EXPECT_FALSE(no_solvers.best);
  EXPECT_EQ(no_solvers.iterations, 0);
  const FixedGenerator degenerate({}, 1);
  const auto no_solutions =
      RunWith(near, {{&degenerate, Solver::kP3p, MatchSets::kBoth}}, Iterations(10, 20), rng);
  EXPECT_FALSE(no_solutions.best);
  EXPECT_EQ(no_solutions.iterations, 20);
}

// Half of the points are inliers, so that a sample of three succeeds in one of eight cases, and 69
// samples are enough. A pose that is a little off has fewer inliers and asks for more.
TEST(Ransac, FindsThePoseByThreePointsInTheExpectedNumberOfSamples) {
  Rng rng = TestRng();
  SyntheticOptions options;
  options.outlier_ratio_2d3d = {0.5, 0.5};
  for (int trial = 0; trial < 10; ++trial) {
    const NearTruth near = MakeNearTruth(rng, options);
    const P3pSampler p3p(near.prepared);
    const PoseScore points(MatchSets::k2D3D, ScoreCombination::kSumMsac,
                           static_cast<int>(near.prepared.matches_2d3d.size()), 0);
    const MatchSets refined = MatchSets::k2D3D;
    const auto run = [&](Rng stream) {
      return RunRansac(near.prepared, points, {{&p3p, Solver::kP3p, refined}}, SolverSchedule::kAll,
                       Iterations(10, 10000), stream);
    };
    const Rng stream(rng.NextBits());
    const auto report = run(stream);
    EXPECT_GE(report.iterations, 60);
    EXPECT_LE(report.iterations, 90);
    ASSERT_TRUE(report.best);
    EXPECT_TRUE(near.IsTrue(report.best->pose, 0.1, 0.05));

    const auto again = run(stream);
    EXPECT_EQ(again.iterations, report.iterations);
    EXPECT_EQ(again.best->pose.rotation, report.best->pose.rotation);
    EXPECT_EQ(again.best->pose.translation, report.best->pose.translation);
  }
}

}  // namespace
}  // namespace raylift
