#include "raylift/localization/localizer.h"

#include "support/matchers.h"
#include "support/room_scene.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/lifting/geometry_spec.h"

namespace raylift {
namespace {

// Gives the same matches to every query.
class GivenMatches final : public MatchSource {
 public:
  explicit GivenMatches(QueryMatches matches) : matches_(std::move(matches)) {}
  QueryMatches Match(const Query&) const override { return matches_; }
  std::vector<std::string> Warnings() const override { return {}; }

 private:
  QueryMatches matches_;
};

class Localizer : public ::testing::Test {
 protected:
  QueryResult Run(const MatchSource& source, Method method = Method::kAdaptive,
                  const FilterOptions& filter = {}, const CandidateOptions& candidates = {}) const {
    EstimatorOptions options;
    options.method = method;
    const auto estimator = MakePoseEstimator(options);
    std::vector<const GeometrySource*> geometry;
    if (method != Method::kE5p1) geometry.push_back(geometry_.source.get());
    return LocalizeQuery({scene_.queries[0].name, scene_.queries[0].camera},
                         {.match_source = source,
                          .covisibility = covisibility_,
                          .geometry = geometry,
                          .filter = filter,
                          .candidates = candidates,
                          .estimator = *estimator});
  }

  std::unique_ptr<MatchSource> HlocSource() const {
    return OpenHlocMatches({scene_.features(), scene_.matches(), scene_.pairs()},
                           LoadReferences(scene_.model(), 1).references, 10);
  }
  QueryMatches AllMatches() const {
    return HlocSource()->Match({scene_.queries[0].name, scene_.queries[0].camera});
  }

  RoomScene scene_ = WriteRoomScene(TestFolder());
  Covisibility covisibility_;
  NamedGeometry geometry_ = MakeGeometrySource("mesh:" + scene_.mesh().string());
};

TEST_F(Localizer, CountsEveryStage) {
  const auto source = HlocSource();
  const QueryResult result = Run(*source);
  const StageCounts& counts = result.localized.counts;
  EXPECT_TRUE(result.localized.localized()) << result.localized.reason;
  EXPECT_EQ(counts.retrieved, 6u);
  EXPECT_EQ(counts.matched, AllMatches().matches.size());
  // All points lie on the closed mesh and all matches are right.
  EXPECT_EQ(counts.hit, counts.matched);
  EXPECT_EQ(counts.points_of_source, std::vector<size_t>{counts.matched});
  EXPECT_EQ(counts.filter.consistent, counts.matched);
  EXPECT_EQ(counts.inliers_2d3d, counts.matched);
  EXPECT_EQ(counts.inliers_2d2d, counts.matched);
  EXPECT_EQ(result.problem.matches_2d2d.size(), counts.matched);
  EXPECT_EQ(result.problem.matches_2d3d.size(), counts.matched);
  EXPECT_TRUE(IsNearPose(*result.localized.estimate.cam_from_world,
                         scene_.queries[0].cam_from_world, 1e-3, 1e-4));
}

TEST_F(Localizer, MatchesBeyondTheMeshAreNotHits) {
  QueryMatches matches = AllMatches();
  const size_t right = matches.matches.size();
  // The room is closed: only a camera outside that looks away sees nothing.
  PosedImage outside = matches.references[0];
  outside.cam_from_world.translation = outside.cam_from_world.rotation * Eigen::Vector3d(0, 0, -50);
  matches.references.push_back(outside);
  for (int i = 0; i < 7; ++i) {
    matches.matches.push_back({6, {100.0 + i, 100}, {160, 120.0 + i}});
  }
  const StageCounts counts = Run(GivenMatches(matches)).localized.counts;
  EXPECT_EQ(counts.matched, right + 7);
  EXPECT_EQ(counts.hit, right);
}

TEST_F(Localizer, TheFilterDropsWhatReferencesDisagreeOn) {
  QueryMatches matches = AllMatches();
  const size_t right = matches.matches.size();
  for (int i = 0; i < 20; ++i) {
    matches.matches.push_back({0, {10.0 + 10 * i, 33.25}, {300.0 - 10 * i, 200}});
  }
  const FilterOptions filter{FilterMode::kFixed, {}};
  const QueryResult result = Run(GivenMatches(matches), Method::kP3p, filter);
  const StageCounts& counts = result.localized.counts;
  EXPECT_EQ(counts.hit, right + 20);
  EXPECT_LE(counts.filter.consistent, right);
  EXPECT_EQ(
      counts.filter.consistent + counts.filter.dropped_by_views + counts.filter.dropped_by_ratio,
      counts.hit);
  EXPECT_EQ(result.problem.matches_2d3d.size(), counts.filter.consistent);
  EXPECT_TRUE(result.localized.localized());
}

TEST_F(Localizer, MergesWhatTheFilterKeepsAndTriangulatesWithoutGeometry) {
  const auto source = HlocSource();
  const FilterOptions filter{FilterMode::kFixed, {}};
  const auto run = [&](CandidateMode mode) {
    QueryResult result = Run(*source, Method::kP3p, filter, {.mode = mode});
    EXPECT_TRUE(IsNearPose(*result.localized.estimate.cam_from_world,
                           scene_.queries[0].cam_from_world, 1e-3, 1e-4));
    EXPECT_EQ(result.localized.counts.points, result.problem.matches_2d3d.size());
    return result.localized.counts;
  };
  const StageCounts kept = run(CandidateMode::kKeep);
  EXPECT_EQ(kept.points, kept.filter.consistent);
  const StageCounts merged = run(CandidateMode::kMerge);
  EXPECT_EQ(merged.filter.consistent, kept.filter.consistent);
  EXPECT_LT(merged.points, merged.filter.consistent / 2);
  const StageCounts triangulated = run(CandidateMode::kTriangulate);
  EXPECT_EQ(triangulated.hit, 0u);
  EXPECT_GT(triangulated.points, merged.points / 2);
}

TEST_F(Localizer, WithoutGeometryThereAreNoPoints) {
  const auto source = HlocSource();
  const QueryResult result = Run(*source, Method::kE5p1);
  EXPECT_EQ(result.localized.counts.hit, 0u);
  EXPECT_TRUE(result.problem.matches_2d3d.empty());
  EXPECT_TRUE(result.localized.localized());
  EXPECT_TRUE(IsNearPose(*result.localized.estimate.cam_from_world,
                         scene_.queries[0].cam_from_world, 1e-3, 1e-4));
}

TEST_F(Localizer, ReasonsNameTheFirstStageThatCameUpEmpty) {
  const auto reason = [&](const QueryMatches& matches) {
    return Run(GivenMatches(matches)).localized.reason;
  };
  EXPECT_EQ(reason({}), "no retrieved references");
  EXPECT_EQ(reason({scene_.references, {}}), "no matches with the retrieved references");
  QueryMatches two = AllMatches();
  two.matches.resize(2);
  EXPECT_EQ(reason(two), ToString(FailureReason::kTooFewMatches));
}

TEST_F(Localizer, ReferencesAtOneCentreGiveAnOrientationOnly) {
  QueryMatches matches = AllMatches();
  std::erase_if(matches.matches, [](const Match2D2D& m) { return m.reference != 0; });
  matches.references.resize(1);
  const QueryResult result = Run(GivenMatches(matches), Method::kE5p1);
  EXPECT_FALSE(result.localized.localized());
  EXPECT_FALSE(result.localized.reason.empty());
}

}  // namespace
}  // namespace raylift
