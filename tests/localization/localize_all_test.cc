#include "raylift/localization/localize_all.h"

#include <atomic>
#include <map>

#include "support/coherent_problem.h"
#include "support/matchers.h"

namespace raylift {
namespace {

// Matches that are made up.
class MadeUpMatches : public MatchSource {
 public:
  explicit MadeUpMatches(std::map<std::string, PoseProblem> problems)
      : problems_(std::move(problems)) {}

  bool asked() const { return asked_; }

  QueryMatches Match(const Query& query) const override {
    asked_ = true;
    const PoseProblem& problem = problems_.at(query.name);
    return {problem.references, problem.matches_2d2d};
  }
  std::vector<std::string> Warnings() const override { return {}; }

 private:
  std::map<std::string, PoseProblem> problems_;
  mutable std::atomic<bool> asked_ = false;
};

class SceneNoiseOfWays : public ::testing::Test {
 protected:
  SceneNoiseOfWays() {
    Rng rng = TestRng();
    std::map<std::string, PoseProblem> problems;
    for (const char* name : {"a", "b", "c", "d", "e"}) {
      const CoherentProblem made = MakeCoherentProblem(name, {.num_keypoints = 100}, rng);
      queries_.push_back({name, made.problem.query_camera});
      problems[name] = made.problem;
    }
    matches_ = std::make_shared<MadeUpMatches>(std::move(problems));
  }

  // Points are triangulated.
  Localizer Way(const EstimatorOptions& estimator) const {
    return {scene_,
            matches_,
            {.estimator = estimator, .candidates = {.mode = CandidateMode::kTriangulate}}};
  }
  std::optional<SceneNoise> Learn(const std::vector<Query>& queries, int threads) const {
    LocalizeAll all({Way({.method = Method::kP3p}), Way({})}, queries, matches_, threads);
    all.Calibrate();
    EXPECT_FALSE(all.configuration(0).options().estimator.scene_noise);
    return all.configuration(1).options().estimator.scene_noise;
  }

  std::vector<Query> queries_;
  std::shared_ptr<const Scene> scene_ = std::make_shared<const Scene>();
  std::shared_ptr<const MadeUpMatches> matches_;
};

TEST_F(SceneNoiseOfWays, IsTheSameWhateverTheOrderAndTheThreads) {
  const auto noise = Learn(queries_, 1);
  ASSERT_TRUE(noise);
  EXPECT_GT(noise->keypoint_px.errors, 100);
  // Somewhat less than it is, as points that are triangulated fit the pixels they were made from.
  EXPECT_NEAR(noise->keypoint_px.sigma, 0.6, 0.1);
  EXPECT_EQ(Learn(queries_, 4), noise);
  std::vector<Query> reversed(queries_.rbegin(), queries_.rend());
  EXPECT_EQ(Learn(reversed, 4), noise);
}

TEST_F(SceneNoiseOfWays, NeedsThreeQueries) { EXPECT_FALSE(Learn({queries_[0], queries_[1]}, 1)); }

TEST_F(SceneNoiseOfWays, LeavesAloneWhatIsGiven) {
  SceneNoise given;
  given.depth = {0.01, 7};
  EstimatorOptions knowing;
  knowing.scene_noise = given;
  const EstimatorOptions paper{.refinement = Refinement::kPaper};
  const EstimatorOptions split{.local_optimization = LocalOptimization::kSplit};
  LocalizeAll all({Way(knowing), Way(paper), Way(split)}, queries_, matches_, 1);
  all.Calibrate();
  EXPECT_EQ(all.configuration(0).options().estimator.scene_noise, given);
  EXPECT_FALSE(all.configuration(1).options().estimator.scene_noise);
  EXPECT_FALSE(all.configuration(2).options().estimator.scene_noise);
  EXPECT_FALSE(matches_->asked());
}

}  // namespace
}  // namespace raylift
