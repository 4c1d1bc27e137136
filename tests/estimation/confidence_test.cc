#include "estimation/confidence/confidence.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "geometry/pose_step.h"
#include "support/coherent_problem.h"
#include "support/matchers.h"

#include "raylift/estimation/options.h"
#include "raylift/estimation/pose_estimator.h"
#include "raylift/geometry/residuals.h"

namespace raylift {
namespace {

PoseEstimate Estimate(const PoseProblem& problem, Method method = Method::kAdaptive) {
  EstimatorOptions options;
  options.method = method;
  return MakePoseEstimator(options)->Estimate(problem);
}

// Whether a pose is near `cam_from_world`, for what the scene is far away: 1 % of 20.
bool IsNear(const Rigid3& pose, const Rigid3& cam_from_world) {
  return (pose.OriginInSource() - cam_from_world.OriginInSource()).norm() < 0.2;
}

// Expects that of the pose and its alternatives one is near each of two, as surely as covariances
// and probabilities say.
void ExpectBoth(const PoseEstimate& estimate, const Rigid3& one, const Rigid3& other) {
  ASSERT_TRUE(estimate.cam_from_world);
  const bool has_one = IsNear(*estimate.cam_from_world, one);
  EXPECT_TRUE(has_one || IsNear(*estimate.cam_from_world, other));
  ASSERT_EQ(estimate.alternatives.size(), 1U);
  const AlternativePose& alternative = estimate.alternatives.front();
  EXPECT_NEAR(alternative.probability + estimate.confidence, 1, 0.05);
  const Rigid3& truth = has_one ? other : one;
  EXPECT_TRUE(IsNear(alternative.cam_from_world, truth));
  ASSERT_TRUE(alternative.covariance);
  const Vector6d error = StepBetween(alternative.cam_from_world, truth);
  EXPECT_LT(error.dot(alternative.covariance->inverse() * error), 30);
}

// Each reference pixel, and its point, is given to another query keypoint.
void Shuffle(PoseProblem& problem, Rng& rng) {
  for (size_t i = problem.matches_2d2d.size(); i > 1; --i) {
    const size_t j = rng.UniformIndex(static_cast<uint32_t>(i));
    Match2D2D& a = problem.matches_2d2d[i - 1];
    Match2D2D& b = problem.matches_2d2d[j];
    std::swap(a.query_px, b.query_px);
    std::swap(a.query_keypoint, b.query_keypoint);
    std::swap(problem.matches_2d3d[i - 1].query_px, problem.matches_2d3d[j].query_px);
    std::swap(problem.matches_2d3d[i - 1].query_keypoint, problem.matches_2d3d[j].query_keypoint);
  }
}

// All that each keypoint is matched with is given to the next one: no match is right.
void Rotate(PoseProblem& problem) {
  std::map<int, Eigen::Vector2d> pixels;
  for (const Match2D2D& match : problem.matches_2d2d) {
    pixels.emplace(match.query_keypoint.value(), match.query_px);
  }
  const auto rotate = [&pixels](auto& match) {
    auto next = pixels.upper_bound(*match.query_keypoint);
    if (next == pixels.end()) next = pixels.begin();
    match.query_keypoint = next->first;
    match.query_px = next->second;
  };
  for (Match2D2D& match : problem.matches_2d2d) rotate(match);
  for (Match2D3D& match : problem.matches_2d3d) rotate(match);
}

TEST(Support, RightPosesAreLocalizedAlsoByFewKeypoints) {
  Rng rng = TestRng();
  for (const int keypoints : {20, 40, 300}) {
    for (int i = 0; i < 10; ++i) {
      const CoherentProblem made = MakeCoherentProblem(
          "right", {.num_keypoints = keypoints, .num_references = 4, .wrong = 0.3}, rng);
      for (const Method method : {Method::kP3p, Method::kE5p1, Method::kAdaptive}) {
        const PoseEstimate estimate = Estimate(made.problem, method);
        EXPECT_EQ(estimate.verdict, PoseVerdict::kLocalized)
            << keypoints << " " << ToString(method) << " " << estimate.confidence;
      }
    }
  }
}

TEST(Support, ShuffledMatchesAreNotLocalized) {
  Rng rng = TestRng();
  for (const int keypoints : {10, 30, 100, 300}) {
    for (int i = 0; i < 10; ++i) {
      CoherentProblem made =
          MakeCoherentProblem("shuffled", {.num_keypoints = keypoints, .num_references = 4}, rng);
      Shuffle(made.problem, rng);
      for (const Method method : {Method::kP3p, Method::kE5p1, Method::kAdaptive}) {
        const PoseEstimate estimate = Estimate(made.problem, method);
        // Of few matches enough may be left as they were.
        if (estimate.cam_from_world &&
            IsNearPose(*estimate.cam_from_world, made.query_from_world, 5, 1)) {
          continue;
        }
        EXPECT_NE(estimate.verdict, PoseVerdict::kLocalized)
            << keypoints << " keypoints, " << ToString(method) << ": " << estimate.inlier_keypoints
            << " of " << estimate.num_keypoints << " are inliers";
      }
    }
  }
}

// The points are farther from their references than what they show by the factors of `next`; the
// 2D-2D matches are right.
template <typename Next>
void ScaleDepths(PoseProblem& problem, const Next& next) {
  for (Match2D3D& match : problem.matches_2d3d) {
    const Eigen::Vector3d center =
        problem.references[static_cast<size_t>(*match.reference)].cam_from_world.OriginInSource();
    match.point_in_world = center + next() * (match.point_in_world - center);
  }
}

TEST(Support, PointsOfWhichNoneAgreesMakeAPoseDoubtful) {
  Rng rng = TestRng();
  for (const int keypoints : {40, 300}) {
    for (int i = 0; i < 5; ++i) {
      const CoherentProblem made =
          MakeCoherentProblem("disagree", {.num_keypoints = keypoints, .num_references = 4}, rng);
      PoseProblem wrong = made.problem;
      ScaleDepths(wrong,
                  [&] { return std::exp(rng.Uniform(0.2, 1) * (rng.Uniform() < 0.5 ? 1 : -1)); });
      EXPECT_EQ(Estimate(wrong).verdict, PoseVerdict::kDoubtful) << keypoints;
      // Without the geometry there is nothing that could disagree, and few points say nothing.
      EXPECT_EQ(Estimate(wrong, Method::kE5p1).verdict, PoseVerdict::kLocalized) << keypoints;
      wrong.matches_2d3d.resize(1);
      EXPECT_EQ(Estimate(wrong).verdict, PoseVerdict::kLocalized) << keypoints;
    }
  }
}

// Depth of another scale, as that of single images, is right but for the scale.
TEST(Support, PointsThatAgreeUpToAFactorSpeakForThePose) {
  Rng rng = TestRng();
  int localized = 0;
  for (const double factor : {0.8, 1.5}) {
    for (int i = 0; i < 10; ++i) {
      CoherentProblem made =
          MakeCoherentProblem("scaled", {.num_keypoints = 200, .num_references = 4}, rng);
      ScaleDepths(made.problem, [&] { return factor; });
      const PoseEstimate estimate = Estimate(made.problem);
      if (estimate.verdict != PoseVerdict::kLocalized) continue;
      ++localized;
      EXPECT_TRUE(IsNearPose(*estimate.cam_from_world, made.query_from_world, 1, 0.1)) << factor;
    }
  }
  // Here and there the distance remains in doubt.
  EXPECT_GE(localized, 16);
}

// Matches of the two sets that share no keypoint: three points fit some pose exactly, which proves
// nothing, although no pair is needed for it. Chance reaches a confidence of .95 in one of twenty.
TEST(Support, AFewWrongPointsAndPairsProveNothing) {
  Rng rng = TestRng();
  int tried = 0, localized = 0;
  for (const size_t points : {size_t{3}, size_t{4}}) {
    for (int i = 0; i < 40; ++i) {
      PoseProblem problem =
          MakeCoherentProblem("few", {.num_keypoints = 40, .num_references = 4}, rng).problem;
      problem.matches_2d3d.resize(points);
      problem.matches_2d2d.resize(6);
      int keypoint = 0;
      const auto misplace = [&](auto& match) {
        match.query_px = {rng.Uniform(0, problem.query_camera.width_px()),
                          rng.Uniform(0, problem.query_camera.height_px())};
        match.query_keypoint = keypoint++;
      };
      for (Match2D3D& match : problem.matches_2d3d) {
        misplace(match);
        match.match_2d2d.reset();
      }
      for (Match2D2D& match : problem.matches_2d2d) misplace(match);
      for (const Method method : {Method::kAdaptive, Method::kHybridRansac}) {
        ++tried;
        localized += Estimate(problem, method).verdict == PoseVerdict::kLocalized ? 1 : 0;
      }
    }
  }
  EXPECT_LE(localized, 0.05 * tried);
}

TEST(Support, InliersOfUncertainPointsProveLittle) {
  // Each point may be anywhere in the image: all are inliers, of any pose.
  Rng rng = TestRng();
  CoherentProblem made = MakeCoherentProblem("uncertain", {}, rng);
  Rotate(made.problem);
  const MatchSets points = MatchSets::k2D3D;
  const auto log_false_alarms = [&](double point_sigma) {
    const NormalizedProblem prepared(made.problem, 8, 2, rng, point_sigma);
    const InlierEvidence evidence = InlierAssessor(made.problem, prepared, points, 100)
                                        .Assess(prepared.ToLocal(made.query_from_world));
    EXPECT_EQ(evidence.inlier_keypoints > 200, point_sigma > 1);
    return evidence.log_false_alarms;
  };
  EXPECT_GT(log_false_alarms(20), 0);
  EXPECT_GT(log_false_alarms(0), 0);
}

TEST(Support, AnUncertainPointBesideTheCameraLeavesTheOthersTheirWorth) {
  // It is an inlier wherever its keypoint is; they are not.
  Rng rng = TestRng();
  CoherentProblem made = MakeCoherentProblem("beside", {}, rng);
  Match2D3D beside = made.problem.matches_2d3d.front();
  const auto ray = made.problem.query_camera.RayInCam(beside.query_px);
  beside.point_in_world = made.query_from_world.Inverse() * Eigen::Vector3d(1e-3 * *ray);
  made.problem.matches_2d3d.push_back(beside);
  const NormalizedProblem prepared(made.problem, 8, 2, rng, 0.05);
  EXPECT_LT(InlierAssessor(made.problem, prepared, MatchSets::k2D3D, 100)
                .Assess(prepared.ToLocal(made.query_from_world))
                .log_false_alarms,
            -50);
}

TEST(Support, PairsOfOneReferenceDoNotTellTheDistance) {
  Rng rng = TestRng();
  for (int i = 0; i < 5; ++i) {
    CoherentProblem made =
        MakeCoherentProblem("distance", {.num_references = 2, .vertical = 0.5}, rng);
    PoseProblem& problem = made.problem;
    problem.matches_2d3d.clear();
    const auto estimator = MakePoseEstimator({.method = Method::kE5p1});
    EXPECT_EQ(estimator->Estimate(problem).verdict, PoseVerdict::kLocalized);
    // Of the second reference eight wrong pairs are left.
    std::vector<Match2D2D> left;
    int of_second = 0;
    for (Match2D2D match : problem.matches_2d2d) {
      if (match.reference == 1) {
        if (++of_second > 8) continue;
        match.reference_px = {rng.Uniform(0, 1600), rng.Uniform(0, 1200)};
      }
      left.push_back(match);
    }
    problem.matches_2d2d = left;
    const PoseEstimate estimate = estimator->Estimate(problem);
    ASSERT_TRUE(estimate.cam_from_world);
    EXPECT_EQ(estimate.verdict, PoseVerdict::kDoubtful);
  }
}

TEST(Support, PairsWithoutParallaxDoNotTellThePosition) {
  // References 2 mm from the query, 20 m before the facade: a tenth of a pixel of parallax.
  Rng rng = TestRng();
  for (int i = 0; i < 5; ++i) {
    const CoherentProblem made =
        MakeCoherentProblem("without parallax", {.baseline = 0.002, .wrong = 0.1}, rng);
    const PoseEstimate by_2d2d = Estimate(made.problem, Method::kE5p1);
    ASSERT_TRUE(by_2d2d.cam_from_world);
    EXPECT_LT(AngleBetweenDeg(by_2d2d.cam_from_world->rotation, made.query_from_world.rotation),
              0.1);
    EXPECT_EQ(by_2d2d.verdict, PoseVerdict::kDoubtful) << by_2d2d.position_sigma;
    EXPECT_EQ(Estimate(made.problem, Method::kP3p).verdict, PoseVerdict::kLocalized);
  }
}

TEST(Support, CountsAKeypointOnce) {
  Rng rng = TestRng();
  const CoherentProblem made = MakeCoherentProblem("once", {}, rng);
  const NormalizedProblem prepared(made.problem, 8, 2, rng);
  const InlierAssessor assessor(made.problem, prepared, MatchSets::kBoth, 100);
  const InlierEvidence evidence = assessor.Assess(prepared.ToLocal(made.query_from_world));
  EXPECT_LE(evidence.keypoints, 300);
  EXPECT_GT(evidence.keypoints, 290);
  EXPECT_GT(evidence.inlier_keypoints, 0.9 * evidence.keypoints);
  EXPECT_LT(evidence.log_false_alarms, -50);
}

TEST(Support, KeypointsInOnePlaceCountAsFewer) {
  // Twelve matches all over the image, or all within a few pixels.
  const auto support_of = [](double spread) {
    Rng rng = TestRng();
    CoherentProblem made = MakeCoherentProblem("place", {.num_keypoints = 12, .wrong = 0}, rng);
    for (Match2D2D& match : made.problem.matches_2d2d) {
      match.query_px =
          Eigen::Vector2d(830, 630) + spread * (match.query_px - Eigen::Vector2d(830, 630));
    }
    for (Match2D3D& match : made.problem.matches_2d3d) {
      match.query_px =
          Eigen::Vector2d(830, 630) + spread * (match.query_px - Eigen::Vector2d(830, 630));
      // The point moves with its pixel.
      const Rigid3& pose = made.query_from_world;
      const Eigen::Vector3d p = pose * match.point_in_world;
      const Eigen::Vector2d middle(0.02, 0.02);  // of the same place, as a ray
      Eigen::Vector3d ray;
      ray << middle + spread * (p.head<2>() / p.z() - middle), 1;
      match.point_in_world = pose.Inverse() * Eigen::Vector3d(p.z() * ray);
    }
    const NormalizedProblem prepared(made.problem, 8, 2, rng);
    const MatchSets points = MatchSets::k2D3D;
    return InlierAssessor(made.problem, prepared, points, 100)
        .Assess(prepared.ToLocal(made.query_from_world));
  };
  const InlierEvidence wide = support_of(1);
  const InlierEvidence narrow = support_of(0.01);
  EXPECT_EQ(wide.inlier_keypoints, narrow.inlier_keypoints);
  EXPECT_LT(wide.log_false_alarms, -10);
  EXPECT_GT(narrow.log_false_alarms, -2);  // one pose in eight or more
}

TEST(ProbabilityOverAlternative, FollowsFromWhatOnlyOneOfThemExplains) {
  EXPECT_DOUBLE_EQ(ProbabilityOverAlternative({2, 2}, 1, false), 0.5);
  EXPECT_GT(ProbabilityOverAlternative({2, 0}, 1, false), 0.9);
  EXPECT_LT(ProbabilityOverAlternative({0, 2}, 1, false), 0.1);
  EXPECT_DOUBLE_EQ(ProbabilityOverAlternative({0, 0}, 1, false), 1);
}

TEST(ProbabilityOverAlternative, TakesWhatAgreesBeyondChanceForTwoWitnesses) {
  EXPECT_GT(ProbabilityOverAlternative({300, 75}, 1, false), 0.9999);
  EXPECT_DOUBLE_EQ(ProbabilityOverAlternative({300, 75}, 1, true), 16.0 / 17);
  EXPECT_LT(ProbabilityOverAlternative({75, 300}, 1, true), 0.0001);
}

// 40 and 60 % of the keypoints show two places; which of them is right is as likely in each case.
TEST(ProbabilityOverAlternative, DoesNotTakeTheLargerOfTwoPlacesForTheRightOne) {
  EXPECT_DOUBLE_EQ(ProbabilityOverAlternative({180, 120}, 1, true), 0.5);
  EXPECT_DOUBLE_EQ(ProbabilityOverAlternative({120, 180}, 1, true), 0.5);
}

// One of so many references, and its points, are of another place that looks the same.
void MoveEachOf(int references, const Rigid3& other_from_world, PoseProblem& problem) {
  for (size_t r = 0; r < problem.references.size(); r += static_cast<size_t>(references)) {
    PosedImage& reference = problem.references[r];
    reference.cam_from_world = reference.cam_from_world * other_from_world.Inverse();
  }
  for (Match2D3D& match : problem.matches_2d3d) {
    if (problem.matches_2d2d[*match.match_2d2d].reference % references != 0) continue;
    match.point_in_world = other_from_world * match.point_in_world;
  }
}

// Half of the references are of another place that looks the same: each keypoint is explained by
// either pose, but by other matches.
TEST(Support, PosesThatExplainTheSameKeypointsByOtherMatchesAreTwoAnswers) {
  Rng rng = TestRng();
  CoherentProblem made = MakeCoherentProblem("look-alike", {.wrong = 0.1}, rng);
  PoseProblem& problem = made.problem;
  const Rigid3 other_from_world(
      Eigen::Quaterniond(Eigen::AngleAxisd(0.05, Eigen::Vector3d::UnitY())),
      Eigen::Vector3d(2, 0.5, 1));
  MoveEachOf(2, other_from_world, problem);
  const PoseEstimate estimate = Estimate(problem);
  EXPECT_NE(estimate.verdict, PoseVerdict::kLocalized);
  ExpectBoth(estimate, made.query_from_world, made.query_from_world * other_from_world.Inverse());

  const NormalizedProblem prepared(problem, 8, 2, rng);
  const InlierAssessor assessor(problem, prepared, MatchSets::kBoth, 100);
  const auto evidence = [&](const Rigid3& pose) { return assessor.Assess(prepared.ToLocal(pose)); };
  const InlierEvidence first = evidence(made.query_from_world);
  const InlierEvidence second = evidence(made.query_from_world * other_from_world.Inverse());
  EXPECT_GT(first.inlier_keypoints, 0.8 * first.keypoints);
  EXPECT_GT(second.inlier_keypoints, 0.8 * second.keypoints);
  EXPECT_TRUE(assessor.Compare(first, second));
  EXPECT_FALSE(assessor.Compare(first, first));
}

// Of a place that looks alike, and where no reference sees the other, three times as many references
// were retrieved: that says nothing. Where these see the place of the others as well, they contradict
// it, and outvote it.
TEST(Support, ReferencesOfALookAlikePlaceDoNotOutvoteThose) {
  Rng rng = TestRng();
  for (const double distance : {40.0, 0.5}) {
    CoherentProblem made = MakeCoherentProblem("look-alike", {.wrong = 0.1}, rng);
    PoseProblem& problem = made.problem;
    const Rigid3 other_from_world(Eigen::Quaterniond::Identity(), Eigen::Vector3d(distance, 0, 0));
    MoveEachOf(4, other_from_world, problem);
    const PoseEstimate estimate = Estimate(problem);
    if (distance < 1) {
      EXPECT_EQ(estimate.verdict, PoseVerdict::kLocalized) << estimate.confidence;
    } else {
      const Rigid3 in_other = made.query_from_world * other_from_world.Inverse();
      EXPECT_NEAR(estimate.confidence, 0.5, 1e-6);
      ExpectBoth(estimate, made.query_from_world, in_other);
      problem.priors.position = {.position = in_other.OriginInSource() + Eigen::Vector3d(3, 0, 0),
                                 .sigma = Eigen::Vector3d::Constant(4)};
      const PoseEstimate by_prior = Estimate(problem);
      EXPECT_EQ(by_prior.verdict, PoseVerdict::kLocalized) << by_prior.confidence;
      ASSERT_TRUE(by_prior.cam_from_world);
      EXPECT_TRUE(IsNear(*by_prior.cam_from_world, in_other));
    }
  }
}

// A place that shows half of what the photograph does, though its references see where the other half
// would be, is another one.
TEST(Support, APlaceThatIsAlikeInHalfIsNoSuchPlace) {
  Rng rng = TestRng();
  CoherentProblem made = MakeCoherentProblem("half", {.wrong = 0}, rng);
  PoseProblem& problem = made.problem;
  MoveEachOf(3, Rigid3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(40, 0, 0)), problem);
  std::erase_if(problem.matches_2d3d, [&](const Match2D3D& match) {
    const Match2D2D& pair = problem.matches_2d2d[*match.match_2d2d];
    return pair.reference % 3 == 0 && match.query_px.x() > 900;
  });
  for (Match2D3D& match : problem.matches_2d3d) {
    match.reference = problem.matches_2d2d[*match.match_2d2d].reference;
    match.match_2d2d.reset();
  }
  problem.matches_2d2d.clear();
  const PoseEstimate estimate = Estimate(problem, Method::kP3p);
  EXPECT_EQ(estimate.verdict, PoseVerdict::kLocalized) << estimate.confidence;
}

// One reference shows what the query does, but its depths are useless; the others have a handful of
// matches, all wrong. Whatever distance they suggest is chance's.
TEST(Support, AChanceMatchOfAnotherReferenceDoesNotTellTheDistance) {
  Rng rng = TestRng();
  for (int i = 0; i < 5; ++i) {
    CoherentProblem made =
        MakeCoherentProblem("chance", {.num_references = 4, .vertical = 0.5}, rng);
    PoseProblem& problem = made.problem;
    PoseProblem few = problem;
    few.matches_2d2d.clear();
    few.matches_2d3d.clear();
    std::vector<int> of_reference(problem.references.size(), 0);
    for (size_t k = 0; k < problem.matches_2d2d.size(); ++k) {
      Match2D2D match = problem.matches_2d2d[k];
      Match2D3D point = problem.matches_2d3d[k];
      if (match.reference > 0) {
        if (++of_reference[static_cast<size_t>(match.reference)] > 6) continue;
        match.reference_px = {rng.Uniform(0, 1600), rng.Uniform(0, 1200)};
      }
      const Eigen::Vector3d center =
          problem.references[static_cast<size_t>(match.reference)].cam_from_world.OriginInSource();
      point.point_in_world = center + rng.Uniform(0.5, 1.5) * (point.point_in_world - center);
      few.matches_2d2d.push_back(match);
      if (match.reference > 0) continue;
      point.match_2d2d = few.matches_2d2d.size() - 1;
      few.matches_2d3d.push_back(point);
    }
    const PoseEstimate estimate = Estimate(few);
    EXPECT_EQ(estimate.verdict, PoseVerdict::kDoubtful);
    // Few distances are within 1.25 % of the right one by luck.
    EXPECT_LT(estimate.confidence, 0.25);
  }
}

// Four photographs of a burst, a centimeter apart, whose depths come from single images: they have
// one wrong scale in common, and are no more witnesses of the distance than one of them is.
TEST(Support, DepthsOfABurstAreOneWitness) {
  Rng rng = TestRng();
  for (int i = 0; i < 10; ++i) {
    PoseProblem problem =
        MakeCoherentProblem("burst", {.num_references = 1, .seen = 0.9, .wrong = 0}, rng).problem;
    const double factor = std::exp(0.08 * rng.Normal());
    const std::vector<Match2D3D> points = std::exchange(problem.matches_2d3d, {});
    const std::vector<Match2D2D> pairs = std::exchange(problem.matches_2d2d, {});
    const PosedImage first = problem.references[0];
    problem.references.assign(4, first);
    std::vector<double> factors;  // of the keypoints' depths
    for (size_t k = 0; k < points.size(); ++k) {
      factors.push_back(factor * std::exp(0.03 * rng.Normal()));
    }
    for (int r = 0; r < 4; ++r) {
      PosedImage& reference = problem.references[static_cast<size_t>(r)];
      reference.cam_from_world.translation +=
          0.01 * Eigen::Vector3d(rng.Normal(), rng.Normal(), rng.Normal());
      const Eigen::Vector3d center = reference.cam_from_world.OriginInSource();
      for (size_t k = 0; k < points.size(); ++k) {
        const Eigen::Vector3d& at = points[k].point_in_world;
        Match2D2D pair = pairs[*points[k].match_2d2d];
        pair.reference = r;
        pair.reference_px = *reference.camera.ImgFromCam(reference.cam_from_world * at);
        Match2D3D point = points[k];
        point.reference = r;
        point.point_in_world = center + factors[k] * (at - center);
        point.match_2d2d = problem.matches_2d2d.size();
        problem.matches_2d2d.push_back(pair);
        problem.matches_2d3d.push_back(point);
      }
    }
    EXPECT_EQ(Estimate(problem).verdict, PoseVerdict::kDoubtful);
  }
}

// The inliers are all keypoints of a small part of the photograph; nothing else in it fits.
TEST(Support, InliersOnOnePatchAreOneWitness) {
  Rng rng = TestRng();
  for (const bool on_patch : {true, false}) {
    CoherentProblem made = MakeCoherentProblem("patch", {.wrong = 0}, rng);
    PoseProblem& problem = made.problem;
    problem.matches_2d2d.clear();
    for (Match2D3D& match : problem.matches_2d3d) {
      match.match_2d2d.reset();
      const bool is_right = on_patch ? (match.query_px - Eigen::Vector2d(800, 600)).norm() < 250
                                     : match.query_keypoint.value() % 8 == 0;
      if (is_right) continue;
      match.point_in_world += Eigen::Vector3d(rng.Uniform(-5, 5), rng.Uniform(-5, 5), 0);
    }
    const PoseEstimate estimate = Estimate(problem, Method::kP3p);
    EXPECT_EQ(estimate.verdict, on_patch ? PoseVerdict::kDoubtful : PoseVerdict::kLocalized)
        << estimate.inlier_keypoints << " of " << estimate.num_keypoints;
  }
}

TEST(ProbabilityOfDistance, IsSureWhereOtherReferencesAgree) {
  Rng rng = TestRng();
  const CoherentProblem made =
      MakeCoherentProblem("distance", {.num_references = 4, .vertical = 0.5}, rng);
  const NormalizedProblem prepared(made.problem, 8, 2, rng);
  const CamFromLocal right = prepared.ToLocal(made.query_from_world);
  const double distance = SceneDistance(prepared, right, MatchSets::kBoth);
  EXPECT_NEAR(distance * prepared.scale, 20, 4);
  const InlierEvidence evidence = {.chance = 0.02};
  EXPECT_GT(ProbabilityOfDistance(prepared, right, MatchSets::kBoth, distance,
                                  {.depth_sigma = 0.001}, evidence),
            0.999);
  EXPECT_GT(ProbabilityOfDistance(prepared, right, MatchSets::k2D2D, distance, {}, evidence),
            0.999);
}

// The depths of both references are too small by a fifth: a place between what they say and what
// the pixels say is doubted, however many matches it explains.
TEST(ProbabilityOfDistance, DoubtsWhatPixelsContradict) {
  Rng rng = TestRng();
  for (int i = 0; i < 20; ++i) {
    CoherentProblem made =
        MakeCoherentProblem("too small", {.num_references = 2, .vertical = 0.04, .seen = 0.9}, rng);
    for (Match2D3D& point : made.problem.matches_2d3d) {
      const Match2D2D& pair = made.problem.matches_2d2d[point.match_2d2d.value()];
      const Eigen::Vector3d center = made.problem.references[static_cast<size_t>(pair.reference)]
                                         .cam_from_world.OriginInSource();
      point.point_in_world = center + 0.8 * (point.point_in_world - center);
    }
    const NormalizedProblem prepared(made.problem, 4, 2, rng);
    const Eigen::Vector3d center = made.query_from_world.OriginInSource();
    const Eigen::Vector3d reference = made.problem.references[0].cam_from_world.OriginInSource();
    for (const double share : {0.0, 0.15, 0.2}) {
      const Eigen::Vector3d moved = center + share * (reference - center);
      const Rigid3 pose(made.query_from_world.rotation, -(made.query_from_world.rotation * moved));
      const double p = ProbabilityOfDistance(prepared, prepared.ToLocal(pose), MatchSets::kBoth,
                                             20 / prepared.scale, {}, {.chance = 0.02});
      // A right position is within a quarter of a meter at twenty.
      if (share == 0) {
        EXPECT_GT(p, 0.95);
      } else if ((moved - center).norm() > 0.3) {
        EXPECT_LT(p, 0.6);
      }
    }
  }
}

// Pairs with one reference fit at any distance: no other match is no witness.
TEST(ProbabilityOfDistance, IsNoneByThePairsOfOneReference) {
  Rng rng = TestRng();
  const CoherentProblem made = MakeCoherentProblem("alone", {.num_references = 1}, rng);
  const NormalizedProblem prepared(made.problem, 8, 2, rng);
  EXPECT_LT(ProbabilityOfDistance(prepared, prepared.ToLocal(made.query_from_world),
                                  MatchSets::k2D2D, 20 / prepared.scale, {}, {.chance = 0.02}),
            0.01);
}

// Wrong matches with the dominant reference say nothing of the distance from it.
TEST(ProbabilityOfDistance, IsNotMovedByWrongMatchesOfTheDominantReference) {
  Rng rng = TestRng();
  for (int i = 0; i < 5; ++i) {
    const CoherentProblem made =
        MakeCoherentProblem("outliers", {.num_references = 3, .vertical = 0.5, .wrong = 0.6}, rng);
    EXPECT_EQ(Estimate(made.problem, Method::kE5p1).verdict, PoseVerdict::kLocalized);
    EXPECT_EQ(Estimate(made.problem).verdict, PoseVerdict::kLocalized);

    // Of the other references seven matches that fit are left, and as many that do not.
    const Rigid3 pose = made.query_from_world;
    const NormalizedProblem all(made.problem, 8, 2, rng);
    const Residuals residuals = ComputeResiduals(all, all.ToLocal(pose));
    PoseProblem few = made.problem, without_wrong;
    few.matches_2d2d.clear();
    few.matches_2d3d.clear();
    without_wrong = few;
    int right = 0, wrong = 0;
    for (size_t k = 0; k < all.matches_2d2d.size(); ++k) {
      const bool fits = residuals.of_2d2d[k] < 1;
      const bool of_dominant = all.matches_2d2d[k].reference == 0;
      if (!of_dominant && ++(fits ? right : wrong) > 7) continue;
      const Match2D2D& match =
          made.problem.matches_2d2d[static_cast<size_t>(all.matches_2d2d[k].match)];
      few.matches_2d2d.push_back(match);
      if (fits || !of_dominant) without_wrong.matches_2d2d.push_back(match);
    }
    const auto probability = [&](const PoseProblem& problem) {
      const NormalizedProblem prepared(problem, 8, 2, rng);
      return ProbabilityOfDistance(prepared, prepared.ToLocal(pose), MatchSets::k2D2D,
                                   20 / prepared.scale, {}, {.chance = 0.1});
    };
    EXPECT_GT(few.matches_2d2d.size(), without_wrong.matches_2d2d.size() + 50);
    EXPECT_DOUBLE_EQ(probability(few), probability(without_wrong));
    EXPECT_GT(probability(few), 0.9);
    EXPECT_LT(probability(few), 0.9999);
  }
}

// References that err as wholes by far more than the thresholds: no pose is sure, and counts are of
// the pose that is returned: of RANSAC's, too, where it is taken after the refined one was
// described.
TEST(Support, ReferencesThatErrLeaveThePoseInDoubt) {
  Rng rng = TestRng();
  EstimatorOptions options;
  options.reprojection_threshold_px = 4;
  options.sampson_threshold_px = 2;
  const auto estimator = MakePoseEstimator(options);
  int by_ransac = 0;
  for (int i = 0; i < 12; ++i) {
    const CoherentProblem made =
        MakeCoherentProblem("references err", {.reference_deg = 1, .reference_position = 0.5}, rng);
    const PoseEstimate estimate = estimator->Estimate(made.problem);
    EXPECT_NE(estimate.verdict, PoseVerdict::kLocalized);
    EXPECT_EQ(estimate.score_2d3d.num_inliers,
              std::count(estimate.inliers_2d3d.begin(), estimate.inliers_2d3d.end(), true));
    EXPECT_EQ(estimate.score_2d2d.num_inliers,
              std::count(estimate.inliers_2d2d.begin(), estimate.inliers_2d2d.end(), true));
    by_ransac += estimate.cam_from_world && !estimate.noise ? 1 : 0;
  }
  EXPECT_GT(by_ransac, 3);
}

// Without a standard deviation nothing tells where the camera is.
TEST(ProbabilityOfPosition, ComparesTheErrorWithTheSceneDistance) {
  EXPECT_EQ(ProbabilityOfPosition(0, 20), 0.5);
  EXPECT_GT(ProbabilityOfPosition(0.1, 20), 0.98);
  EXPECT_LT(ProbabilityOfPosition(0.5, 20), 0.5);
}

// Three quarters of the keypoints are taken for those of the same thing elsewhere, in all
// references: neither the place that most of them show nor the other one is sure. Where a quarter
// is wrong at random, the pose is.
TEST(Support, WhatTheSceneHoldsTwiceIsDoubtful) {
  Rng rng = TestRng();
  for (const bool twice : {true, false}) {
    CoherentProblem made = MakeCoherentProblem("twice", {.wrong = 0}, rng);
    PoseProblem& problem = made.problem;
    problem.matches_2d2d.clear();
    for (Match2D3D& match : problem.matches_2d3d) {
      match.match_2d2d.reset();
      const bool of_most = match.query_keypoint.value() % 4 != 0;
      if (twice && of_most) match.point_in_world += Eigen::Vector3d(3, 0.5, 0);
      if (!twice && !of_most) {
        match.point_in_world += Eigen::Vector3d(rng.Uniform(-5, 5), rng.Uniform(-5, 5), 0);
      }
    }
    for (const Method method : {Method::kP3p, Method::kAdaptive}) {
      const PoseEstimate estimate = Estimate(problem, method);
      ASSERT_TRUE(estimate.cam_from_world);
      EXPECT_EQ(estimate.verdict, twice ? PoseVerdict::kDoubtful : PoseVerdict::kLocalized)
          << ToString(method) << ", confidence " << estimate.confidence;
      if (twice) {
        const Rigid3 moved{Eigen::Quaterniond::Identity(), Eigen::Vector3d(-3, -0.5, 0)};
        ExpectBoth(estimate, made.query_from_world, made.query_from_world * moved);
      } else {
        EXPECT_TRUE(estimate.alternatives.empty());
      }
    }
  }
}

// A focal length that is found with the pose leaves open how far away all is, for either pose.
TEST(Support, AlternativesKnowNoMoreOfTheLensThanThePose) {
  Rng rng = TestRng();
  CoherentProblem made = MakeCoherentProblem("twice", {.wrong = 0}, rng);
  made.problem.matches_2d2d.clear();
  for (Match2D3D& match : made.problem.matches_2d3d) {
    match.match_2d2d.reset();
    if (match.query_keypoint.value() % 2 == 0) match.point_in_world.x() += 3;
  }
  const auto variances = [&](double focal_range) {
    made.problem.priors.focal_range = focal_range;
    const PoseEstimate estimate = Estimate(made.problem);
    const auto of_position = [](const std::optional<Matrix6d>& covariance) {
      return covariance ? covariance->bottomRightCorner<3, 3>().trace() : 0;
    };
    EXPECT_EQ(estimate.alternatives.size(), 1U);
    return std::pair(of_position(estimate.covariance),
                     of_position(estimate.alternatives.front().covariance));
  };
  const auto [known, other_known] = variances(1);
  const auto [found, other_found] = variances(1.2);
  EXPECT_GT(other_known, 0);
  EXPECT_GT(found, 2 * known);
  EXPECT_GT(other_found, 2 * other_known);
}

// Each of three poses, which a third of the keypoints each speaks for, is right in one case of three.
TEST(Support, OfThreePosesThatExplainAsMuchEachHasAThird) {
  Rng rng = TestRng();
  CoherentProblem made = MakeCoherentProblem("thrice", {.wrong = 0}, rng);
  made.problem.matches_2d2d.clear();
  const Eigen::Vector3d apart(3, 0.5, 0);
  for (Match2D3D& match : made.problem.matches_2d3d) {
    match.match_2d2d.reset();
    match.point_in_world += match.query_keypoint.value() % 3 * apart;
  }
  const PoseEstimate estimate = Estimate(made.problem);
  ASSERT_TRUE(estimate.cam_from_world);
  EXPECT_NEAR(estimate.confidence, 1.0 / 3, 0.02);
  ASSERT_EQ(estimate.alternatives.size(), 2U);
  std::vector<Rigid3> poses = {*estimate.cam_from_world};
  for (const AlternativePose& alternative : estimate.alternatives) {
    EXPECT_NEAR(alternative.probability, 1.0 / 3, 0.02);
    poses.push_back(alternative.cam_from_world);
  }
  for (int k = 0; k < 3; ++k) {
    const Rigid3 moved{Eigen::Quaterniond::Identity(), -k * apart};
    const auto is_there = [&](const Rigid3& pose) {
      return IsNear(pose, made.query_from_world * moved);
    };
    EXPECT_EQ(std::count_if(poses.begin(), poses.end(), is_there), 1) << k;
  }
}

}  // namespace
}  // namespace raylift
