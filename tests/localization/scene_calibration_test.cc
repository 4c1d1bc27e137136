#include "raylift/localization/scene_calibration.h"

#include <cmath>
#include <limits>
#include <string>

#include "support/matchers.h"
#include "support/room_scene.h"
#include "support/test_data.h"
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/io/query_list.h"
#include "raylift/localization/match_source.h"

namespace raylift {
namespace {

SceneCalibration MakeCalibration() {
  SceneCalibration calibration{.by = CalibratedBy::kQueries};
  DepthAlignment alignment{.mode = AlignMode::kGrid, .maps = {}, .median_factor = 1.0 / 3};
  alignment.maps.push_back({.reference = "left.jpg",
                            .correction = {.columns = 2, .rows = 1, .log_factors = {0.1, 1.0 / 7}},
                            .num_matches = 12,
                            .own_correction = true});
  // As of a reference without a match.
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  alignment.maps.push_back({.reference = "right.jpg",
                            .correction = {},
                            .median_before_px = kNone,
                            .median_after_px = kNone});
  calibration.depth = {std::nullopt, alignment};
  calibration.confidences = {std::nullopt, ConfidenceWorth{.knots = {{1.0 / 7, 0.1}, {0.9, 0.01}},
                                                           .common_sigma = 0.03,
                                                           .num_matches = 12}};
  calibration.geometry_noise = {.keypoints_px = 0.7, .geometry_px = 3.1, .num_views = 41};
  calibration.match_noise = {.keypoint_px = {1.1, 30.5},
                             .depth = {0.01, 7},
                             .common_depth = {},
                             .reference_factor = {0.08, 12}};
  return calibration;
}

TEST(SceneCalibration, IsReadAsItWasWritten) {
  const SceneCalibration made = MakeCalibration();
  const auto file = TestFolder() / "calibration.json";
  WriteSceneCalibration(file, made);
  const auto read = ReadSceneCalibration(file);
  EXPECT_EQ(FormatSceneCalibration(*read), FormatSceneCalibration(made));
  EXPECT_EQ(read->by, made.by);
  EXPECT_EQ(read->geometry_noise, made.geometry_noise);
  EXPECT_EQ(read->match_noise, made.match_noise);
  ASSERT_EQ(read->depth.size(), 2u);
  EXPECT_FALSE(read->depth[0]);
  EXPECT_EQ(read->depth[1]->maps[0].correction.log_factors,
            made.depth[1]->maps[0].correction.log_factors);
  EXPECT_TRUE(std::isnan(read->depth[1]->maps[1].median_after_px));
}

TEST(SceneCalibration, MalformedFilesAreNamed) {
  const auto file = TestFolder() / "calibration.json";
  for (const char* text : {"", "{}", "{\"format\": \"other/1\"}"}) {
    WriteFile(file, text);
    EXPECT_TRUE(FailsWithInputError([&] { ReadSceneCalibration(file); }, {"calibration.json"}));
  }
  std::string text = FormatSceneCalibration(MakeCalibration());
  text.replace(text.find("\"columns\":2"), 11, "\"columns\":9");
  EXPECT_TRUE(FailsWithInputError([&] { ParseSceneCalibration(text); }, {"left.jpg", "9 x 1"}));
}

TEST(SceneCalibration, WhatConfidencesAreWorthRises) {
  const auto fails = [](const ConfidenceWorth::Knot& last, const std::string& says) {
    SceneCalibration calibration = MakeCalibration();
    std::string text = FormatSceneCalibration(calibration);
    const std::string before = "\"confidence\":0.9,\"sigma\":0.01";
    EXPECT_NE(text.find(before), std::string::npos) << text;
    text.replace(text.find(before), before.size(),
                 fmt::format("\"confidence\":{},\"sigma\":{}", last.confidence, last.sigma));
    return FailsWithInputError([&] { ParseSceneCalibration(text); }, {"knots", says});
  };
  EXPECT_TRUE(fails({0.1, 0.01}, "expected rising confidences, found 0.1 after 0.142857"));
  EXPECT_TRUE(fails({0.9, 0}, "expected positive sigmas, found 0"));
  EXPECT_TRUE(fails({0.9, -1}, "expected positive sigmas, found -1"));
}

class CalibratedRoom : public ::testing::Test {
 protected:
  std::shared_ptr<const MatchSource> Matches(const Scene& scene) const {
    return OpenMatches(scene, queries_,
                       {.hloc = HlocFiles{room_.features(), room_.matches(), room_.pairs()}});
  }

  RoomScene room_ = WriteRoomScene(TestFolder());
  std::vector<Query> queries_ = ReadQueryList(room_.query_list());
  Scene scene_ = OpenScene({.model = room_.model(), .geometry = {"mesh:" + room_.mesh().string()}});
};

TEST_F(CalibratedRoom, FilesWithoutPairsOfReferencesAreCalibratedByQueriesInAnyOrder) {
  const Scene calibrated = Calibrate(scene_, Matches(scene_), queries_, {.threads = 1});
  ASSERT_NE(calibrated.calibration, nullptr);
  EXPECT_EQ(calibrated.calibration->by, CalibratedBy::kQueries);
  const std::vector<Query> reversed(queries_.rbegin(), queries_.rend());
  EXPECT_EQ(FormatSceneCalibration(
                *Calibrate(scene_, Matches(scene_), reversed, {.threads = 4}).calibration),
            FormatSceneCalibration(*calibrated.calibration));
  // What is known is not learned again.
  EXPECT_EQ(Calibrate(calibrated, Matches(scene_), {}, {}).calibration, calibrated.calibration);
}

TEST_F(CalibratedRoom, ALocalizerTakesWhatTheSceneKnows) {
  auto known = std::make_shared<SceneCalibration>(MakeCalibration());
  known->depth.clear();
  known->confidences.clear();
  const auto scene = std::make_shared<const Scene>(Calibrated(scene_, known));
  EXPECT_EQ(Localizer(scene, nullptr, {}).options().estimator.scene_noise, known->match_noise);
  EXPECT_FALSE(Localizer(scene, nullptr, {}).options().filter.multi_view_noise);
  const LocalizerOptions automatic{.filter = {.mode = FilterMode::kAuto, .thresholds = {}}};
  EXPECT_EQ(Localizer(scene, nullptr, automatic).options().filter.multi_view_noise,
            known->geometry_noise);
}

TEST_F(CalibratedRoom, AnotherScenesCalibrationIsRefused) {
  auto other = std::make_shared<SceneCalibration>(MakeCalibration());
  EXPECT_TRUE(FailsWithInputError([&] { Calibrated(scene_, other); }, {"2 sources", "found 1"}));
  other->depth.erase(other->depth.begin());
  EXPECT_TRUE(FailsWithInputError([&] { Calibrated(scene_, other); }, {"2 sources", "found 1"}));
  other->confidences.clear();
  EXPECT_TRUE(FailsWithInputError([&] { Calibrated(scene_, other); }, {"none of the scene's"}));
}

}  // namespace
}  // namespace raylift
