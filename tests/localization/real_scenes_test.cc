// The whole chain on real photographs with known poses.

#include <algorithm>

#include "localization/matching/file_matches.h"
#include "support/test_data.h"
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "raylift/evaluation/pose_errors.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/query_list.h"
#include "raylift/localization/localize_all.h"
#include "raylift/localization/match_source.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

PosesByName Poses(const fs::path& model) {
  PosesByName poses;
  for (const PosedImage& image : ReadColmapModel(model).PosedImages()) {
    poses.emplace(image.name, image.cam_from_world);
  }
  return poses;
}

Comparison Localize(const std::vector<Query>& queries, const std::shared_ptr<MatchSource>& matches,
                    const Scene& scene, Method method, const PosesByName& truth,
                    CandidateMode candidates = CandidateMode::kKeep,
                    AlignMode align = AlignMode::kAuto) {
  LocalizerOptions options{.candidates = {.mode = candidates}};
  options.estimator.method = method;
  LocalizeAll localizer(scene, queries, matches,
                        {.localizer = options, .align = align, .check_input = false});
  PosesByName poses;
  for (const LocalizedQuery& query : localizer.Run()) {
    if (query.localized()) poses.emplace(query.name, *query.estimate.cam_from_world);
  }
  return CompareWithGroundTruth(truth, poses);
}

size_t CountWithin(const Comparison& comparison, const Threshold& threshold) {
  return static_cast<size_t>(std::count_if(
      comparison.queries.begin(), comparison.queries.end(),
      [&](const auto& query) { return query.error && threshold.Accepts(*query.error); }));
}

std::string Describe(const Comparison& comparison) {
  std::string text;
  for (const QueryError& query : comparison.queries) {
    text += query.error ? fmt::format("{}: {:.5f}, {:.4f} deg\n", query.name, query.error->position,
                                      query.error->rotation_deg)
                        : query.name + ": not localized\n";
  }
  return text;
}

constexpr Threshold kCoarse{0.05, 5};
constexpr Threshold kFine{0.02, 0.5};  // finer would measure the ground truth

class RgbdSmall : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto data = FindTestData("rgbd_small");
    if (!data) GTEST_SKIP() << "rgbd_small is not on this machine";
    data_ = *data;
    queries_ = ReadQueryList(data_ / "queries_with_intrinsics.txt");
    scene_ = OpenScene({.model = data_ / "model_ref",
                        .images = data_ / "images",
                        .geometry = {"mesh:" + (data_ / "mesh.ply").string()}});
    truth_ = Poses(data_ / "model_query_gt");
    ASSERT_EQ(queries_.size(), 10u);
  }

  fs::path data_;
  std::vector<Query> queries_;
  Scene scene_;
  PosesByName truth_;
};

TEST_F(RgbdSmall, LocalizesAllQueriesWithHlocsFiles) {
  const std::shared_ptr<MatchSource> matches = OpenHlocMatches(
      {data_ / "features.h5", data_ / "matches.h5", data_ / "pairs.txt"}, scene_.references, 10);
  for (const Method method : {Method::kP3p, Method::kAdaptive}) {
    const Comparison comparison = Localize(queries_, matches, scene_, method, truth_);
    EXPECT_EQ(CountWithin(comparison, kCoarse), 10u) << ToString(method) << "\n"
                                                     << Describe(comparison);
    EXPECT_GE(CountWithin(comparison, kFine), 9u) << ToString(method) << "\n"
                                                  << Describe(comparison);
    const ResultSummary summary = Summarize("", comparison, {});
    RecordProperty(fmt::format("{}_median_m", ToString(method)),
                   fmt::format("{:.5f}", summary.median_position));
    RecordProperty(fmt::format("{}_median_deg", ToString(method)),
                   fmt::format("{:.4f}", summary.median_rotation_deg));
  }
  EXPECT_TRUE(matches->Warnings().empty());
}

TEST_F(RgbdSmall, MergedOrTriangulatedPointsMakeUpForMonocularDepth) {
  const std::shared_ptr<MatchSource> matches = OpenHlocMatches(
      {data_ / "features.h5", data_ / "matches.h5", data_ / "pairs.txt"}, scene_.references, 10);
  const Scene depth = OpenScene(
      {.model = data_ / "model_ref", .geometry = {"depth:" + (data_ / "depth_mono_sim").string()}});
  const auto run = [&](CandidateMode mode) {
    Comparison comparison =
        Localize(queries_, matches, depth, Method::kP3p, truth_, mode, AlignMode::kOff);
    RecordProperty(std::string(ToString(mode)), Describe(comparison));
    return comparison;
  };
  const Comparison kept = run(CandidateMode::kKeep);
  const Comparison merged = run(CandidateMode::kMerge);
  const Comparison triangulated = run(CandidateMode::kTriangulate);
  EXPECT_GT(CountWithin(merged, kCoarse), CountWithin(kept, kCoarse));
  EXPECT_LT(Summarize("", merged, {}).median_position,
            0.5 * Summarize("", kept, {}).median_position);
  EXPECT_EQ(CountWithin(triangulated, kFine), 10u) << Describe(triangulated);
}

TEST_F(RgbdSmall, AlignmentMakesUpForMonocularDepth) {
  const std::shared_ptr<MatchSource> matches = OpenHlocMatches(
      {data_ / "features.h5", data_ / "matches.h5", data_ / "pairs.txt"}, scene_.references, 10);
  const Scene depth = OpenScene(
      {.model = data_ / "model_ref", .geometry = {"depth:" + (data_ / "depth_mono_sim").string()}});
  const auto run = [&](AlignMode align) {
    return Localize(queries_, matches, depth, Method::kP3p, truth_, CandidateMode::kKeep, align);
  };
  const Comparison aligned = run(AlignMode::kAuto);
  EXPECT_EQ(CountWithin(aligned, kFine), 10u) << Describe(aligned);
  EXPECT_LT(Summarize("", aligned, {}).median_position,
            0.5 * Summarize("", run(AlignMode::kOff), {}).median_position);
}

TEST_F(RgbdSmall, LocalizesFromImagesAlone) {
  const std::shared_ptr<MatchSource> matches = OpenMatches(
      scene_, queries_,
      {.front_end = {.query_images = data_ / "images", .cache = TestFolder() / "cache"}});
  for (const Method method : {Method::kP3p, Method::kAdaptive}) {
    const Comparison comparison = Localize(queries_, matches, scene_, method, truth_);
    EXPECT_GE(CountWithin(comparison, kCoarse), 9u) << ToString(method) << "\n"
                                                    << Describe(comparison);
    const ResultSummary summary = Summarize("", comparison, {});
    RecordProperty(fmt::format("{}_median_m", ToString(method)),
                   fmt::format("{:.5f}", summary.median_position));
    RecordProperty(fmt::format("{}_median_deg", ToString(method)),
                   fmt::format("{:.4f}", summary.median_rotation_deg));
    RecordProperty(fmt::format("{}_within_5cm_5deg", ToString(method)),
                   static_cast<int>(CountWithin(comparison, kCoarse)));
  }
}

constexpr double kSceauxExtent = 11.61;  // between the two cameras farthest apart

TEST(SceauxSfm, P3pLocalizesWithThePointsOfTheModel) {
  const auto data = FindTestData("sceaux_sfm");
  if (!data) GTEST_SKIP() << "sceaux_sfm is not on this machine";
  const auto queries = ReadQueryList(*data / "queries_with_intrinsics.txt");
  const Scene scene = OpenScene({.model = *data / "model_ref", .geometry = {"sfm"}});
  const std::shared_ptr<MatchSource> matches = OpenHlocMatches(
      {*data / "features.h5", *data / "matches.h5", *data / "pairs.txt"}, scene.references, 10);
  EXPECT_TRUE(scene.sources.front().geometry.warnings.empty());
  const Comparison comparison =
      Localize(queries, matches, scene, Method::kP3p, Poses(*data / "model_query_gt"));
  // OpenCV's baseline is at 0.049 to 0.065 % of the extent and 0.033 to 0.046 deg.
  EXPECT_EQ(CountWithin(comparison, {0.001 * kSceauxExtent, 0.05}), 3u) << Describe(comparison);
}

TEST(SceauxSfm, E5p1LocalizesWithoutAnyGeometry) {
  const auto data = FindTestData("sceaux_sfm");
  if (!data) GTEST_SKIP() << "sceaux_sfm is not on this machine";
  const auto queries = ReadQueryList(*data / "queries_with_intrinsics.txt");
  const Scene scene = OpenScene({.model = *data / "model_ref"});
  const std::shared_ptr<MatchSource> matches = OpenHlocMatches(
      {*data / "features.h5", *data / "matches.h5", *data / "pairs.txt"}, scene.references, 10);
  const Comparison comparison =
      Localize(queries, matches, scene, Method::kE5p1, Poses(*data / "model_query_gt"));
  ASSERT_EQ(comparison.queries.size(), 3u);
  // The lowest cost lies at 0.32 % and 0.18 deg for the worst position and at 0.2021 deg for the
  // worst rotation, whatever the seed and the threshold (1 to 4 px).
  EXPECT_EQ(CountWithin(comparison, {0.005 * kSceauxExtent, 0.21}), 3u) << Describe(comparison);
  for (const QueryError& query : comparison.queries) {
    if (!query.error) continue;
    const std::string stem = fs::path(query.name).stem().string();
    RecordProperty("percent_" + stem,
                   fmt::format("{:.4f}", 100 * query.error->position / kSceauxExtent));
    RecordProperty("deg_" + stem, fmt::format("{:.4f}", query.error->rotation_deg));
  }
}

}  // namespace
}  // namespace raylift
