#include "base/rng.h"
#include "localization/continuous/checkpoint.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "raylift/base/file.h"
#include "raylift/localization/result_files.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

Camera LensCamera() {
  const double params[] = {501.3, 499.1, 320, 240, 0.1, -0.01, 1e-3, 0};
  return Camera(CameraModel::kOpenCv, 640, 480, params);
}

const Query kQuery{"night/caf\xe9.png", LensCamera()};

ContinuousRecord RandomRecord(Rng& rng) {
  LocalizedQuery query;
  query.name = kQuery.name;
  query.counts.retrieved = 10;
  query.counts.points_of_source = {3, 4};
  query.counts.inliers_2d2d = 77;
  query.times.match_ms = 0.1;
  const Rigid3 pose{RotationFromVector({rng.Normal(), rng.Normal(), rng.Normal()}),
                    {rng.Normal(), -0.0, rng.Normal()}};
  query.estimate.cam_from_world = pose;
  JoinedReference joined{.image = {kQuery.name, LensCamera(), pose},
                         .covariance = PoseCovariance::Zero(),
                         .distance = 1.0 / 3,
                         .links = {}};
  for (int i = 0; i < 36; ++i) joined.covariance->data()[i] = 1e-7 * rng.Normal();
  for (int i = 0; i < 5; ++i) {
    joined.links.push_back(
        {{rng.Uniform(0, 640), rng.Uniform(0, 480)}, {rng.Normal(), rng.Normal(), 1e6}});
  }
  return {query, FormatQueryDiagnostics(query), joined};
}

TEST(ContinuousCheckpoint, RecordsReadBackAsTheSameNumbers) {
  Rng rng = TestRng();
  const fs::path folder = TestFolder() / "continuous";
  const ContinuousCheckpoint checkpoint(folder, "key", false);
  const ContinuousRecord record = RandomRecord(rng);
  checkpoint.Write(3, record);
  EXPECT_EQ(checkpoint.Read(2, kQuery), std::nullopt);
  const auto read = ContinuousCheckpoint(folder, "key", true).Read(3, kQuery);
  ASSERT_TRUE(read && read->joined);
  EXPECT_EQ(read->diagnostics, record.diagnostics);
  EXPECT_EQ(read->localized.name, record.localized.name);
  EXPECT_EQ(read->localized.counts.points_of_source, (std::vector<size_t>{3, 4}));
  EXPECT_EQ(read->localized.counts.inliers_2d2d, 77u);
  EXPECT_TRUE(IsNearPose(*read->localized.estimate.cam_from_world,
                         *record.localized.estimate.cam_from_world, 0, 0));
  const JoinedReference& a = *read->joined;
  const JoinedReference& b = *record.joined;
  EXPECT_EQ(a.image.name, b.image.name);
  EXPECT_EQ(a.image.camera, b.image.camera);
  EXPECT_EQ(a.image.cam_from_world.rotation.coeffs(), b.image.cam_from_world.rotation.coeffs());
  EXPECT_EQ(a.image.cam_from_world.translation, b.image.cam_from_world.translation);
  EXPECT_EQ(*a.covariance, *b.covariance);
  EXPECT_EQ(a.distance, b.distance);
  ASSERT_EQ(a.links.size(), b.links.size());
  for (size_t i = 0; i < a.links.size(); ++i) {
    EXPECT_EQ(a.links[i].pixel, b.links[i].pixel);
    EXPECT_EQ(a.links[i].point_in_world, b.links[i].point_in_world);
  }
  // Written again, the same bytes.
  checkpoint.Write(4, *read);
  EXPECT_EQ(ReadFile(folder / "000004.json"), ReadFile(folder / "000003.json"));
}

TEST(ContinuousCheckpoint, ANewRunRemovesWhatAnOldOneLeft) {
  Rng rng = TestRng();
  const fs::path folder = TestFolder() / "continuous";
  ContinuousCheckpoint(folder, "key", false).Write(0, RandomRecord(rng));
  WriteFile(folder / "notes.txt", "mine");
  EXPECT_TRUE(ContinuousCheckpoint(folder, "key", true).Read(0, kQuery));
  EXPECT_FALSE(ContinuousCheckpoint(folder, "key", false).Read(0, kQuery));
  EXPECT_TRUE(fs::exists(folder / "notes.txt"));
}

TEST(ContinuousCheckpoint, ARunWithOtherOptionsDoesNotGoOn) {
  const fs::path folder = TestFolder() / "continuous";
  const ContinuousCheckpoint first(folder, "key", false);
  EXPECT_TRUE(FailsWithInputError([&] { ContinuousCheckpoint(folder, "another", true); },
                                  {"run.json", "other options"}));
}

TEST(ContinuousCheckpoint, MalformedRecordsAreNamed) {
  Rng rng = TestRng();
  const fs::path folder = TestFolder() / "continuous";
  const ContinuousCheckpoint checkpoint(folder, "key", false);
  checkpoint.Write(0, RandomRecord(rng));
  const std::string whole = ReadFile(folder / "000000.json");
  const auto fails = [&](const std::string& text, const std::vector<std::string>& parts) {
    WriteFile(folder / "000000.json", text);
    EXPECT_TRUE(FailsWithInputError([&] { checkpoint.Read(0, kQuery); }, parts)) << text;
  };
  fails(whole.substr(0, whole.size() / 2), {"000000.json"});
  fails("{}", {"000000.json", "format"});
  fails(R"({"format": "raylift-continuous/2"})", {"000000.json", "diagnostics"});
  fails(R"({"format": "another/1"})", {"000000.json", "raylift-continuous/2"});
  for (const char* member : {"camera", "covariance", "links", "distance"}) {
    auto json = nlohmann::ordered_json::parse(whole);
    json["joined"][member] = "x";
    fails(json.dump(), {"000000.json"});
  }
  WriteFile(folder / "000000.json", whole);
  EXPECT_TRUE(FailsWithInputError(
      [&] {
        checkpoint.Read(0, {"another", LensCamera()});
      },
      {"000000.json", "another"}));
}

}  // namespace
}  // namespace raylift
