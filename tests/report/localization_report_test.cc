// What the page of localize holds; that it works in a browser is in tests/apps/report_test.cc.

#include "raylift/report/localization_report.h"

#include "support/room_scene.h"
#include "support/test_data.h"
#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

#include "raylift/base/file.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

nlohmann::json DataOf(const std::string& page) {
  constexpr std::string_view kBegin = "id=\"data\">";
  const size_t begin = page.find(kBegin) + kBegin.size();
  return nlohmann::json::parse(page.substr(begin, page.find("</script>", begin) - begin));
}

class LocalizationReportTest : public ::testing::Test {
 protected:
  // A query whose inliers are where the pose has them, but for one that is 2 px to the left.
  QueryResult Result(size_t query) const {
    QueryResult result;
    result.localized.name = scene_.queries[query].name;
    result.problem.query_camera = scene_.queries[query].camera;
    result.problem.references = {scene_.references[0], scene_.references[1]};
    const Rigid3& pose = scene_.queries[query].cam_from_world;
    const Rigid3 world_from_cam = pose.Inverse();
    PoseEstimate& estimate = result.localized.estimate;
    for (int i = 0; i < 20; ++i) {
      const Eigen::Vector3d point = world_from_cam * Eigen::Vector3d(0.1 * i - 1, 0.05 * i, 2.0);
      Eigen::Vector2d pixel = *result.problem.query_camera.ImgFromCam(pose * point);
      const PosedImage& reference = scene_.references[1];
      const auto seen = reference.camera.ImgFromCam(reference.cam_from_world * point);
      if (i == 7) pixel.x() -= 2;
      result.problem.matches_2d3d.push_back({pixel, point});
      estimate.inliers_2d3d.push_back(i != 7);
      if (!seen) continue;
      result.problem.matches_2d2d.push_back(
          {.reference = 1, .query_px = pixel, .reference_px = *seen});
      estimate.inliers_2d2d.push_back(true);
    }
    estimate.cam_from_world = pose;
    estimate.verdict = query == 0 ? PoseVerdict::kDoubtful : PoseVerdict::kLocalized;
    estimate.confidence = query == 0 ? 0.5 : 1;
    return result;
  }

  const RoomScene scene_ = WriteRoomScene(TestFolder(), {.matches = false, .pictures = true});
};

TEST_F(LocalizationReportTest, MarksLeadToWhereThePoseHasThem) {
  LocalizationReport report({.num_queries = 2,
                             .query_images = scene_.images(),
                             .reference_images = scene_.images(),
                             .folder = scene_.folder / "page"});
  report.Take(0, Result(0));
  report.Take(1, Result(1));
  const std::vector<std::string> warnings = {"a warning"};
  const std::string page = report.Format("title", scene_.references, warnings);
  const nlohmann::json data = DataOf(page);
  EXPECT_EQ(data["warnings"], nlohmann::json::array({"a warning"}));
  EXPECT_EQ(data["subtitle"], "2 of 2 queries localized, 1 of them doubtful, against 6 references");
  const nlohmann::json& query = data["rows"][0]["queries"][0];
  EXPECT_EQ(query["verdict"], "doubtful");
  ASSERT_EQ(query["points"].size(), 20u);
  for (size_t i = 0; i < 20; ++i) {
    const nlohmann::json& mark = query["points"][i];
    EXPECT_EQ(mark[2], i == 7 ? 0 : 1);
    EXPECT_NEAR(mark[3].get<double>(), i == 7 ? 2 : 0, 0.051);
    EXPECT_NEAR(mark[4].get<double>(), 0, 0.051);
  }
  ASSERT_GT(query["pairs"].size(), 5u);
  for (const nlohmann::json& mark : query["pairs"]) {
    // The nearest point of the line is at most as far as the pixel is off.
    EXPECT_LE(std::hypot(mark[3].get<double>(), mark[4].get<double>()), 2.1);
  }
  EXPECT_EQ(query["reference"]["name"], scene_.references[1].name);
  EXPECT_EQ(query["reference"]["lines"].size(), query["pairs"].size());
  EXPECT_TRUE(data["reference_photos"].contains(scene_.references[1].name));
  EXPECT_EQ(query["photo"]["width"], 320);
}

TEST_F(LocalizationReportTest, LargeRunsHaveTheirPicturesBesideThePage) {
  const std::filesystem::path folder = scene_.folder / "page";
  LocalizationReport report({.num_queries = 2,
                             .query_images = scene_.images(),
                             .reference_images = scene_.images(),
                             .max_in_page = 1,
                             .folder = folder});
  report.Take(0, Result(0));
  report.Take(1, Result(1));
  const std::string page = report.Format("title", scene_.references, {});
  EXPECT_THAT(page, Not(HasSubstr("data:image/jpeg")));
  EXPECT_EQ(DataOf(page)["rows"][0]["queries"][1]["file"], "queries/000001.js");
  const std::string file = ReadFile(folder / "queries/000001.js");
  EXPECT_EQ(file.find("takeQuery({"), 0u);
  EXPECT_THAT(file, HasSubstr("data:image/jpeg"));
}

// The first query is doubtful by itself; the walk has it one unit away, sure of it.
TEST_F(LocalizationReportTest, AWalkHasTheLastWord) {
  LocalizationReport report({.num_queries = 2,
                             .query_images = scene_.images(),
                             .mesh = std::make_shared<const RayCaster>(
                                 std::make_shared<const TriangleMesh>(ReadMesh(scene_.mesh()))),
                             .folder = scene_.folder / "page"});
  WalkedQueries walked;
  std::vector<Query> queries;
  for (size_t i = 0; i < 2; ++i) {
    report.Take(i, Result(i));
    walked.queries.push_back({Result(i).localized, WalkRole::kSmoothed, 2.0 - 0.5 * i});
    queries.push_back({scene_.queries[i].name, scene_.queries[i].camera});
  }
  walked.walks = {{.folder = "b/", .queries = {1}}, {.folder = "a/", .queries = {0}}};
  walked.walks[1].odometry = SmoothedWalk{.scale = 3};
  WalkedQuery& first = walked.queries[0];
  first.role = WalkRole::kReplaced;
  first.lost_before = true;
  first.single_cam_from_world = first.localized.estimate.cam_from_world;
  first.single_confidence = 0.5;
  PoseEstimate estimate = first.localized.estimate;
  estimate.verdict = PoseVerdict::kLocalized;
  estimate.confidence = 1;
  estimate.cam_from_world->translation.x() += 1;
  first.localized.TakeEstimate(estimate);

  const nlohmann::json alone = DataOf(report.Format("title", scene_.references, {}));
  EXPECT_FALSE(alone.contains("walk"));
  const nlohmann::json data =
      DataOf(report.Format("title", scene_.references, {}, ReportedWalk{walked, queries}));
  EXPECT_EQ(data["subtitle"], "2 of 2 queries localized, 0 of them doubtful, against 6 references");
  const nlohmann::json& query = data["rows"][0]["queries"][0];
  EXPECT_EQ(query["verdict"], "localized");
  EXPECT_EQ(query["walk"]["role"], "replaced");
  EXPECT_EQ(query["walk"]["single_confidence"], 0.5);
  EXPECT_EQ(query["points"][0].size(), 3U);
  EXPECT_FALSE(query.contains("solver"));
  EXPECT_NE(query["rendering"], alone["rows"][0]["queries"][0]["rendering"]);
  EXPECT_EQ(data["rows"][0]["queries"][1]["rendering"],
            alone["rows"][0]["queries"][1]["rendering"]);
  ASSERT_EQ(data["walk"]["frames"].size(), 2U);
  EXPECT_EQ(data["walk"]["frames"][0]["query"], scene_.queries[1].name);
  EXPECT_EQ(data["walk"]["frames"][1]["lost_before"], true);
  EXPECT_EQ(data["walk"]["frames"][1]["walk"], 1);
  EXPECT_FALSE(data["walk"]["odometry"][0].contains("scale"));
  EXPECT_EQ(data["walk"]["odometry"][1]["folder"], "a/");
  EXPECT_EQ(data["walk"]["odometry"][1]["scale"], 3);
  size_t single = 0;
  for (const auto& camera : data["scene"]["cameras"]) single += camera["kind"] == "single" ? 1 : 0;
  EXPECT_EQ(single, 1U);
}

}  // namespace
}  // namespace raylift
