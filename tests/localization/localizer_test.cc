#include "raylift/localization/localizer.h"

#include "support/matchers.h"
#include "support/room_scene.h"
#include "support/splat_files.h"
#include "support/test_data.h"
#include "surfaces/resampled_mesh.h"
#include "views/space_probe.h"
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/io/image_file.h"
#include "raylift/io/query_list.h"
#include "raylift/io/scene_file.h"
#include "raylift/lifting/mesh_source.h"
#include "raylift/localization/localize_all.h"
#include "raylift/localization/match_source.h"

namespace raylift {
namespace {

class LocalizerTest : public ::testing::Test {
 protected:
  Localizer Make(std::shared_ptr<const MatchSource> source, Method method = Method::kAdaptive,
                 const FilterOptions& filter = {}, const CandidateOptions& candidates = {}) const {
    Scene scene = scene_;
    if (method == Method::kE5p1) scene.sources.clear();
    LocalizerOptions options{.filter = filter, .candidates = candidates};
    options.estimator.method = method;
    return {std::make_shared<const Scene>(std::move(scene)), std::move(source), options};
  }
  QueryResult Run(std::shared_ptr<const MatchSource> source, Method method = Method::kAdaptive,
                  const FilterOptions& filter = {}, const CandidateOptions& candidates = {}) const {
    return Make(std::move(source), method, filter, candidates).Localize(query_);
  }
  QueryResult RunGiven(const QueryMatches& matches, Method method = Method::kAdaptive,
                       const FilterOptions& filter = {}) const {
    return Make(nullptr, method, filter).Localize(query_, matches);
  }

  std::shared_ptr<MatchSource> HlocSource() const {
    return OpenMatches(scene_, queries_,
                       {.hloc = HlocFiles{room_.features(), room_.matches(), room_.pairs()}});
  }
  QueryMatches AllMatches() const { return HlocSource()->Match(query_); }

  const Rigid3& truth() const { return room_.queries[0].cam_from_world; }

  RoomScene room_ = WriteRoomScene(TestFolder(), {.matches = true, .pictures = true});
  std::vector<Query> queries_ = ReadQueryList(room_.query_list());
  Query query_ = queries_.front();
  Scene scene_ = OpenScene({.model = room_.model(),
                            .images = room_.images(),
                            .geometry = {"mesh:" + room_.mesh().string()}});
};

TEST_F(LocalizerTest, CountsEveryStage) {
  const auto source = HlocSource();
  const QueryResult result = Run(source);
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
  EXPECT_TRUE(IsNearPose(*result.localized.estimate.cam_from_world, truth(), 1e-3, 1e-4));
}

// Points at random on the room's walls, some 3 cm apart, with noise of a third of that.
TEST_F(LocalizerTest, APointCloudStandsInForTheMesh) {
  Rng rng = TestRng();
  constexpr double kNoise = 0.01;
  std::string points;
  for (const SurfaceSample& sample :
       SampleSurface(scene_.Mesh()->mesh(), 120000, StreamSeed(7, "room", "cloud"))) {
    const Eigen::Vector3d p =
        sample.point_in_world + kNoise * rng.Normal() * sample.normal_in_world;
    points += fmt::format("{} {} {}\n", p.x(), p.y(), p.z());
  }
  const auto file = room_.folder / "room.xyz";
  WriteFile(file, points);
  scene_ = OpenScene(
      {.model = room_.model(), .images = room_.images(), .geometry = {"cloud:" + file.string()}});
  EXPECT_EQ(scene_.Mesh(), nullptr);
  EXPECT_NE(scene_.Surface(), nullptr);
  const QueryResult result = Run(HlocSource(), Method::kP3p);
  const StageCounts& counts = result.localized.counts;
  // Keypoints are anywhere on the surfaces: those at edges may find none.
  EXPECT_GT(counts.hit, 0.9 * counts.matched);
  ASSERT_TRUE(result.localized.localized()) << result.localized.reason;
  // Some hundred points, each some 4 mm off, from a few meters away.
  EXPECT_TRUE(IsNearPose(*result.localized.estimate.cam_from_world, truth(), 0.1, 0.005));
}

// Flat discs on the room's walls, as its mesh has them.
TEST_F(LocalizerTest, SplatsStandInForTheMesh) {
  const auto file = room_.folder / "room.ply";
  WriteFile(file, SplatPly(DiscsOn(scene_.Mesh()->mesh(), 0.05), SplatLayout::kDiscs));
  scene_ = OpenScene(
      {.model = room_.model(), .images = room_.images(), .geometry = {"splat:" + file.string()}});
  EXPECT_EQ(scene_.Mesh(), nullptr);
  EXPECT_NE(scene_.Surface(), nullptr);
  const QueryResult result = Run(HlocSource(), Method::kP3p);
  const StageCounts& counts = result.localized.counts;
  EXPECT_GT(counts.hit, 0.99 * counts.matched);
  ASSERT_TRUE(result.localized.localized()) << result.localized.reason;
  // Discs reach beyond the edges that they meet at: the points there are off, and are left out.
  EXPECT_TRUE(IsNearPose(*result.localized.estimate.cam_from_world, truth(), 0.02, 0.002));
}

// A focal length that is a guess leaves open how far away all is; a range tells it.
TEST_F(LocalizerTest, ARangeIsOfTheSurfaceInTheMiddle) {
  const Eigen::Vector3d ahead = truth().rotation.conjugate() * Eigen::Vector3d::UnitZ();
  const Ray axis{truth().OriginInSource(), ahead};
  const auto hit = scene_.Mesh()->Cast({&axis, 1}).front();
  ASSERT_TRUE(hit);
  const auto along_axis = [&](const PoseEstimate& estimate) {
    return std::pair((estimate.cam_from_world.value() * axis.origin_in_world).z(),
                     std::sqrt(estimate.covariance.value()(5, 5)));
  };
  const auto without = along_axis(Run(HlocSource()).localized.estimate);
  query_.priors.range = {.range = hit->ray_t, .sigma = without.second / 10};
  const QueryResult known = Run(HlocSource());
  ASSERT_TRUE(known.problem.priors.range->plane);
  const RangePrior::Plane& plane = *known.problem.priors.range->plane;
  EXPECT_LT((plane.point - (axis.origin_in_world + hit->ray_t * ahead)).norm(), 0.01);
  EXPECT_GT(std::abs(plane.normal.normalized().dot(hit->normal_in_world)), 0.999);
  const auto with = along_axis(known.localized.estimate);
  EXPECT_LT(with.second, without.second / 5);
  EXPECT_LT(std::abs(with.first), std::abs(without.first));
  // One that contradicts the matches is not believed.
  query_.priors.range->range += 2;
  EXPECT_NEAR(along_axis(Run(HlocSource()).localized.estimate).first, without.first,
              without.second);
}

TEST_F(LocalizerTest, MatchesBeyondTheMeshAreNotHits) {
  QueryMatches matches = AllMatches();
  const size_t right = matches.matches.size();
  // The room is closed: only a camera outside that looks away sees nothing.
  PosedImage outside = matches.references[0];
  outside.cam_from_world.translation = outside.cam_from_world.rotation * Eigen::Vector3d(0, 0, -50);
  matches.references.push_back(outside);
  for (int i = 0; i < 7; ++i) {
    matches.matches.push_back({6, {100.0 + i, 100}, {160, 120.0 + i}});
  }
  const StageCounts counts = RunGiven(matches).localized.counts;
  EXPECT_EQ(counts.matched, right + 7);
  EXPECT_EQ(counts.hit, right);
}

TEST_F(LocalizerTest, TheFilterDropsWhatReferencesDisagreeOn) {
  QueryMatches matches = AllMatches();
  const size_t right = matches.matches.size();
  for (int i = 0; i < 20; ++i) {
    matches.matches.push_back({0, {10.0 + 10 * i, 33.25}, {300.0 - 10 * i, 200}});
  }
  const FilterOptions filter{FilterMode::kFixed, {}};
  const QueryResult result = RunGiven(matches, Method::kP3p, filter);
  const StageCounts& counts = result.localized.counts;
  EXPECT_EQ(counts.hit, right + 20);
  EXPECT_LE(counts.filter.consistent, right);
  EXPECT_EQ(
      counts.filter.consistent + counts.filter.dropped_by_views + counts.filter.dropped_by_ratio,
      counts.hit);
  EXPECT_EQ(result.problem.matches_2d3d.size(), counts.filter.consistent);
  EXPECT_TRUE(result.localized.localized());
}

TEST_F(LocalizerTest, MergesWhatTheFilterKeepsAndTriangulatesWithoutGeometry) {
  const auto source = HlocSource();
  const FilterOptions filter{FilterMode::kFixed, {}};
  const auto run = [&](CandidateMode mode) {
    QueryResult result = Run(source, Method::kP3p, filter, {.mode = mode});
    EXPECT_TRUE(IsNearPose(*result.localized.estimate.cam_from_world, truth(), 1e-3, 1e-4));
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

TEST_F(LocalizerTest, WithoutGeometryThereAreNoPoints) {
  const auto source = HlocSource();
  const QueryResult result = Run(source, Method::kE5p1);
  EXPECT_EQ(result.localized.counts.hit, 0u);
  EXPECT_TRUE(result.problem.matches_2d3d.empty());
  EXPECT_TRUE(result.localized.localized());
  EXPECT_TRUE(IsNearPose(*result.localized.estimate.cam_from_world, truth(), 1e-3, 1e-4));
}

TEST_F(LocalizerTest, ReasonsNameTheFirstStageThatCameUpEmpty) {
  const auto reason = [&](const QueryMatches& matches) {
    return RunGiven(matches).localized.reason;
  };
  EXPECT_EQ(reason({}), "no retrieved references");
  EXPECT_EQ(reason({room_.references, {}}), "no matches with the retrieved references");
  QueryMatches two = AllMatches();
  two.matches.resize(2);
  EXPECT_EQ(reason(two), ToString(FailureReason::kTooFewMatches));
}

TEST_F(LocalizerTest, ReferencesAtOneCenterGiveAnOrientationOnly) {
  QueryMatches matches = AllMatches();
  std::erase_if(matches.matches, [](const Match2D2D& m) { return m.reference != 0; });
  matches.references.resize(1);
  const QueryResult result = RunGiven(matches, Method::kE5p1);
  EXPECT_FALSE(result.localized.localized());
  EXPECT_FALSE(result.localized.reason.empty());
}

TEST_F(LocalizerTest, StagesCanBeCalledOneByOne) {
  const Localizer localizer = Make(HlocSource(), Method::kP3p, {FilterMode::kFixed, {}});
  QueryResult result = localizer.Match(query_);
  EXPECT_GT(result.localized.counts.matched, 0u);
  EXPECT_TRUE(result.problem.matches_2d3d.empty());
  localizer.Lift(result);
  EXPECT_EQ(result.problem.matches_2d3d.size(), result.localized.counts.hit);
  localizer.Filter(result);
  EXPECT_EQ(result.problem.matches_2d3d.size(), result.localized.counts.points);
  EXPECT_FALSE(result.localized.estimate.cam_from_world.has_value());
  localizer.Estimate(result);
  const QueryResult whole = localizer.Localize(query_);
  EXPECT_TRUE(IsNearPose(*result.localized.estimate.cam_from_world,
                         *whole.localized.estimate.cam_from_world, 0, 0));
  EXPECT_EQ(result.localized.counts.filter.consistent, whole.localized.counts.filter.consistent);
  for (const LocalizedQuery* q :
       std::initializer_list<const LocalizedQuery*>{&result.localized, &whole.localized}) {
    EXPECT_GT(q->times.match_ms, 0);
    EXPECT_GT(q->times.lift_ms, 0);
    EXPECT_GT(q->times.filter_ms, 0);
    EXPECT_GT(q->times.estimate_ms, 0);
  }
}

// The built-in front end: a photograph in memory is the same as one on disk.
TEST_F(LocalizerTest, APhotographInMemoryIsLocalizedLikeOneOnDisk) {
  const MatchingOptions matching{.front_end = {.query_images = room_.images()}};
  const Localizer with_files = Make(OpenMatches(scene_, queries_, matching), Method::kP3p);
  const Localizer from_memory = Make(OpenMatches(scene_, {}, {}), Method::kP3p);
  const Image photograph = ReadImage(room_.images() / query_.name, ImageChannels::kGray);
  const QueryResult expected = with_files.Localize(query_);
  ASSERT_TRUE(expected.localized.localized()) << expected.localized.reason;
  EXPECT_TRUE(IsNearPose(*expected.localized.estimate.cam_from_world, truth(), 0.5, 0.05));
  const Features features = ExtractFrontEndFeatures(photograph, FrontEndOptions().max_features);
  for (const QueryResult& result :
       {from_memory.Localize(query_, photograph), from_memory.Localize(query_, features),
        from_memory.Localize(query_, from_memory.Match(query_, features).problem.references.empty()
                                         ? QueryMatches{}
                                         : with_files.matches()->Match(query_))}) {
    ASSERT_EQ(result.problem.matches_2d2d.size(), expected.problem.matches_2d2d.size());
    EXPECT_TRUE(IsNearPose(*result.localized.estimate.cam_from_world,
                           *expected.localized.estimate.cam_from_world, 0, 0));
  }
  EXPECT_TRUE(FailsWithInputError([&] { from_memory.Localize(query_); }, {query_.name}));
  EXPECT_TRUE(FailsWithInputError(
      [&] {
        from_memory.Localize({query_.name, query_.camera.Scaled(160, 120)}, photograph);
      },
      {query_.name, "320 x 240", "160 x 120"}));
  EXPECT_TRUE(FailsWithInputError([&] { Make(HlocSource()).Localize(query_, photograph); },
                                  {query_.name, "in memory"}));
}

TEST_F(LocalizerTest, ASceneCanBeFilledByHand) {
  Scene scene;
  scene.references.images = room_.references;
  scene.AddGeometry(std::make_shared<const MeshSource>("the room", scene_.Mesh()), scene_.Mesh());
  const Localizer localizer(std::make_shared<const Scene>(scene), nullptr, {});
  const QueryResult result = localizer.Localize(query_, AllMatches());
  ASSERT_TRUE(result.localized.localized());
  EXPECT_TRUE(IsNearPose(*result.localized.estimate.cam_from_world, truth(), 1e-3, 1e-4));
  EXPECT_EQ(scene.sources[0].spec, "the room");
  EXPECT_EQ(scene.Mesh(), scene_.Mesh());
  EXPECT_TRUE(FailsWithInputError([&] { localizer.Localize(query_); }, {"must be given"}));
  QueryMatches beyond = AllMatches();
  beyond.matches[3].reference = 6;
  EXPECT_TRUE(FailsWithInputError([&] { localizer.Localize(query_, beyond); },
                                  {query_.name, "reference 6 of 6"}));
}

TEST_F(LocalizerTest, ASceneFileOpensTheSameScene) {
  WriteFile(room_.folder / "scene.toml",
            "format = \"raylift-scene/1\"\nreferences = \"model\"\nimages = \"images\"\n"
            "[[geometry]]\nname = \"mesh\"\nspec = \"mesh:room.obj\"\n"
            "[[geometry]]\nname = \"far\"\nspec = \"mesh:room.obj,near=100\"\n");
  const SceneFile file = ReadSceneFile(room_.folder / "scene.toml");
  EXPECT_EQ(OpenScene(SceneOptionsOf(file)).sources.size(), 1u);
  EXPECT_EQ(OpenScene(SceneOptionsOf(file)).references.images.size(), 6u);
  const std::string far[] = {"far"};
  const Scene scene = OpenScene(SceneOptionsOf(file, far));
  const Localizer localizer(std::make_shared<const Scene>(scene), HlocSource(), {});
  EXPECT_EQ(localizer.Localize(query_).localized.counts.hit, 0u);
  const std::string unknown[] = {"near"};
  EXPECT_TRUE(FailsWithInputError([&] { SceneOptionsOf(file, unknown); }, {"geometry near"}));
}

TEST_F(LocalizerTest, SeveralConfigurationsGiveWhatEachGivesAlone) {
  const std::shared_ptr<const MatchSource> source = HlocSource();
  const FilterOptions fixed{FilterMode::kFixed, {}};
  const std::vector<Localizer> ways = {Make(source, Method::kP3p), Make(source, Method::kE5p1),
                                       Make(source, Method::kAdaptive, fixed),
                                       Make(source, Method::kP3p, fixed, {CandidateMode::kMerge})};
  const LocalizeAll all(ways, {query_}, source, 2);
  std::vector<std::optional<QueryResult>> results(ways.size());
  all.LocalizeQuery(0, 2, [&](size_t way, const QueryResult& result) { results[way] = result; });
  for (size_t i = 0; i < ways.size(); ++i) {
    const QueryResult alone = ways[i].Localize(query_);
    ASSERT_TRUE(results[i].has_value());
    EXPECT_TRUE(IsNearPose(*results[i]->localized.estimate.cam_from_world,
                           *alone.localized.estimate.cam_from_world, 0, 0));
    EXPECT_EQ(results[i]->localized.counts.points, alone.localized.counts.points);
    EXPECT_EQ(results[i]->localized.counts.hit, alone.localized.counts.hit);
  }
}

}  // namespace
}  // namespace raylift
