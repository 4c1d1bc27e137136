#include "localization/grid_localizer.h"

#include <algorithm>
#include <optional>

#include "localization/scene_matches.h"

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"

namespace raylift {

GridLocalizer::GridLocalizer(std::vector<Localizer> ways) : ways_(std::move(ways)) {
  RAYLIFT_CHECK(!ways_.empty());
  for (size_t i = 0; i < ways_.size(); ++i) {
    const Localizer& way = ways_[i];
    RAYLIFT_CHECK(way.matches() == ways_.front().matches());
    auto lifted = std::find_if(tree_.begin(), tree_.end(), [&](const Lifted& alike) {
      return way.LiftsAlike(ways_[alike.filtered.front().ways.front()]);
    });
    if (lifted == tree_.end()) lifted = tree_.insert(tree_.end(), Lifted{});
    auto filtered = std::find_if(
        lifted->filtered.begin(), lifted->filtered.end(),
        [&](const Filtered& alike) { return way.FiltersAlike(ways_[alike.ways.front()]); });
    if (filtered == lifted->filtered.end()) {
      filtered = lifted->filtered.insert(lifted->filtered.end(), Filtered{});
    }
    filtered->ways.push_back(i);
  }
}

void GridLocalizer::Localize(const Query& query, int threads, const Take& take) const {
  Localize(ways_.front().Match(query), threads, take);
}

void GridLocalizer::Localize(const QueryResult& matched, int threads, const Take& take) const {
  for (const Lifted& lift : tree_) {
    QueryResult lifted = matched;
    ways_[lift.filtered.front().ways.front()].Lift(lifted);
    for (const Filtered& filter : lift.filtered) {
      QueryResult filtered = lifted;
      ways_[filter.ways.front()].Filter(filtered);
      ParallelFor(filter.ways.size(), threads, [&](size_t i) {
        QueryResult result = filtered;
        ways_[filter.ways[i]].Estimate(result);
        take(filter.ways[i], result);
      });
    }
  }
}

GridLocalizer GridLocalizer::WithSceneNoise(std::span<const Query> queries, Matched& matched,
                                            int threads) const {
  RAYLIFT_CHECK_EQ(matched.size(), queries.size());
  std::vector<size_t> learning;
  std::vector<Localizer> learners;
  for (size_t way = 0; way < ways_.size(); ++way) {
    if (!ways_[way].UsesSceneNoise()) continue;
    learning.push_back(way);
    learners.push_back(ways_[way]);
  }
  const std::vector<size_t> sample = NoiseSample(queries);
  if (learning.empty() || sample.size() < kLeastForCommonNoise) return *this;

  const GridLocalizer grid(learners);
  std::vector<std::vector<PoseEstimate>> found(learners.size(),
                                               std::vector<PoseEstimate>(sample.size()));
  ParallelFor(sample.size(), threads, [&](size_t i) {
    std::optional<QueryResult>& of_query = matched[sample[i]];
    if (!of_query) of_query = ways_.front().Match(queries[sample[i]]);
    grid.Localize(*of_query, 1, [&](size_t way, const QueryResult& result) {
      found[way][i] = result.localized.estimate;
    });
  });
  std::vector<Localizer> knowing = ways_;
  for (size_t i = 0; i < learning.size(); ++i) {
    if (const auto noise = CommonNoise(found[i])) {
      knowing[learning[i]] = learners[i].WithSceneNoise(*noise);
    }
  }
  return GridLocalizer(std::move(knowing));
}

std::vector<size_t> NoiseSample(std::span<const Query> queries) {
  constexpr size_t kQueries = 30;
  return SampleByName(queries, kQueries);
}

}  // namespace raylift
