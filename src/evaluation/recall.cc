#include "raylift/evaluation/recall.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "base/statistics.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

// As the data sets' own papers and benchmarks report them.
constexpr std::pair<std::string_view, std::string_view> kPresets[] = {
    {"aachen", "0.25,2:0.5,5:5,10"},
    {"robotcar", "0.25,2:0.5,5:5,10"},
    {"cmu", "0.25,2:0.5,5:5,10"},
    {"gangnam", "0.1,1:0.25,2:1,5"},
    {"inloc", "0.25,10:0.5,10:1,10"},
    {"cambridge", "0.1,1"},
    {"7scenes", "0.05,5"},
    {"12scenes", "0.05,5"},
};

}  // namespace

std::vector<Threshold> ParseThresholds(std::string_view text) {
  for (const auto& [name, thresholds] : kPresets) {
    if (name == text) return ParseThresholds(thresholds);
  }
  const auto fail = [text](std::string_view part) {
    return OptionError("thresholds", text,
                       fmt::format("expected POSITION,DEGREES[:POSITION,DEGREES...], all positive "
                                   "numbers, or {}, found \"{}\"",
                                   ThresholdPresetNames(), part));
  };
  std::vector<Threshold> thresholds;
  for (const std::string_view part : SplitBy(text, ':')) {
    const auto numbers = SplitBy(part, ',');
    if (numbers.size() != 2) {
      throw fail(part);
    }
    const auto position = ParseDouble(numbers[0]);
    const auto rotation_deg = ParseDouble(numbers[1]);
    for (const auto& value : {position, rotation_deg}) {
      if (!value || !std::isfinite(*value) || *value <= 0) {
        throw fail(part);
      }
    }
    thresholds.push_back({*position, *rotation_deg});
  }
  return thresholds;
}

std::string ThresholdPresetNames() {
  std::string names;
  for (const auto& [name, thresholds] : kPresets) {
    names += (names.empty() ? "" : "|") + std::string(name);
  }
  return names;
}

ResultSummary Summarize(std::string name, const Comparison& comparison,
                        std::span<const Threshold> thresholds) {
  if (comparison.queries.empty()) {
    throw InputError(fmt::format("{}: the ground truth holds no queries", name));
  }
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  ResultSummary summary;
  summary.name = std::move(name);
  summary.uses_ground_truth = comparison.uses_ground_truth;
  summary.unknown_names = comparison.unknown_names;
  summary.num_queries = comparison.queries.size();
  std::vector<double> positions;
  std::vector<double> rotations_deg;
  for (const QueryError& query : comparison.queries) {
    if (query.error) {
      ++summary.num_localized;
    } else {
      summary.missing_names.push_back(query.name);
    }
    positions.push_back(query.error ? query.error->position : kInfinity);
    rotations_deg.push_back(query.error ? query.error->rotation_deg : kInfinity);
  }
  summary.median_position = MidpointMedianInPlace(std::span(positions));
  summary.median_rotation_deg = MidpointMedianInPlace(std::span(rotations_deg));
  for (const Threshold& threshold : thresholds) {
    const auto accepted = std::count_if(
        comparison.queries.begin(), comparison.queries.end(),
        [&](const QueryError& query) { return query.error && threshold.Accepts(*query.error); });
    summary.recalls_percent.push_back(100 * static_cast<double>(accepted) /
                                      static_cast<double>(summary.num_queries));
  }
  return summary;
}

std::string UnknownNamesWarning(const ResultSummary& summary) {
  if (summary.unknown_names.empty()) {
    return {};
  }
  return fmt::format("{}: {} of the poses are not in the ground truth, e.g. \"{}\"", summary.name,
                     summary.unknown_names.size(), summary.unknown_names.front());
}

}  // namespace raylift
