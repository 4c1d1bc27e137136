#include "raylift/localization/grid_localizer.h"

#include <algorithm>

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

}  // namespace raylift
