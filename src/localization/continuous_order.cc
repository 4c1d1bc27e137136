#include "raylift/localization/continuous_order.h"

#include <algorithm>
#include <numeric>
#include <optional>

#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

std::optional<double> OldestOf(std::span<const PosedImage> images, const CaptureTimes& times) {
  std::optional<double> oldest;
  for (const PosedImage& image : images) {
    const auto time = times.find(image.name);
    if (time == times.end()) continue;
    oldest = std::min(oldest.value_or(time->second), time->second);
  }
  return oldest;
}

}  // namespace

std::vector<size_t> OrderByTime(std::span<const Query> queries,
                                std::span<const PosedImage> references, const CaptureTimes& times,
                                const std::filesystem::path& path_for_messages) {
  std::vector<double> time_of_query;
  for (const Query& query : queries) {
    const auto time = times.find(query.name);
    if (time == times.end()) {
      throw InputError(path_for_messages,
                       fmt::format("there is no time of the query \"{}\"", query.name));
    }
    time_of_query.push_back(time->second);
  }
  const auto oldest_reference = OldestOf(references, times);
  const auto is_older = [&](size_t i) {
    return oldest_reference && time_of_query[i] < *oldest_reference;
  };
  std::vector<size_t> order = OrderByName(queries);
  std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) {
    if (is_older(a) != is_older(b)) return is_older(a);
    return is_older(a) ? time_of_query[a] > time_of_query[b] : time_of_query[a] < time_of_query[b];
  });
  return order;
}

std::vector<size_t> OrderByName(std::span<const Query> queries) {
  std::vector<size_t> order(queries.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::sort(order.begin(), order.end(),
            [&](size_t a, size_t b) { return queries[a].name < queries[b].name; });
  return order;
}

}  // namespace raylift
