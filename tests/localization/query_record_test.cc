// What a run's manifest keeps of a query, back from its line.

#include "base/rng.h"
#include "localization/results/query_job.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "raylift/localization/result_files.h"

namespace raylift {
namespace {

Camera LensCamera() {
  const double params[] = {501.3, 499.1, 320, 240, 0.1, -0.01, 1e-3, 0};
  return Camera(CameraModel::kOpenCv, 640, 480, params);
}

const std::vector<Query> kQueries = {{"day.png", LensCamera()},
                                     {"night/caf\xe9.png", LensCamera()}};

// Of the second query, which has become a reference.
QueryRecord RandomRecord(Rng& rng) {
  QueryRecord record;
  LocalizedQuery& query = record.localized;
  query.name = kQueries[1].name;
  query.counts.retrieved = 10;
  query.counts.points_of_source = {3, 4};
  query.counts.inliers_2d2d = 77;
  query.times.match_ms = 0.1;
  const Rigid3 pose{RotationFromVector({rng.Normal(), rng.Normal(), rng.Normal()}),
                    {rng.Normal(), -0.0, rng.Normal()}};
  query.estimate.cam_from_world = pose;
  query.estimate.position_observable = false;
  record.diagnostics = FormatQueryDiagnostics(query);
  record.joined = {.image = {query.name, LensCamera(), pose},
                   .covariance = PoseCovariance::Zero(),
                   .distance = 1.0 / 3,
                   .links = {}};
  for (int i = 0; i < 36; ++i) record.joined->covariance->data()[i] = 1e-7 * rng.Normal();
  for (int i = 0; i < 5; ++i) {
    record.joined->links.push_back(
        {{rng.Uniform(0, 640), rng.Uniform(0, 480)}, {rng.Normal(), rng.Normal(), 1e6}});
  }
  return record;
}

TEST(QueryRecord, ReadsBackAsTheSameNumbers) {
  Rng rng = TestRng();
  const QueryRecord record = RandomRecord(rng);
  const std::filesystem::path folder = TestFolder() / "run";
  const auto open = [&] {
    return QueryJob(kQueries, R"({"command": "localize"})", {.out = folder, .resume = true});
  };
  {
    QueryJob job = open();
    job.Begin({});
    LocalizedQuery other;
    other.name = kQueries[0].name;
    other.reason = "no retrieved references";
    job.Add(0, {.diagnostics = FormatQueryDiagnostics(other)});
    job.Add(1, record);
  }
  QueryJob job = open();
  EXPECT_TRUE(job.Missing().empty());
  const auto joined = job.Joined();
  ASSERT_TRUE(joined.at(1).has_value());
  EXPECT_EQ(joined.at(0), std::nullopt);
  const QueryRecord read = job.Whole().value()[1];
  EXPECT_EQ(read.diagnostics, record.diagnostics);
  EXPECT_EQ(read.localized.name, record.localized.name);
  EXPECT_EQ(read.localized.counts.points_of_source, (std::vector<size_t>{3, 4}));
  EXPECT_EQ(read.localized.counts.inliers_2d2d, 77u);
  EXPECT_FALSE(read.localized.estimate.position_observable);
  EXPECT_TRUE(IsNearPose(*read.localized.estimate.cam_from_world,
                         *record.localized.estimate.cam_from_world, 0, 0));
  const JoinedReference& a = *joined.at(1);
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
}

TEST(QueryRecord, AReferenceThatLacksSomethingIsNoLine) {
  Rng rng = TestRng();
  const std::string line = ToJsonLine(RandomRecord(rng));
  EXPECT_TRUE(IsReadableLine(line));
  for (const char* member : {"camera", "cam_from_world", "covariance", "links", "distance"}) {
    auto json = nlohmann::ordered_json::parse(line);
    json["joined"].erase(member);
    EXPECT_FALSE(IsReadableLine(json.dump())) << member;
  }
}

}  // namespace
}  // namespace raylift
