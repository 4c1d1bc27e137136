#include "raylift/sequences/walk.h"

#include <string>
#include <vector>

#include "support/matchers.h"
#include "support/test_data.h"
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

TEST_F(ReadWalkTest, TurningAloneIsMotion) {
  const path odometry = Written("turn.txt",
                                "a.jpg 1 0 0 0 0 0 0\n"
                                "b.jpg 0.999 0.0447 0 0 0 0 0\n");
  EXPECT_EQ(ReadWalk(odometry, {}, kNames).frames.size(), 2U);
}

}  // namespace
}  // namespace raylift
