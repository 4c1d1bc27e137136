#include "localization/continuous/continuous_localizer.h"

#include <atomic>
#include <map>

#include "localization/matching/file_matches.h"
#include "localization/results/query_job.h"
#include "support/match_file.h"
#include "support/matchers.h"
#include "support/room_scene.h"
#include "support/test_data.h"
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "raylift/base/file.h"
#include "raylift/io/hloc_files.h"
#include "raylift/io/query_list.h"
#include "raylift/localization/scene.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

using Pairs = std::vector<std::pair<std::string, std::string>>;

// A mesh that lifts the pixels of references alone, as depth maps of theirs would.
class ReferencesOnly final : public GeometrySource {
 public:
  explicit ReferencesOnly(std::shared_ptr<const GeometrySource> mesh) : mesh_(std::move(mesh)) {}
  std::string Description() const override { return mesh_->Description(); }
  std::vector<std::optional<SurfacePoint>> Lift(
      const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const override {
    if (reference.name.starts_with("ref/")) return mesh_->Lift(reference, pixels);
    return std::vector<std::optional<SurfacePoint>>(pixels.size());
  }

 private:
  std::shared_ptr<const GeometrySource> mesh_;
};

class ContinuousLocalizer : public ::testing::Test {
 protected:
  // b is matched with a alone, a with the references.
  ContinuousLocalizer() {
    AddMatchesBetweenQueries();
    Pairs pairs = {{"query/b.png", "query/a.png"}};
    for (const PosedImage& reference : scene_.references) {
      pairs.emplace_back("query/a.png", reference.name);
    }
    WritePairs(scene_.pairs(), pairs);
  }

  // To the matches that both queries have with the references, those that follow between them.
  void AddMatchesBetweenQueries() {
    std::vector<MatchedPair> all;
    std::map<int, std::pair<int, float>> b_of_a;
    {
      const MatchFile file(scene_.matches());
      for (const PosedImage& reference : scene_.references) {
        std::map<int, int> a_of_reference;
        const auto of_a = file.Read("query/a.png", reference.name).value();
        const auto of_b = file.Read("query/b.png", reference.name).value();
        for (const FeatureMatch& match : of_a) {
          a_of_reference.emplace(match.reference_index, match.query_index);
        }
        for (const FeatureMatch& match : of_b) {
          const auto a = a_of_reference.find(match.reference_index);
          if (a != a_of_reference.end()) b_of_a[a->second] = {match.query_index, 1.0f};
        }
        all.push_back({"query/a.png", reference.name, 5000, of_a});
      }
    }
    all.push_back({"query/a.png", "query/b.png", 5000, {}});
    for (const auto& [a, b] : b_of_a) all.back().matches.push_back({a, b.first, b.second});
    WriteMatchFile(scene_.matches(), all);
  }

  // Stops after so many queries, and returns nothing then.
  std::vector<QueryRecord> Run(const fs::path& folder, bool resume = false, size_t stop_after = 9,
                               const JoinGateOptions& gate = {},
                               Refinement refinement = Refinement::kRobust) {
    const Scene scene = OpenScene({.model = scene_.model(),
                                   .geometry = {"mesh:" + scene_.mesh().string()},
                                   .wrap_source = [](std::shared_ptr<const GeometrySource> mesh) {
                                     return std::make_shared<const ReferencesOnly>(std::move(mesh));
                                   }});
    std::shared_ptr<MatchSource> source = OpenHlocMatches(
        {scene_.features(), scene_.matches(), scene_.pairs()}, scene.references, 10, {queries_, 5});
    LocalizerOptions options;
    options.estimator.method = Method::kP3p;
    options.estimator.refinement = refinement;
    QueryJob job(queries_, R"({"command": "localize"})", {.out = folder, .resume = resume});
    job.Begin({});
    const std::vector<size_t> order = OrderByName(queries_);
    std::atomic<bool> stop = false;
    size_t done = 0;
    LocalizeContinuously(
        queries_, scene, std::move(source), options,
        {.order = order,
         .done = job.Joined(),
         .gate = gate,
         .threads = 2,
         .stop = &stop,
         .on_localized = [&](size_t, QueryResult&) { ++localized_; },
         .on_done =
             [&](size_t i, const QueryResult& result, const JoinDecision& decision) {
               job.Add(i, {.localized = result.localized,
                           .diagnostics = decision.diagnostics,
                           .joined = decision.joined});
               stop = ++done >= stop_after;
             }});
    return job.Whole().value_or(std::vector<QueryRecord>());
  }

  RoomScene scene_ = WriteRoomScene(TestFolder());
  std::vector<Query> queries_ = ReadQueryList(scene_.query_list());
  int localized_ = 0;
};

TEST_F(ContinuousLocalizer, AQueryIsFoundThroughAnotherAndItsLinks) {
  const std::vector<QueryRecord> records = Run(scene_.folder / "out");
  ASSERT_EQ(records.size(), 2u);
  EXPECT_TRUE(records[0].joined.has_value());
  for (size_t i = 0; i < 2; ++i) {
    ASSERT_TRUE(records[i].localized.localized()) << records[i].localized.reason;
    EXPECT_TRUE(IsNearPose(*records[i].localized.estimate.cam_from_world,
                           scene_.queries[i].cam_from_world, 1e-3, 1e-4));
  }
  const auto b = nlohmann::json::parse(records[1].diagnostics);
  EXPECT_EQ(b["retrieved_joined"], 1);
  EXPECT_EQ(b["place_in_order"], 1);
  EXPECT_EQ(b["hit"], records[1].localized.counts.matched);
  // With one reference there is no E5+1.
  EXPECT_EQ(b["joined"], false);
  EXPECT_EQ(b["not_joined_because"], "P3P or E5+1 alone finds no pose");
}

TEST_F(ContinuousLocalizer, WhatTheGateKeepsOutIsNoReference) {
  const std::vector<QueryRecord> records =
      Run(scene_.folder / "out", false, 9, {.min_inliers_2d2d = 100000});
  EXPECT_TRUE(records[0].localized.localized());
  EXPECT_FALSE(records[0].joined.has_value());
  EXPECT_EQ(records[1].localized.reason, "no retrieved references");
}

TEST_F(ContinuousLocalizer, AsInThePaperThereIsNoGate) {
  const std::vector<QueryRecord> records =
      Run(scene_.folder / "out", false, 9, {.min_inliers_2d2d = 100000}, Refinement::kPaper);
  for (size_t i = 0; i < 2; ++i) {
    ASSERT_TRUE(records[i].localized.localized()) << records[i].localized.reason;
    ASSERT_TRUE(records[i].joined.has_value());
    EXPECT_EQ(nlohmann::json::parse(records[i].diagnostics)["not_joined_because"], "");
  }
}

TEST_F(ContinuousLocalizer, ARunThatWasStoppedGoesOnToTheSameBytes) {
  const fs::path whole = scene_.folder / "whole";
  const fs::path stopped = scene_.folder / "stopped";
  const std::vector<QueryRecord> expected = Run(whole);
  EXPECT_TRUE(Run(stopped, false, 1).empty());
  localized_ = 0;
  const std::vector<QueryRecord> records = Run(stopped, true);
  EXPECT_EQ(localized_, 1);
  for (size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(records[i].diagnostics, expected[i].diagnostics);
    EXPECT_TRUE(IsNearPose(*records[i].localized.estimate.cam_from_world,
                           *expected[i].localized.estimate.cam_from_world, 0, 0));
  }
  localized_ = 0;
  Run(stopped, true);
  EXPECT_EQ(localized_, 0);
}

TEST_F(ContinuousLocalizer, AThinnedOutReferenceMayComeBackAsAQuery) {
  ReferenceSet references = LoadReferences(scene_.model()).references;
  references.thinned_out.push_back("query/a.png");
  const auto source = OpenHlocMatches({scene_.features(), scene_.matches(), scene_.pairs()},
                                      references, 10, {queries_, 5});
  EXPECT_TRUE(source->Match(queries_[1]).references.empty());
  source->Join(scene_.queries[0]);
  EXPECT_EQ(source->Match(queries_[1]).references.size(), 1u);
}

TEST_F(ContinuousLocalizer, AQueryThatMayNotJoinIsAnErrorInThePairs) {
  EXPECT_TRUE(FailsWithInputError(
      [&] {
        OpenHlocMatches({scene_.features(), scene_.matches(), scene_.pairs()},
                        LoadReferences(scene_.model()).references, 10);
      },
      {scene_.pairs().string(), "query/a.png"}));
}

}  // namespace
}  // namespace raylift
