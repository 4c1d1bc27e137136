#include "raylift/evaluation/pose_errors.h"

#include <numbers>

#include "support/matchers.h"
#include <gmock/gmock.h>

namespace raylift {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

Rigid3 PoseAt(const Eigen::Vector3d& center, const Eigen::Vector3d& rotation_vector) {
  const Eigen::Quaterniond rotation = RotationFromVector(rotation_vector);
  return {rotation, -(rotation * center)};
}

// A pose whose position is wrong by `error`.
Rigid3 Shifted(double error) { return PoseAt({error, 0, 0}, {0, 0, 0}); }

TEST(ComparePoses, MeasuresCentersAndAngle) {
  const Rigid3 truth = PoseAt({1, 2, 3}, {0.3, -0.2, 0.1});
  Rigid3 estimate = PoseAt({1, 2.3, 3.4}, {0.3, -0.2, 0.1});
  estimate.rotation =
      Eigen::Quaterniond(Eigen::AngleAxisd(0.01, Eigen::Vector3d::UnitY())) * estimate.rotation;
  estimate.translation = -(estimate.rotation * Eigen::Vector3d(1, 2.3, 3.4));
  const PoseError error = ComparePoses(estimate, truth);
  EXPECT_NEAR(error.position, 0.5, 1e-14);
  EXPECT_NEAR(error.rotation_deg, 0.01 * 180 / std::numbers::pi, 1e-12);
}

TEST(ComparePoses, DoesNotDependOnTheWorldFrame) {
  Rng rng = TestRng();
  const Rigid3 truth = RandomRigid3(rng, 3);
  const Rigid3 estimate = RandomRigid3(rng, 3);
  const PoseError error = ComparePoses(estimate, truth);
  const Rigid3 world_from_other = RandomRigid3(rng, 1000);
  const PoseError moved = ComparePoses(estimate * world_from_other, truth * world_from_other);
  EXPECT_NEAR(error.position, moved.position, 1e-11);
  EXPECT_NEAR(error.rotation_deg, moved.rotation_deg, 1e-11);
}

TEST(ComparePoses, IgnoresTheQuaternionsSign) {
  const Rigid3 truth = PoseAt({1, 2, 3}, {0.3, -0.2, 0.1});
  const Rigid3 same = {Eigen::Quaterniond(-truth.rotation.coeffs()), truth.translation};
  EXPECT_EQ(ComparePoses(same, truth).rotation_deg, 0);
}

TEST(Comparison, CountsEveryQueryOfTheGroundTruth) {
  const PosesByName truth = {{"a", Shifted(0)}, {"b", Shifted(0)}, {"c", Shifted(0)}};
  Rigid3 broken = Shifted(0);
  broken.translation.x() = std::nan("");
  const PosesByName estimated = {{"b", Shifted(0.5)}, {"c", broken}, {"d", Shifted(0)}};
  const Comparison comparison = CompareWithGroundTruth(truth, estimated);
  ASSERT_EQ(comparison.queries.size(), 3u);
  EXPECT_EQ(comparison.queries[0].name, "a");
  EXPECT_FALSE(comparison.queries[0].error);
  ASSERT_TRUE(comparison.queries[1].error);
  EXPECT_EQ(comparison.queries[1].error->position, 0.5);
  EXPECT_FALSE(comparison.queries[2].error);
  EXPECT_THAT(comparison.unknown_names, ElementsAre("d"));
  EXPECT_FALSE(comparison.uses_ground_truth);
}

TEST(Comparison, MatchesHlocsShortenedNames) {
  const PosesByName truth = {{"day/seq-01/a.png", Shifted(0)}, {"day/seq-02/b.png", Shifted(0)}};
  for (const char* name : {"day/seq-01/a.png", "seq-01/a.png", "a.png"}) {
    const Comparison comparison = CompareWithGroundTruth(truth, {{name, Shifted(1)}});
    EXPECT_TRUE(comparison.queries[0].error) << name;
    EXPECT_FALSE(comparison.queries[1].error) << name;
    EXPECT_THAT(comparison.unknown_names, IsEmpty()) << name;
  }
}

TEST(Comparison, RefusesAmbiguousNames) {
  const PosesByName truth = {{"x/a.png", Shifted(0)}, {"y/a.png", Shifted(0)}};
  const Comparison one_for_two = CompareWithGroundTruth(truth, {{"a.png", Shifted(1)}});
  EXPECT_FALSE(one_for_two.queries[0].error);
  EXPECT_FALSE(one_for_two.queries[1].error);
  EXPECT_THAT(one_for_two.unknown_names, ElementsAre("a.png"));

  const Comparison two_for_one = CompareWithGroundTruth(
      {{"p/x/a.png", Shifted(0)}}, {{"a.png", Shifted(1)}, {"x/a.png", Shifted(2)}});
  EXPECT_FALSE(two_for_one.queries[0].error);
  EXPECT_THAT(two_for_one.unknown_names, ElementsAre("a.png", "x/a.png"));

  // The end of a name starts at a slash; exact names come first.
  const Comparison part =
      CompareWithGroundTruth({{"x/aa.png", Shifted(0)}}, {{"a.png", Shifted(1)}});
  EXPECT_FALSE(part.queries[0].error);
  const Comparison exact = CompareWithGroundTruth({{"x/a.png", Shifted(0)}},
                                                  {{"a.png", Shifted(1)}, {"x/a.png", Shifted(2)}});
  EXPECT_EQ(exact.queries[0].error.value().position, 2);
  EXPECT_THAT(exact.unknown_names, ElementsAre("a.png"));
}

TEST(Comparison, SplitsByGroup) {
  const PosesByName truth = {{"a", Shifted(0)}, {"b", Shifted(0)}, {"c", Shifted(0)}};
  const PosesByName estimated = {{"a", Shifted(1)}, {"c", Shifted(2)}, {"unknown", Shifted(0)}};
  const auto groups = SplitByGroup(CompareWithGroundTruth(truth, estimated),
                                   {{"a", "day"}, {"b", "day"}, {"elsewhere", "dawn"}});
  ASSERT_EQ(groups.size(), 1u);
  const Comparison& day = groups.at("day");
  ASSERT_EQ(day.queries.size(), 2u);
  EXPECT_EQ(day.queries[0].name, "a");
  EXPECT_NEAR(day.queries[0].error->position, 1, 1e-12);
  EXPECT_FALSE(day.queries[1].error.has_value());
  EXPECT_THAT(day.unknown_names, IsEmpty());
}

TEST(Oracle, TakesTheSmallerMaximumOfCentimetersAndDegrees) {
  const PosesByName truth = {
      {"a", Shifted(0)}, {"b", Shifted(0)}, {"c", Shifted(0)}, {"d", Shifted(0)}};
  const double deg = std::numbers::pi / 180;
  const PosesByName p3p = {{"a", Shifted(0.03)},                          // max(3 cm, 0 deg)
                           {"b", PoseAt({0.01, 0, 0}, {0, 0, 2 * deg})},  // max(1 cm, 2 deg)
                           {"c", Shifted(1)}};
  const PosesByName e5p1 = {{"a", PoseAt({0.01, 0, 0}, {0, 0, 4 * deg})},  // max(1 cm, 4 deg)
                            {"b", Shifted(0.015)},                         // max(1.5 cm, 0 deg)
                            {"d", Shifted(2)}};
  Comparison a = CompareWithGroundTruth(truth, p3p);
  const Comparison b = CompareWithGroundTruth(truth, e5p1);
  for (const bool swapped : {false, true}) {
    const Comparison oracle = swapped ? ChooseByOracle(b, a) : ChooseByOracle(a, b);
    EXPECT_TRUE(oracle.uses_ground_truth);
    EXPECT_DOUBLE_EQ(oracle.queries[0].error.value().position, 0.03);
    EXPECT_DOUBLE_EQ(oracle.queries[1].error.value().position, 0.015);
    EXPECT_DOUBLE_EQ(oracle.queries[2].error.value().position, 1);
    EXPECT_DOUBLE_EQ(oracle.queries[3].error.value().position, 2);
  }
  // In a scene of millimeters 0.03 units are 0.003 cm, so that degrees decide.
  EXPECT_DOUBLE_EQ(ChooseByOracle(a, b, 0.1).queries[0].error.value().position, 0.03);
  EXPECT_DOUBLE_EQ(ChooseByOracle(a, b, 1000).queries[0].error.value().position, 0.01);
  a.queries.pop_back();
  EXPECT_THROW(ChooseByOracle(a, b), std::logic_error);
}

}  // namespace
}  // namespace raylift
