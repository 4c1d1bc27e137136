#include <chrono>

#include "service/problem.h"
#include "service/walks.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/file.h"

namespace raylift {
namespace {

constexpr WalkTokens::Time kNow(std::chrono::hours(500'000));
constexpr uint64_t kScene = 7;

ServedWalk MakeServedWalk() {
  Rng rng = TestRng();
  constexpr double kExtent = 5;
  ServedWalk walk{.scale = OdometryScale::kUnknown, .state = {.last_time_s = 0.1}};
  for (int i = 0; i < 3; ++i) {
    WalkEvidence frame{RandomRigid3(rng, kExtent), {}, {0.5 * i, 0.1}};
    for (int k = 0; k < i; ++k) {
      frame.singles.push_back(
          {RandomRigid3(rng, kExtent), Eigen::Matrix<double, 6, 6>::Random(), 0.25 * i});
    }
    walk.state.frames.push_back(frame);
  }
  return walk;
}

// The status of the refusal; 200 where it is taken.
int StatusOf(const WalkTokens& tokens, std::string_view token, uint64_t scene = kScene,
             WalkTokens::Time now = kNow) {
  try {
    tokens.Open(token, scene, now);
    return 200;
  } catch (const Problem& problem) {
    EXPECT_EQ(problem.field(), "session.token");
    return problem.status();
  }
}

TEST(WalkTokens, HoldAWalkToTheBit) {
  const WalkTokens tokens("");
  const ServedWalk walk = MakeServedWalk();
  const ServedWalk opened = tokens.Open(tokens.Seal(walk, kScene, kNow), kScene, kNow);
  EXPECT_EQ(opened.scale, walk.scale);
  EXPECT_EQ(opened.state.last_time_s, walk.state.last_time_s);
  ASSERT_EQ(opened.state.frames.size(), walk.state.frames.size());
  for (size_t i = 0; i < walk.state.frames.size(); ++i) {
    const WalkEvidence &a = opened.state.frames[i], &b = walk.state.frames[i];
    EXPECT_EQ(a.cam_from_odometry.rotation.coeffs(), b.cam_from_odometry.rotation.coeffs());
    EXPECT_EQ(a.cam_from_odometry.translation, b.cam_from_odometry.translation);
    EXPECT_EQ(a.since_before.way, b.since_before.way);
    EXPECT_EQ(a.since_before.turn_deg, b.since_before.turn_deg);
    ASSERT_EQ(a.singles.size(), b.singles.size());
    for (size_t k = 0; k < a.singles.size(); ++k) {
      EXPECT_EQ(a.singles[k].cam_from_world.translation, b.singles[k].cam_from_world.translation);
      EXPECT_EQ(a.singles[k].covariance, b.singles[k].covariance);
      EXPECT_EQ(a.singles[k].confidence, b.singles[k].confidence);
    }
  }
}

TEST(WalkTokens, AreOfOneKeyOneSceneAndOneHour) {
  const auto key = TestFolder() / "key";
  WriteFile(key, std::string(32, 'k'));
  const WalkTokens tokens(key), replica(key), stranger("");
  const std::string token = tokens.Seal(MakeServedWalk(), kScene, kNow);
  EXPECT_EQ(StatusOf(replica, token), 200);
  EXPECT_EQ(StatusOf(stranger, token), 400);
  EXPECT_EQ(StatusOf(tokens, token, kScene + 1), 409);
  EXPECT_EQ(StatusOf(tokens, token, kScene, kNow + std::chrono::minutes(59)), 200);
  EXPECT_EQ(StatusOf(tokens, token, kScene, kNow + std::chrono::minutes(61)), 410);
}

TEST(WalkTokens, AreRefusedWhereAnyByteIsAnother) {
  const WalkTokens tokens("");
  const std::string token = tokens.Seal(MakeServedWalk(), kScene, kNow);
  for (size_t i = 0; i + 4 < token.size(); ++i) {  // some of the last bits are no byte's
    std::string forged = token;
    forged[i] = forged[i] == 'A' ? 'B' : 'A';
    EXPECT_EQ(StatusOf(tokens, forged), 400) << i;
    if (i % 7 == 0) {
      EXPECT_EQ(StatusOf(tokens, token.substr(0, i)), 400) << i;
    }
  }
}

TEST(WalkTokens, NeedAKeyThatIsNoPassword) {
  const auto key = TestFolder() / "key";
  WriteFile(key, "secret\n");
  EXPECT_TRUE(FailsWithInputError([&] { WalkTokens tokens(key); }, {"key", "32 bytes", "found 7"}));
}

}  // namespace
}  // namespace raylift
