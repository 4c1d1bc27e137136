// Localizing, comparing and experiments are the same stages: a source of geometry sees the same
// calls from all three.

#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <utility>

#include "support/room_scene.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/comparison/localization_comparison.h"
#include "raylift/experiment/experiment.h"
#include "raylift/experiment/run_cells.h"
#include "raylift/io/query_list.h"
#include "raylift/localization/localize_all.h"
#include "raylift/localization/match_source.h"

namespace raylift {
namespace {

// Of which reference how many pixels were asked, each time.
using Calls = std::multiset<std::pair<std::string, size_t>>;

class CountingSource final : public GeometrySource {
 public:
  CountingSource(std::shared_ptr<const GeometrySource> source, Calls& calls)
      : source_(std::move(source)), calls_(calls) {}
  std::string Description() const override { return source_->Description(); }
  std::vector<std::optional<SurfacePoint>> Lift(
      const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const override {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      calls_.emplace(reference.name, pixels.size());
    }
    return source_->Lift(reference, pixels);
  }

 private:
  std::shared_ptr<const GeometrySource> source_;
  Calls& calls_;
  mutable std::mutex mutex_;
};

WrapSource Counting(Calls& calls) {
  return [&calls](std::shared_ptr<const GeometrySource> source) {
    return std::make_shared<const CountingSource>(std::move(source), calls);
  };
}

class OnePipeline : public ::testing::TestWithParam<FilterMode> {
 protected:
  Scene Open(Calls& calls) const {
    return OpenScene({.model = room_.model(),
                      .geometry = {"mesh:" + room_.mesh().string()},
                      .wrap_source = Counting(calls)});
  }
  std::shared_ptr<MatchSource> Matches(const Scene& scene) const {
    return OpenMatches(scene, queries_, matching_);
  }

  Calls OfLocalize() const {
    Calls calls;
    const Scene scene = Open(calls);
    LocalizerOptions options;
    options.estimator.method = Method::kP3p;
    options.filter.mode = GetParam();
    // Comparisons align nothing unless asked.
    const LocalizeAllOptions batch = {
        .localizer = options, .align = AlignMode::kOff, .check_input = false};
    LocalizeAll(scene, queries_, Matches(scene), batch).Run();
    return calls;
  }

  Calls OfCompare() const {
    Calls calls;
    const Scene scene = Open(calls);
    LocalizationGrid grid;
    for (const Method method : {Method::kP3p, Method::kE5p1, Method::kAdaptive}) {
      grid.methods.push_back({.method = method});
    }
    grid.filters = {GetParam()};
    grid.thresholds = {{0.1, 1}};
    PosesByName truth;
    for (const PosedImage& query : room_.queries) truth.emplace(query.name, query.cam_from_world);
    CompareLocalization(scene, queries_, Matches(scene), {}, truth, grid);
    return calls;
  }

  Calls OfExperiment() const {
    Calls calls;
    const auto file = room_.folder / "experiment.toml";
    WriteFile(file, R"(
[scenes.room]
model = "model"
queries = "queries.txt"
features = "features.h5"
matches = "matches.h5"
pairs = "pairs.txt"
top_k = 10
ground_truth = "truth"
thresholds = "0.1,1"
[scenes.room.geometry]
mesh = "mesh:room.obj"
[[grid]]
method = ["p3p", "e5p1", "adaptive"]
filter = [")" + std::string(ToString(GetParam())) +
                        "\"]\n");
    const Experiment experiment = ReadExperiment(file, [](const auto&) { return std::nullopt; });
    const auto settings = ExpandGrid(experiment);
    RunCells(experiment, ListCells(experiment, settings), CellStore(room_.folder / "cells"),
             {.cache = room_.folder / "cache", .wrap_source = Counting(calls)});
    return calls;
  }

  RoomScene room_ = WriteRoomScene(TestFolder());
  std::vector<Query> queries_ = ReadQueryList(room_.query_list());
  MatchingOptions matching_{.hloc = HlocFiles{room_.features(), room_.matches(), room_.pairs()}};
};

TEST_P(OnePipeline, AllCommandsMakeTheSameCalls) {
  const Calls of_localize = OfLocalize();
  EXPECT_GE(of_localize.size(), room_.queries.size() * room_.references.size());
  EXPECT_EQ(OfCompare(), of_localize);
  EXPECT_EQ(OfExperiment(), of_localize);
}

INSTANTIATE_TEST_SUITE_P(Filters, OnePipeline,
                         ::testing::Values(FilterMode::kOff, FilterMode::kFixed, FilterMode::kAuto),
                         [](const auto& of) { return std::string(ToString(of.param)); });

}  // namespace
}  // namespace raylift
