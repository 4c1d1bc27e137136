#include <algorithm>
#include <cmath>

#include "lifting/room.h"
#include "support/matchers.h"
#include <gtest/gtest.h>

#include "raylift/lifting/consistency_filter.h"
#include "raylift/lifting/lifter.h"

namespace raylift {
namespace {

struct Problem {
  Room room;
  std::vector<Match2D2D> matches;
};

// Places on the walls seen by a query and, with the keypoints' noise, by all references.
Problem MakeProblem(int num_points, double noise_px, Rng& rng) {
  Problem problem{Room(6, rng), {}};
  std::vector<Eigen::Vector2d> pixels;
  for (int i = 0; i < num_points; ++i) {
    pixels.emplace_back(rng.Uniform(0, 640), rng.Uniform(0, 480));
  }
  // The first camera doubles as the query's.
  const auto points = problem.room.walls->Lift(problem.room.references[0], pixels);
  for (size_t i = 0; i < pixels.size(); ++i) {
    for (size_t r = 1; r < problem.room.references.size(); ++r) {
      const PosedImage& reference = problem.room.references[r];
      const auto seen =
          reference.camera.ImgFromCam(reference.cam_from_world * points[i]->point_in_world);
      if (!seen || !reference.camera.Contains(*seen)) continue;
      const Eigen::Vector2d noise(rng.Normal(), rng.Normal());
      problem.matches.push_back({static_cast<int>(r), pixels[i], *seen + noise_px * noise});
    }
  }
  return problem;
}

std::vector<Match2D3D> LiftAll(const Problem& problem, double log_depth_noise, Rng& rng) {
  const DistortedSource source(problem.room.walls,
                               [&](const PosedImage&, const Eigen::Vector2d&, double z) {
                                 return z * std::exp(log_depth_noise * rng.Normal());
                               });
  return Matches2D3D(LiftMatches(source, problem.room.references, problem.matches));
}

FilterResult Filter(const Problem& problem, std::span<const Match2D3D> points,
                    FilterOptions options = {}) {
  options.mode = FilterMode::kAuto;
  return FilterPoints(problem.room.references, problem.matches, points, options);
}

TEST(EstimateTrust, TellsTheNoiseOfKeypointsFromThatOfGeometry) {
  Rng rng = TestRng();
  const Problem problem = MakeProblem(400, 0.8, rng);
  const auto accurate =
      EstimateTrust(problem.room.references, problem.matches, LiftAll(problem, 0, rng));
  const auto noisy =
      EstimateTrust(problem.room.references, problem.matches, LiftAll(problem, 0.1, rng));
  ASSERT_TRUE(accurate && noisy);
  // The noise of both ends of an error adds up to sqrt(2) of a keypoint's, give or take the change
  // of scale between the views.
  EXPECT_NEAR(accurate->noise.keypoints_px, 0.8 * std::sqrt(2), 0.15);
  EXPECT_NEAR(noisy->noise.keypoints_px, accurate->noise.keypoints_px, 0.05);
  EXPECT_LT(accurate->noise.geometry_px, accurate->noise.keypoints_px);
  EXPECT_GT(noisy->noise.geometry_px, 4 * noisy->noise.keypoints_px);
}

TEST(EstimateTrust, ExpectsTheErrorThatADepthHas) {
  Rng rng = TestRng();
  const Problem problem = MakeProblem(400, 0.5, rng);
  const auto truth = LiftAll(problem, 0, rng);
  const auto points = LiftAll(problem, 0.1, rng);
  const auto trust = EstimateTrust(problem.room.references, problem.matches, points);
  ASSERT_TRUE(trust);
  // Of the points that are expected to be good, the depth must be better than of all.
  double squares_of_good = 0, squares_of_all = 0;
  size_t num_good = 0;
  for (size_t i = 0; i < points.size(); ++i) {
    const PosedImage& own = problem.room.references[static_cast<size_t>(*points[i].reference)];
    const Eigen::Vector3d center = own.cam_from_world.OriginInSource();
    const double log_error = std::log((points[i].point_in_world - center).norm() /
                                      (truth[i].point_in_world - center).norm());
    squares_of_all += log_error * log_error;
    if (trust->points[i].expected_error_px <= 1.5 * trust->noise.keypoints_px) {
      squares_of_good += log_error * log_error;
      ++num_good;
    }
  }
  EXPECT_GT(num_good, 30u);
  EXPECT_LT(std::sqrt(squares_of_good / static_cast<double>(num_good)),
            0.25 * std::sqrt(squares_of_all / static_cast<double>(points.size())));
}

TEST(EstimateTrust, ThinnessOfASurfaceSaysNothingOfItsDepth) {
  Rng rng = TestRng();
  const Problem problem = MakeProblem(400, 0.5, rng);
  auto points = LiftAll(problem, 0.1, rng);
  const auto expected = EstimateTrust(problem.room.references, problem.matches, points);
  for (Match2D3D& point : points) point.point_sigma = 1e-6;  // as discs and splats have
  const auto trust = EstimateTrust(problem.room.references, problem.matches, points);
  ASSERT_TRUE(expected && trust);
  for (size_t i = 0; i < points.size(); ++i) {
    EXPECT_EQ(trust->points[i].expected_error_px, expected->points[i].expected_error_px);
  }
}

TEST(EstimateTrust, BelievesALearnedDeviationUnlessTheViewsContradictIt) {
  Rng rng = TestRng();
  const Problem problem = MakeProblem(400, 0.5, rng);
  const auto truth = LiftAll(problem, 0, rng);
  auto points = LiftAll(problem, 0.1, rng);
  const auto by_all = EstimateTrust(problem.room.references, problem.matches, points);
  for (Match2D3D& point : points) point.log_depth_sigma = 1e-3;
  const auto trust = EstimateTrust(problem.room.references, problem.matches, points);
  ASSERT_TRUE(by_all && trust);
  size_t less = 0, same = 0, same_and_wrong = 0;
  for (size_t i = 0; i < points.size(); ++i) {
    const double before = by_all->points[i].expected_error_px;
    const PosedImage& own = problem.room.references[static_cast<size_t>(*points[i].reference)];
    const Eigen::Vector3d center = own.cam_from_world.OriginInSource();
    const double log_error = std::log((points[i].point_in_world - center).norm() /
                                      (truth[i].point_in_world - center).norm());
    if (!by_all->points[i].seen_by_others) {
      EXPECT_LT(trust->points[i].expected_error_px, 0.1 * before);
    } else if (trust->points[i].expected_error_px == before) {
      ++same;
      same_and_wrong += std::abs(log_error) > 2e-3 ? 1 : 0;
    } else {
      ++less;
    }
  }
  EXPECT_GT(same, points.size() / 2);
  EXPECT_GT(static_cast<double>(same_and_wrong), 0.98 * static_cast<double>(same));
  EXPECT_GT(less, 0u);
}

// Of some keypoints all matches but the first are wrong.
TEST(EstimateTrust, AMatchBesideTheEpipolarLineIsNoWitness) {
  Rng rng = TestRng();
  Problem problem = MakeProblem(400, 0.5, rng);
  std::vector<size_t> firsts;
  for (size_t i = 0; i < problem.matches.size() && firsts.size() < 30; ++i) {
    Match2D2D& match = problem.matches[i];
    const bool is_first = i == 0 || match.query_px != problem.matches[i - 1].query_px;
    if (!is_first) {
      match.reference_px += Eigen::Vector2d(40, -40);
    } else if (i + 1 < problem.matches.size() &&
               match.query_px == problem.matches[i + 1].query_px) {
      firsts.push_back(i);
    }
  }
  ASSERT_EQ(firsts.size(), 30u);
  const auto points = LiftAll(problem, 0, rng);
  ASSERT_EQ(points.size(), problem.matches.size());
  const auto trust = EstimateTrust(problem.room.references, problem.matches, points);
  ASSERT_TRUE(trust);
  // The last one may have been left half done. An error of 57 px along a line is within three
  // deviations, 2 px, of it by a chance of 2 %.
  firsts.pop_back();
  size_t seen = 0;
  for (const size_t i : firsts) seen += trust->points[i].seen_by_others ? 1 : 0;
  EXPECT_LE(seen, 4u);
}

TEST(EstimateTrust, NeedsSeveralReferences) {
  Rng rng = TestRng();
  const Problem problem = MakeProblem(3, 0.5, rng);
  EXPECT_FALSE(EstimateTrust(problem.room.references, problem.matches, {}));
}

TEST(AutoFilter, LeavesAccurateGeometryAlone) {
  Rng rng = TestRng();
  Problem problem = MakeProblem(300, 1, rng);
  for (size_t i = 0; i < problem.matches.size(); i += 4) {
    problem.matches[i].reference_px = {rng.Uniform(0, 640), rng.Uniform(0, 480)};
  }
  const auto points = LiftAll(problem, 0.005, rng);
  const FilterResult result = Filter(problem, points);
  EXPECT_EQ(result.counts.consistent, points.size());
  ASSERT_TRUE(result.noise);
}

TEST(AutoFilter, DropsNoisyAndUnseenPointsAndCountsThem) {
  Rng rng = TestRng();
  Problem problem = MakeProblem(400, 0.5, rng);
  problem.matches.push_back({1, {-1, -1}, {100, 100}});  // no other reference sees it
  const auto points = LiftAll(problem, 0.1, rng);
  const FilterResult result = Filter(problem, points);
  EXPECT_FALSE(result.keep.back());
  EXPECT_GT(result.counts.consistent, 30u);
  EXPECT_GT(result.counts.dropped_by_error, points.size() / 2);
  EXPECT_GE(result.counts.dropped_by_views, 1u);
  EXPECT_EQ(result.counts.consistent + result.counts.dropped_by_error +
                result.counts.dropped_by_views + result.counts.dropped_by_ratio,
            points.size());
}

TEST(AutoFilter, KeepsPointsThatAreExpectedWithinOneAndAHalfDeviationsOfKeypoints) {
  Rng rng = TestRng();
  const Problem problem = MakeProblem(400, 0.5, rng);
  const auto points = LiftAll(problem, 0.1, rng);
  const auto trust = EstimateTrust(problem.room.references, problem.matches, points);
  ASSERT_TRUE(trust);
  const FilterResult result = Filter(problem, points);
  size_t slightly_beyond = 0;
  for (size_t i = 0; i < points.size(); ++i) {
    if (trust->points[i].in_doubt) continue;
    const double deviations = trust->points[i].expected_error_px / trust->noise.keypoints_px;
    EXPECT_EQ(result.keep[i], deviations <= 1.5) << deviations;
    slightly_beyond += deviations > 1.5 && deviations < 3 ? 1 : 0;
  }
  EXPECT_GT(slightly_beyond, 5u);
}

TEST(AutoFilter, DropsPointsThatHalfOfTheirViewsContradictHoweverGoodTheOthersFindThem) {
  Rng rng = TestRng();
  Problem problem = MakeProblem(400, 0.5, rng);
  // In three of the five references some keypoints lie elsewhere.
  for (size_t i = 0; i < problem.matches.size(); i += 6) {
    for (Match2D2D& match : problem.matches) {
      const bool same = match.query_px == problem.matches[i].query_px;
      if (same && match.reference > 2) match.reference_px += Eigen::Vector2d(25, 25);
    }
  }
  const auto points = LiftAll(problem, 0.1, rng);
  const auto trust = EstimateTrust(problem.room.references, problem.matches, points);
  ASSERT_TRUE(trust);
  const FilterResult result = Filter(problem, points);
  size_t good_but_in_doubt = 0;
  for (size_t i = 0; i < points.size(); ++i) {
    const PointTrust& point = trust->points[i];
    if (!point.in_doubt) continue;
    EXPECT_FALSE(result.keep[i]);
    good_but_in_doubt += point.expected_error_px <= trust->noise.keypoints_px ? 1 : 0;
  }
  EXPECT_GT(good_but_in_doubt, 5u);
  EXPECT_GE(result.counts.dropped_by_ratio, good_but_in_doubt);
}

TEST(AutoFilter, WhereFewRemainDropsAllOrKeepsTheBest) {
  Rng rng = TestRng();
  const Problem problem = MakeProblem(60, 0.3, rng);
  const auto points = LiftAll(problem, 0.1, rng);
  const size_t more_than_good = 60;
  const FilterResult none = Filter(problem, points, {.min_points = more_than_good});
  EXPECT_EQ(none.counts.consistent, 0u);
  EXPECT_GT(none.counts.dropped_as_too_few, 0u);
  const FilterResult best =
      Filter(problem, points, {.few_points = FewPoints::kKeepBest, .min_points = more_than_good});
  EXPECT_EQ(best.counts.consistent, more_than_good);
  EXPECT_EQ(std::count(best.keep.begin(), best.keep.end(), true),
            static_cast<std::ptrdiff_t>(more_than_good));
}

TEST(PooledNoise, CountsEachView) {
  EXPECT_FALSE(PooledNoise({}));
  const std::vector<MultiViewNoise> queries = {{1, 10, 1}, {1, 2, 99}, {5, 50, 0}};
  const auto pooled = PooledNoise(queries);
  ASSERT_TRUE(pooled);
  EXPECT_EQ(pooled->num_views, 100u);
  EXPECT_DOUBLE_EQ(pooled->keypoints_px, 1);
  EXPECT_NEAR(pooled->geometry_px, std::sqrt(0.01 * 100 + 0.99 * 4), 1e-12);
}

TEST(AutoFilter, WhatTheSceneShowsDecidesWhetherGeometryIsAccurate) {
  Rng rng = TestRng();
  const Problem problem = MakeProblem(400, 0.5, rng);
  const auto points = LiftAll(problem, 0.1, rng);
  const FilterResult result =
      Filter(problem, points, {.multi_view_noise = MultiViewNoise{1, 1, 9999}});
  EXPECT_EQ(result.counts.consistent, points.size());
}

TEST(AutoFilter, WhereViewsAreTooFewTheSceneDecides) {
  Rng rng = TestRng();
  Problem problem = MakeProblem(30, 0.5, rng);
  for (size_t i = 0; i < problem.matches.size(); ++i) {
    problem.matches[i].query_px.x() += static_cast<double>(i);  // none is seen twice
  }
  const auto points = LiftAll(problem, 0.1, rng);
  const MultiViewNoise noisy{1, 5, 1000};
  const auto num_kept = [&](FewPoints few_points, const std::optional<MultiViewNoise>& scene) {
    return Filter(problem, points, {.few_points = few_points, .multi_view_noise = scene})
        .counts.consistent;
  };
  EXPECT_EQ(num_kept(FewPoints::kDropAll, std::nullopt), points.size());
  EXPECT_EQ(num_kept(FewPoints::kDropAll, MultiViewNoise{1, 1, 1000}), points.size());
  EXPECT_EQ(num_kept(FewPoints::kKeepBest, noisy), points.size());
  EXPECT_EQ(num_kept(FewPoints::kDropAll, noisy), 0u);
  // With one reference there is no estimator that could do without.
  for (Match2D2D& match : problem.matches) match.reference = 1;
  EXPECT_EQ(num_kept(FewPoints::kDropAll, noisy), points.size());
}

}  // namespace
}  // namespace raylift
