#include <cmath>
#include <vector>

#include "support/matchers.h"
#include "support/test_data.h"

#include "raylift/base/file.h"
#include "raylift/io/pose_priors.h"
#include "raylift/io/query_list.h"

namespace raylift {
namespace {

std::filesystem::path FileOf(const std::string& text) {
  const std::filesystem::path file = TestFolder() / "priors.txt";
  WriteFile(file, text);
  return file;
}

TEST(PosePriorList, IsReadInAnyOrder) {
  const auto priors = ReadPosePriors(
      FileOf("# GNSS\nb position 1 2 3 4 5 6\n\na gravity 0 2 0 1.5\na position 4 5 6 0\n"
             "* world_down 0 1 0\n"));
  ASSERT_EQ(priors.size(), 2u);
  EXPECT_EQ(priors.at("b").position->position, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(priors.at("b").position->sigma, Eigen::Vector3d(4, 5, 6));
  EXPECT_FALSE(priors.at("b").gravity);
  EXPECT_EQ(priors.at("a").position->sigma, Eigen::Vector3d(0, 0, 0));
  EXPECT_EQ(priors.at("a").gravity->down_in_cam, Eigen::Vector3d(0, 2, 0));
  EXPECT_EQ(priors.at("a").gravity->down_in_world, Eigen::Vector3d(0, 1, 0));
  EXPECT_EQ(priors.at("a").gravity->sigma_deg, 1.5);
  EXPECT_EQ(ReadPosePriors(FileOf("a gravity 0 1 0 1")).at("a").gravity->down_in_world,
            Eigen::Vector3d(0, 0, -1));
  EXPECT_EQ(ReadPosePriors(FileOf("a focal_range 1.5")).at("a").focal_range, 1.5);
  EXPECT_EQ(ReadPosePriors(FileOf("a focal_sigma 0.002")).at("a").focal_sigma, 0.002);
  const auto range = ReadPosePriors(FileOf("a range 41.5 0.3")).at("a").range;
  ASSERT_TRUE(range);
  EXPECT_EQ(range->range, 41.5);
  EXPECT_EQ(range->sigma, 0.3);
  EXPECT_FALSE(range->plane);
  EXPECT_EQ(ReadPosePriors(FileOf("a range 41.5 0.3 m")).at("a").range->range, 41.5);
  // New York's plane has feet of 12/39.37 m.
  const auto feet = ReadPosePriors(
      FileOf("* world_crs EPSG:2263\na position 985000 200000 30 9\na range 12 1.2 m\n"));
  EXPECT_NEAR(feet.at("a").range->range, 39.37, 0.01);
  EXPECT_NEAR(feet.at("a").range->sigma, 3.937, 0.001);
}

// Grid north of zone 15 is .73 degrees east of true north there.
TEST(PosePriorList, PlacesAndHeadingsAreLedToTheWorld) {
  const auto priors = ReadPosePriors(
      FileOf("* world_crs EPSG:32615@576000,5188000,100\n"
             "a position -91.9945 46.8426 198.3 1 2 3 crs=EPSG:4326\na heading 90 5\n"
             "b heading 90 5 0 1 0\nc orientation 0.6 0 0.8 0 2\n"));
  const PosePriors& a = priors.at("a");
  EXPECT_LT((a.position->position - Eigen::Vector3d(667.674399668, 163.827476512, 98.3)).norm(),
            1e-6);
  EXPECT_LT((a.position->sigma - Eigen::Vector3d(1, 2, 3)).norm(), 0.01);
  const double right = (180 - 0.7335250840) * 3.14159265358979 / 180;
  EXPECT_LT(
      (a.heading->right_in_world - Eigen::Vector3d(std::sin(right), std::cos(right), 0)).norm(),
      1e-6);
  EXPECT_LT((priors.at("b").heading->right_in_world - Eigen::Vector3d(0, -1, 0)).norm(), 1e-12);
  EXPECT_EQ(priors.at("b").heading->right_in_cam, Eigen::Vector3d(0, 1, 0));
  EXPECT_EQ(priors.at("c").orientation->sigma_deg, 2);
  const auto turned =
      ReadPosePriors(FileOf("a heading 0 5\n* world_down 0 1 0\n* world_north 0 0 1"));
  EXPECT_LT((turned.at("a").heading->right_in_world - Eigen::Vector3d(1, 0, 0)).norm(), 1e-12);
}

// Where the equator meets the prime meridian, east is the earth's y, north its z and up its x.
TEST(PosePriorList, DeviationsAreLedToTheWorldsAxes) {
  const auto priors =
      ReadPosePriors(FileOf("* world_crs EPSG:4978\na position 0 0 0 1 2 3 crs=EPSG:4979\n"
                            "b position 90 45 0 1 2 2 crs=EPSG:4979"));
  EXPECT_LT((priors.at("a").position->sigma - Eigen::Vector3d(3, 1, 2)).norm(), 1e-6);
  EXPECT_LT((priors.at("b").position->sigma - Eigen::Vector3d(1, 2, 2)).norm(), 1e-6);
}

// A projected system of Duluth in WKT, whose names have blanks.
TEST(PosePriorList, TheWorldMayBeWkt) {
  const auto frame = WorldFrame::Parse(
      "PROJCS[\"zone 15\", GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,"
      "298.257223563]],PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]],\n"
      "PROJECTION[\"Transverse_Mercator\"],PARAMETER[\"latitude_of_origin\",0],"
      "PARAMETER[\"central_meridian\",-93],PARAMETER[\"scale_factor\",0.9996],"
      "PARAMETER[\"false_easting\",500000],PARAMETER[\"false_northing\",0],UNIT[\"metre\",1]]");
  const auto priors = ReadPosePriors(
      FileOf("* world_crs " + frame.text + "\na position -91.9945 46.8426 198.3 1 crs=EPSG:4326"),
      frame);
  const Eigen::Vector3d place(576667.674399668, 5188163.827476512, 198.3);
  EXPECT_LT((priors.at("a").position->position - place).norm(), 1e-6);
}

TEST(PosePriorList, DirectionsOnTheEarthNeedAPlace) {
  const auto file = FileOf("* world_crs EPSG:4978\na/1.jpg gravity 0 1 0 1");
  EXPECT_TRUE(FailsWithInputError([&] { ReadPosePriors(file); },
                                  {"priors.txt", "a/1.jpg: gravity and heading need a position"}));
  EXPECT_NO_THROW(
      ReadPosePriors(FileOf("* world_crs EPSG:4978\na gravity 0 1 0 1\n* world_down 0 0 -1")));
  const Eigen::Vector3d origin(3925064.548839588, 750627.724716086, 4954675.902014167);
  const auto priors = ReadPosePriors(
      FileOf("* world_crs EPSG:4978@3925064.5,750627.7,4954675.9\na gravity 0 1 0 1"));
  EXPECT_GT(priors.at("a").gravity->down_in_world.dot(-origin.normalized()), 0.9999);
}

TEST(PosePriorList, RoughTransformationsAreWarnedOf) {
  std::vector<std::string> warnings;
  const auto read = [&](const std::string& world) {
    ReadPosePriors(FileOf("* world_crs " + world + "\na position 9.9 53.55 52 1 crs=EPSG:4979"), {},
                   &warnings);
  };
  read("EPSG:25832");
  EXPECT_TRUE(warnings.empty());
  read("EPSG:25832+7837");
  if (warnings.empty()) GTEST_SKIP() << "the German quasigeoid is installed";
  EXPECT_NE(warnings.front().find("EPSG:4979 to EPSG:25832+7837"), std::string::npos);
}

TEST(PosePriorList, APoseIsAPositionAndAnOrientation) {
  const PosePriors priors = ReadPosePriors(FileOf("a pose 0 1 0 0 1 2 3 0.5 4")).at("a");
  EXPECT_EQ(priors.position.value().position, Eigen::Vector3d(-1, 2, 3));
  EXPECT_EQ(priors.position->sigma, Eigen::Vector3d::Constant(0.5));
  EXPECT_EQ(priors.orientation.value().cam_from_world.coeffs(), Eigen::Vector4d(1, 0, 0, 0));
  EXPECT_EQ(priors.orientation->sigma_deg, 4);
}

TEST(PosePriorList, MistakesAreNamedByLineAndField) {
  const auto fails = [](const std::string& text, const std::vector<std::string>& parts) {
    const auto file = FileOf(text);
    return FailsWithInputError([&] { ReadPosePriors(file); }, parts);
  };
  EXPECT_TRUE(fails("a position 1 2 3", {"priors.txt", "line 1", "sigma"}));
  EXPECT_TRUE(fails("a position 1 2 3 -1", {"line 1", "sigma: expected at least 0, found -1"}));
  EXPECT_TRUE(fails("a position 1 2 3 1 1", {"line 1", "sigma_z"}));
  EXPECT_TRUE(fails("a position 1 2 3 1 1 1 1", {"line 1"}));
  EXPECT_TRUE(fails("a position 1 x 3 1", {"line 1", "position", "x"}));
  EXPECT_TRUE(fails("a gravity 0 0 0 1", {"line 1", "expected a direction"}));
  EXPECT_TRUE(fails("a pose 1 0 0 0 0 0 0 1", {"line 1", "sigma_deg"}));
  EXPECT_TRUE(fails("a pose 1 0 0 0 0 0 0 -1 1", {"line 1", "sigma: expected at least 0"}));
  EXPECT_TRUE(fails("a orientation 1 0 0 0 1\na pose 1 0 0 0 0 0 0 1 1",
                    {"line 2", "pose of \"a\" stands twice"}));
  EXPECT_TRUE(fails("a range 0 1", {"line 1", "range: expected a positive one, found 0"}));
  EXPECT_TRUE(fails("a range 1 1 ft", {"line 1", "range: expected m", "found \"ft\""}));
  EXPECT_TRUE(fails("a range 1 1\na range 1 1", {"line 2", "range of \"a\" stands twice"}));
  EXPECT_TRUE(fails("a gps 0 0 0 1", {"line 1", "found \"a gps\""}));
  EXPECT_TRUE(fails("a position 1 2 3 1\na position 1 2 3 1",
                    {"line 2", "position of \"a\" stands twice"}));
  EXPECT_TRUE(
      fails("a focal_range 0.5", {"line 1", "focal_range: expected a factor above 1, up to 10"}));
  EXPECT_TRUE(fails("a focal_sigma 1", {"line 1", "focal_sigma: expected a share"}));
  EXPECT_TRUE(fails("a focal_sigma 0\na focal_sigma 0", {"line 2", "stands twice"}));
  EXPECT_TRUE(fails("a position 1 2 3 1 crs=EPSG:4326", {"line 1", "system", "is not known"}));
  EXPECT_TRUE(fails("* world_crs EPSG:25832\na position 53.55 9.9 3 1 crs=EPSG:4326",
                    {"line 2", "seem to be swapped, expected longitude, latitude"}));
  EXPECT_TRUE(fails("* world_down 0 0 1\na heading 0 1\n* world_north 0 0 -1", {"world_north"}));
  EXPECT_TRUE(fails("* world_down 0 0 1\n* world_down 0 0 1", {"line 2", "stands twice"}));
}

TEST(PosePriorList, QueriesTakeWhatIsKnownOfThem) {
  const Camera camera(CameraModel::kPinhole, 4, 3, std::vector<double>{5, 5, 2, 1.5});
  std::vector<Query> queries{{"a", camera}, {"b", camera}};
  TakePosePriors(FileOf("b position 1 2 3 4\nc position 1 2 3 4"), queries);
  EXPECT_TRUE(queries[0].priors.empty());
  EXPECT_TRUE(queries[1].priors.position);
  queries[1].priors.focal_range = 2;  // as the query list says
  queries[1].priors.focal_sigma = 0.001;
  TakePosePriors(FileOf("b position 1 2 3 4"), queries);
  EXPECT_EQ(queries[1].priors.focal_range, 2);
  EXPECT_EQ(queries[1].priors.focal_sigma, 0.001);
  TakePosePriors(FileOf("b focal_sigma 0"), queries);
  EXPECT_EQ(queries[1].priors.focal_sigma, 0);
  const auto file = FileOf("c position 1 2 3 4");
  EXPECT_TRUE(
      FailsWithInputError([&] { TakePosePriors(file, queries); }, {"knows none of the 2 queries"}));
}

}  // namespace
}  // namespace raylift
