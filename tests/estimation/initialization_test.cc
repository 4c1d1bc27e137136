#include "estimation/refinement/joint/model.h"
#include "support/coherent_problem.h"
#include "support/matchers.h"

namespace raylift {
namespace {

// The epipolar_clutter of wrong matches by reference, at the true pose.
std::vector<double> EpipolarClutter(const CoherentOptions& options, Rng& rng) {
  const CoherentProblem made = MakeCoherentProblem("crowding", options, rng);
  const NormalizedProblem prepared(made.problem, 8, 2, rng);
  const KeypointEvidence evidence = GatherEvidence(made.problem, prepared);
  const CamFromLocal pose = prepared.ToLocal(made.query_from_world);
  JointModel model(evidence, pose);
  model.noise = InitializeNoise(evidence, pose, options.sigma_px * options.sigma_px);
  model.noise.keypoint_tail = 0;
  InitializeByVoting(model);
  return model.epipolar_clutter;
}

TEST(KeypointConsensus, WrongMatchesOfARowOfWindowsCrowdAtEpipolarLines) {
  Rng rng = TestRng();
  // References beside the query see the next window of its row near the epipolar line; wrong
  // matches elsewhere are anywhere.
  const std::vector<double> rows =
      EpipolarClutter({.num_references = 2, .vertical = 0, .wrong = 0, .repeated = 0.4}, rng);
  const std::vector<double> anywhere =
      EpipolarClutter({.num_references = 2, .vertical = 0, .wrong = 0.4, .repeated = 0}, rng);
  ASSERT_EQ(rows.size(), 2u);
  ASSERT_EQ(anywhere.size(), 2u);
  for (int r = 0; r < 2; ++r) {
    EXPECT_GT(rows[r], 5);
    EXPECT_LT(anywhere[r], 3);
  }
}

TEST(KeypointConsensus, WithoutWrongMatchesNothingCrowds) {
  Rng rng = TestRng();
  for (const double epipolar_clutter : EpipolarClutter({.wrong = 0, .repeated = 0}, rng)) {
    EXPECT_LE(epipolar_clutter, 2);  // as if one had been seen
  }
}

}  // namespace
}  // namespace raylift
