#include "raylift/sequences/walk.h"

#include <numbers>
#include <string>
#include <vector>

#include "support/matchers.h"
#include "support/test_data.h"
#include <Eigen/Geometry>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "raylift/base/file.h"

namespace raylift {
namespace {

using std::filesystem::path;
using testing::ElementsAre;
using testing::HasSubstr;

const std::vector<std::string> kNames = {"c.jpg", "a.jpg", "b.jpg"};

class ReadWalkTest : public testing::Test {
 protected:
  path Written(const std::string& name, const std::string& text) const {
    WriteFile(folder_ / name, text);
    return folder_ / name;
  }

 private:
  path folder_ = TestFolder();
};

std::vector<size_t> QueriesOf(const Walk& walk) {
  std::vector<size_t> queries;
  for (const WalkFrame& frame : walk.frames) queries.push_back(frame.query);
  return queries;
}

std::vector<std::string> Names(std::vector<std::string> names) { return names; }

const std::string kThreePoses =
    "# time tx ty tz qx qy qz qw\n"
    "1.0 0 0 0 0 0 0 1\n"
    "1.1 1 0 0 0 0 0 1\n"
    "1.2 2 0 0 0 0 1 0\n";

TEST_F(ReadWalkTest, TakesTheNearestPoseWithinHalfAStep) {
  const path odometry = Written("near.txt", kThreePoses);
  const path times = Written("near_times.txt", "a.jpg 1.04\nb.jpg 1.11\nc.jpg 1.24\n");
  const Walk walk = ReadWalk(odometry, times, kNames);
  EXPECT_THAT(QueriesOf(walk), ElementsAre(1, 2, 0));
  EXPECT_EQ(walk.frames[2].time_s, 1.24);
  EXPECT_EQ(walk.frames[1].cam_from_odometry.OriginInSource(), Eigen::Vector3d(1, 0, 0));
  EXPECT_TRUE(walk.warnings.empty());
}

// Every second pose is missing, so that the median step of those that are there is two frames long.
TEST_F(ReadWalkTest, APoseIsNotThatOfTheNextPhotograph) {
  std::string odometry, times;
  std::vector<std::string> names;
  for (int i = 0; i < 8; ++i) {
    names.push_back(fmt::format("{}.jpg", i));
    times += fmt::format("{}.jpg {}\n", i, i);
    if (i % 2 == 0) odometry += fmt::format("{} {} 0 0 0 0 0 1\n", i, i);
  }
  const Walk walk = ReadWalk(Written("o.txt", odometry), Written("t.txt", times), names);
  EXPECT_THAT(QueriesOf(walk), testing::ElementsAre(0, 2, 4, 6));
}

TEST_F(ReadWalkTest, FramesWithoutAPoseAreLeftOutWithAWarning) {
  const path odometry = Written("far.txt", kThreePoses);
  const path times = Written("far_times.txt", "a.jpg 1.0\nb.jpg 1.1\nc.jpg 1.26\n");
  const Walk walk = ReadWalk(odometry, times, kNames);
  EXPECT_THAT(QueriesOf(walk), ElementsAre(1, 2));
  EXPECT_THAT(walk.warnings,
              ElementsAre(HasSubstr("no pose of 1 of 3 photographs, such as c.jpg")));
}

TEST_F(ReadWalkTest, NamesMayHoldTheTimes) {
  const path odometry = Written("stamped.txt", kThreePoses);
  const std::vector<std::string> names = {"rgb/1.2.png", "rgb/1.0.png"};
  EXPECT_THAT(QueriesOf(ReadWalk(odometry, {}, names)), ElementsAre(1, 0));
}

TEST_F(ReadWalkTest, PosesMayGoByNames) {
  const path odometry = Written("named.txt",
                                "b.jpg 1 0 0 0 -1 0 0\n"
                                "a.jpg 1 0 0 0 0 0 0\n"
                                "other.jpg 1 0 0 0 5 0 0\n");
  const Walk walk = ReadWalk(odometry, {}, kNames);
  EXPECT_THAT(QueriesOf(walk), ElementsAre(1, 2));
  EXPECT_EQ(walk.frames[1].cam_from_odometry.OriginInSource(), Eigen::Vector3d(1, 0, 0));
}

// The camera goes one unit along x of the odometry's frame, turned by 90 degrees about z.
::testing::AssertionResult GoesAlongX(const Walk& walk) {
  if (walk.frames.size() != 2) return ::testing::AssertionFailure() << walk.frames.size();
  const Rigid3 &first = walk.frames[0].cam_from_odometry,
               &second = walk.frames[1].cam_from_odometry;
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(std::numbers::pi / 2, Eigen::Vector3d::UnitZ()));
  if (first.OriginInSource().norm() > 1e-12) {
    return ::testing::AssertionFailure() << "first: " << first.OriginInSource().transpose();
  }
  if ((second.OriginInSource() - Eigen::Vector3d::UnitX()).norm() > 1e-12) {
    return ::testing::AssertionFailure() << "second: " << second.OriginInSource().transpose();
  }
  for (const Rigid3& pose : {first, second}) {
    if (pose.rotation.angularDistance(turn.inverse()) > 1e-7) {
      return ::testing::AssertionFailure() << "rotation: " << pose.rotation.coeffs().transpose();
    }
  }
  return ::testing::AssertionSuccess();
}

TEST_F(ReadWalkTest, ReadsEurocsCsvInNanoseconds) {
  const path odometry = Written("data.csv",
                                "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],"
                                "q_RS_x [],q_RS_y [],q_RS_z [],v_RS_R_x [m s^-1]\n"
                                "1403636579758555392,0,0,0,0.7071067811865476,0,0,"
                                "0.7071067811865476,0.1\n"
                                "1403636579858555392, 1,0,0,0.7071067811865476,0,0,"
                                "0.7071067811865476,0.1\r\n");
  const Walk walk = ReadWalk(
      odometry, {}, Names({"cam0/data/1403636579758555392.png", "cam0/1403636579868555392.png"}));
  EXPECT_TRUE(GoesAlongX(walk));
  EXPECT_NEAR(walk.frames[1].time_s - walk.frames[0].time_s, 0.11, 1e-6);
}

// Times since a start are too small to tell their unit.
TEST_F(ReadWalkTest, EurocsTimesAreNanosecondsHoweverSmall) {
  const path odometry = Written("small.csv", "100000000,0,0,0,1,0,0,0\n200000000,1,0,0,1,0,0,0\n");
  const path times = Written("small_times.txt", "a.jpg 0.11\nb.jpg 0.19\n");
  EXPECT_THAT(QueriesOf(ReadWalk(odometry, times, kNames)), ElementsAre(1, 2));
}

TEST_F(ReadWalkTest, TumLinesMayBeInNanoseconds) {
  const path odometry = Written("nano.txt",
                                "1403636579758555392 0 0 0 0 0 0.7071067811865476 "
                                "0.7071067811865476\n1403636579858555392 1 0 0 0 0 "
                                "0.7071067811865476 0.7071067811865476\n");
  const path times = Written("nano_times.txt", "a.jpg 1403636579.77\nb.jpg 1403636579.84\n");
  EXPECT_TRUE(GoesAlongX(ReadWalk(odometry, times, kNames)));
}

TEST_F(ReadWalkTest, KittisLinesAreNumberedOrInOrder) {
  const path odometry = Written("kitti.txt",
                                "1 0 0 9 0 1 0 9 0 0 1 9\n"
                                "0 -1 0 0 1 0 0 0 0 0 1 0\n"
                                "0 -1 0 1 1 0 0 0 0 0 1 0\n");
  EXPECT_TRUE(
      GoesAlongX(ReadWalk(odometry, {}, Names({"image_2/000002.png", "image_2/000001.png"}))));
  EXPECT_THAT(QueriesOf(ReadWalk(odometry, {}, kNames)), ElementsAre(1, 2, 0));
  EXPECT_TRUE(FailsWithInputError(
      [&] {
        ReadWalk(odometry, {}, Names({"a.jpg", "b.jpg"}));
      },
      {"kitti.txt", "each of 2 photographs", "found 3 poses"}));
  const path mirrored = Written("mirrored.txt", "-1 0 0 0 0 1 0 0 0 0 1 0\n");
  EXPECT_TRUE(FailsWithInputError([&] { ReadWalk(mirrored, {}, kNames); },
                                  {"mirrored.txt: line 1", "right-handed"}));
}

// The camera's axes turned about x by 180 degrees are OpenGL's.
TEST_F(ReadWalkTest, LinesOfJsonAreAsOfArkit) {
  const path by_columns = Written(
      "columns.jsonl",
      "{\"timestamp\": 1.0, \"transform\": [0, 1, 0, 0, 1, 0, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1]}\n"
      "{\"timestamp\": 1.1, \"transform\": [0, 1, 0, 0, 1, 0, 0, 0, 0, 0, -1, 0, 1, 0, 0, 1]}\n");
  const path times = Written("json_times.txt", "a.jpg 1.0\nb.jpg 1.1\n");
  EXPECT_TRUE(GoesAlongX(ReadWalk(by_columns, times, kNames)));
  const path by_rows =
      Written("rows.jsonl",
              "{\"name\": \"b.jpg\", \"transform\": [[0,1,0,1],[1,0,0,0],[0,0,-1,0],[0,0,0,1]]}\n"
              "{\"name\": \"a.jpg\", \"transform\": [[0,1,0,0],[1,0,0,0],[0,0,-1,0],[0,0,0,1]]}\n");
  EXPECT_TRUE(GoesAlongX(ReadWalk(by_rows, {}, kNames)));
  const path both = Written("both.jsonl",
                            "{\"name\": \"images/a.jpg\", \"timestamp\": 1403636579000000000, "
                            "\"transform\": [[0,1,0,0],[1,0,0,0],[0,0,-1,0],[0,0,0,1]]}\n"
                            "{\"name\": \"images/b.jpg\", \"timestamp\": 1403636580000000000, "
                            "\"transform\": [[0,1,0,1],[1,0,0,0],[0,0,-1,0],[0,0,0,1]]}\n");
  const Walk walk = ReadWalk(both, {}, kNames);
  EXPECT_TRUE(GoesAlongX(walk));
  EXPECT_NEAR(walk.frames[1].time_s - walk.frames[0].time_s, 1, 1e-6);
  const path bad = Written("bad.jsonl", "{\"name\": \"b.jpg\", \"transform\": [1, 2]}\n");
  EXPECT_TRUE(
      FailsWithInputError([&] { ReadWalk(bad, {}, kNames); }, {"bad.jsonl: line 1", "transform"}));
}

TEST_F(ReadWalkTest, FramesOfTransformsGoByTheEndOfTheirPaths) {
  const path odometry = Written(
      "transforms.json",
      "{\"fl_x\": 500, \"fl_y\": 500, \"cx\": 320, \"cy\": 240, \"w\": 640, \"h\": 480, "
      "\"frames\": ["
      "{\"file_path\": \"./images/b.jpg\", \"transform_matrix\": [[0,1,0,1],[1,0,0,0],[0,0,-1,0],"
      "[0,0,0,1]]}, {\"file_path\": \"images/a.jpg\", \"transform_matrix\": [[0,1,0,0],[1,0,0,0],"
      "[0,0,-1,0],[0,0,0,1]]}]}");
  EXPECT_TRUE(GoesAlongX(ReadWalk(odometry, {}, kNames)));
}

TEST_F(ReadWalkTest, AnEndThatTwoPathsHaveIsNone) {
  const path odometry = Written("twice.jsonl",
                                "{\"name\": \"left/a.jpg\", \"transform\": "
                                "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}\n"
                                "{\"name\": \"right/a.jpg\", \"transform\": "
                                "[[1,0,0,1],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}\n"
                                "{\"name\": \"left/b.jpg\", \"transform\": "
                                "[[1,0,0,2],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}\n");
  EXPECT_TRUE(FailsWithInputError([&] { ReadWalk(odometry, {}, kNames); },
                                  {"twice.jsonl", "found 1 of 3"}));
  EXPECT_THAT(QueriesOf(ReadWalk(odometry, {}, Names({"right/a.jpg", "b.jpg"}))),
              ElementsAre(1, 0));
}

TEST_F(ReadWalkTest, KapturesTimesAreTaken) {
  Written("kapture/sensors/sensors.txt",
          "# kapture format: 1.1\ncam, , camera, SIMPLE_PINHOLE, 640, 480, 500, 320, 240\n");
  Written("kapture/sensors/records_camera.txt",
          "# kapture format: 1.1\n1403636579758555, cam, b.jpg\n1403636579858555, cam, a.jpg\n");
  // World to device.
  const path file = Written("kapture/sensors/trajectories.txt",
                            "# kapture format: 1.1\n"
                            "1403636579758555, cam, 0.7071067811865476, 0, 0, -0.7071067811865476, "
                            "0, 0, 0\n"
                            "1403636579858555, cam, 0.7071067811865476, 0, 0, -0.7071067811865476, "
                            "0, 1, 0\n");
  const Walk walk = ReadWalk(file.parent_path().parent_path(), {}, kNames);
  EXPECT_TRUE(GoesAlongX(walk));
  EXPECT_THAT(QueriesOf(walk), ElementsAre(2, 1));
  EXPECT_NEAR(walk.frames[1].time_s - walk.frames[0].time_s, 0.1, 1e-6);
}

TEST_F(ReadWalkTest, TheCameraSitsOnTheBody) {
  const path odometry = Written("body.txt", kThreePoses);
  const path times = Written("body_times.txt", "a.jpg 1.0\nb.jpg 1.1\n");
  // A quarter turn about x: the camera is at y = -2 of the body.
  const Rigid3 cam_from_body{
      Eigen::Quaterniond(Eigen::AngleAxisd(std::numbers::pi / 2, Eigen::Vector3d::UnitX())),
      {0, 0, 2}};
  const Walk walk = ReadWalk(odometry, times, kNames, cam_from_body);
  EXPECT_LT((walk.frames[1].cam_from_odometry.OriginInSource() - Eigen::Vector3d(1, -2, 0)).norm(),
            1e-12);
}

TEST_F(ReadWalkTest, NumbersInNamesAreTheOrder) {
  const path odometry = Written("numbers.txt",
                                "a/img_10.jpg 1 0 0 0 0 0 0\na/img_9.jpg 1 0 0 0 1 0 0\n"
                                "a/img_011.jpg 1 0 0 0 2 0 0\nB/img_12.jpg 1 0 0 0 3 0 0\n");
  const std::vector<std::string> names = {"a/img_10.jpg", "a/img_011.jpg", "B/img_12.jpg",
                                          "a/img_9.jpg"};
  EXPECT_THAT(QueriesOf(ReadWalk(odometry, {}, names)), ElementsAre(2, 3, 0, 1));
}

TEST_F(ReadWalkTest, WhatIsNoWalkIsRefused) {
  const path times = Written("times.txt", "a.jpg 1.0\nb.jpg 1.1\nc.jpg 1.2\n");
  const auto fails = [&](const std::string& text, const path& with_times,
                         const std::vector<std::string>& parts) {
    const path odometry = Written("bad.txt", text);
    return FailsWithInputError([&] { ReadWalk(odometry, with_times, kNames); }, parts);
  };
  EXPECT_TRUE(fails("", times, {"bad.txt", "expected poses, found none"}));
  EXPECT_TRUE(fails("1.0 0 0 0 0 0 0 1\n0.9 1 0 0 0 0 0 1\n", times,
                    {"line 2", "expected a time after 1, found 0.9"}));
  EXPECT_TRUE(fails("1.0 0 0 0 0 0 0 1\n1.0 1 0 0 0 0 0 1\n", times, {"line 2", "after 1"}));
  EXPECT_TRUE(fails("1.0 0 0 0 0 0 0 1\n1.1 1 0 0 0 0 0\n", times, {"line 2", "qx qy qz qw"}));
  EXPECT_TRUE(fails("1.0 0 0 0 0 0 0 2\n", times, {"line 1", "quaternion of length 1"}));
  EXPECT_TRUE(fails("1.0 0 0 nan 0 0 0 1\n", times, {"line 1", "tx ty tz"}));
  EXPECT_TRUE(fails(kThreePoses, {}, {"bad.txt", "neither a list of times nor names"}));
  EXPECT_TRUE(
      fails("7 0 0 0 0 0 0 1\n8 1 0 0 0 0 0 1\n", times, {"as a.jpg at 1 s", "found 7 to 8 s"}));
  EXPECT_TRUE(fails("1.0 0 0 0 0 0 0 1\n", times, {"two photographs at least, found 1 of 3"}));
  EXPECT_TRUE(fails("1.0 5 0 0 0 0 0 1\n1.1 5 0 0 0 0 0 1\n1.2 5 0 0 0 0 0 1\n", times,
                    {"no motion", "3 photographs"}));
  EXPECT_TRUE(fails("a.jpg 1 0 0 0 0 0 0\na.jpg 1 0 0 0 1 0 0\n", times, {"a.jpg stands twice"}));
  EXPECT_TRUE(fails(kThreePoses, Written("same_times.txt", "a.jpg 1.0\nb.jpg 1.1\nc.jpg 1.1\n"),
                    {"c.jpg and b.jpg have the same time, 1.1 s"}));
}

TEST_F(ReadWalkTest, AListHoldsSeveralWalks) {
  Written("one.txt", kThreePoses);
  Written("one_times.txt", "a.jpg 1.0\nb.jpg 1.1\n");
  Written("two.txt",
          "images/two/a.jpg 1 0 0 0 0 0 0\nimages/one/a.jpg 1 0 0 0 7 0 0\n"
          "two/b.jpg 1 0 0 0 1 0 0\ntwo/c.jpg 1 0 0 0 2 0 0\n");
  const path times = Written("times.txt", "two/a.jpg 3\ntwo/b.jpg 1\ntwo/c.jpg 2\none/a.jpg 9\n");
  const path list = Written("list.txt",
                            "# a walk a day\n"
                            "walk one/ one.txt one_times.txt\n"
                            "walk \"two\" two.txt\n");
  const auto names = Names(
      {"two/c.jpg", "one/a.jpg", "two/a.jpg", "one/b.jpg", "two/b.jpg", "other.jpg", "one.jpg"});
  const std::vector<Walk> walks = ReadWalks(list, times, names);
  ASSERT_EQ(walks.size(), 2U);
  EXPECT_EQ(walks[0].folder, "one/");
  EXPECT_THAT(QueriesOf(walks[0]), ElementsAre(1, 3));
  EXPECT_EQ(walks[0].frames[1].time_s, 1.1);
  EXPECT_EQ(walks[1].folder, "two/");
  EXPECT_THAT(QueriesOf(walks[1]), ElementsAre(4, 0, 2));
  EXPECT_EQ(walks[1].frames[2].cam_from_odometry.translation.x(), 0);
  EXPECT_THAT(walks[0].warnings, ElementsAre(HasSubstr("list.txt: 2 of 7 photographs are of no "
                                                       "walk, such as other.jpg")));
  EXPECT_TRUE(walks[1].warnings.empty());
  // What is no list is one walk.
  EXPECT_EQ(ReadWalks(Written("one.txt", kThreePoses),
                      Written("of_one.txt",
                              "one/a.jpg 1.0\n"
                              "one/b.jpg 1.1\n"),
                      names)
                .front()
                .frames.size(),
            2U);

  const auto fails = [&](const std::string& text, const std::vector<std::string>& parts) {
    return FailsWithInputError([&] { ReadWalks(Written("list.txt", text), times, names); }, parts);
  };
  // What one walk's photographs lack is not taken from another's, and what odometry tells itself
  // goes before the times of all.
  Written("both.txt",
          "one/a.jpg 1 0 0 0 1 0 0\none/b.jpg 1 0 0 0 2 0 0\ntwo/a.jpg 1 0 0 0 3 0 0\n"
          "two/c.jpg 1 0 0 0 4 0 0\n");
  Written("a phone's odometry of one afternoon.jsonl",
          "{\"timestamp\": 7, \"name\": \"a.jpg\", "
          "\"transform\": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}\n"
          "{\"timestamp\": 8, \"name\": \"b.jpg\", "
          "\"transform\": [[1,0,0,1],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}\n");
  const std::vector<Walk> shared =
      ReadWalks(Written("shared.txt",
                        "walk two both.txt\n"
                        "walk one/ \"a phone's odometry of one afternoon.jsonl\"\n"),
                times, names);
  EXPECT_THAT(QueriesOf(shared[0]), ElementsAre(0, 2));
  EXPECT_THAT(shared[0].warnings.front(),
              HasSubstr("no pose of 1 of 3 photographs, such as two/b"));
  ASSERT_THAT(QueriesOf(shared[1]), ElementsAre(1, 3));
  EXPECT_EQ(shared[1].frames[0].time_s, 7);

  // Nor where that lies in other folders.
  const path others =
      Written("others.txt", "images/two/a.jpg 1 0 0 0 1 0 0\nimages/two/b.jpg 1 0 0 0 2 0 0\n");
  EXPECT_EQ(ReadWalks(Written("shared.txt", "walk two others.txt\n"), {}, names)[0].frames.size(),
            2U);
  EXPECT_TRUE(FailsWithInputError(
      [&] {
        ReadWalks(Written("shared.txt", "walk one others.txt\nwalk two others.txt\n"), {}, names);
      },
      {others.string(), "found 0 of 2"}));

  const std::string one = "walk one one.txt one_times.txt\n";
  EXPECT_TRUE(fails(one + "one/a.jpg 1 0 0 0 0 0 0\n", {"list.txt", "line 2", "walk FOLDER"}));
  EXPECT_TRUE(fails(one + "walk two\n", {"line 2", "ODOMETRY"}));
  EXPECT_TRUE(fails("walk two two.txt times.txt 3\n", {"line 1"}));
  EXPECT_TRUE(fails("walk / two.txt\n", {"line 1", "expected the folder"}));
  EXPECT_TRUE(fails(one + "walk one/late two.txt\n", {"line 2", "one/ and one/late/"}));
  EXPECT_TRUE(fails("walk three two.txt\n",
                    {"list.txt", "line 1", "starts with three/, such a name is two/c"}));
  EXPECT_TRUE(fails("walk two none.txt\n", {"none.txt", "no such file"}));
  EXPECT_TRUE(fails("walk two two.txt one_times.txt.\n", {"one_times.txt.", "no such file"}));
  Written("one_times.txt", "d.jpg 1.0\n");
  EXPECT_TRUE(fails(one, {"one_times.txt", "expected times of photographs", "one/a.jpg"}));
}

TEST_F(ReadWalkTest, TurningAloneIsMotion) {
  const path odometry = Written("turn.txt",
                                "a.jpg 1 0 0 0 0 0 0\n"
                                "b.jpg 0.999 0.0447 0 0 0 0 0\n");
  EXPECT_EQ(ReadWalk(odometry, {}, kNames).frames.size(), 2U);
}

}  // namespace
}  // namespace raylift
