#include <cmath>

#include "base/json_text.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/text.h"
#include "raylift/comparison/localization_comparison.h"

namespace raylift {
namespace {

std::string Error(double value) {
  return std::isfinite(value) ? fmt::format("{:.4g}", value) : "inf";
}

std::string OrDash(const std::string& text) { return text.empty() ? "-" : Printable(text); }

// Says how a row stands to the best one at a threshold.
std::string Verdict(const LocalizationRow& row, size_t threshold) {
  if (row.is_oracle) return "oracle";
  const Interval& difference = row.difference_to_best[threshold];
  if (difference.low == 0 && difference.high == 0) return "best";
  return difference.Contains(0) ? "noise" : "worse";
}

nlohmann::ordered_json ToJson(const Interval& interval) {
  const auto number = [](double value) {
    return std::isfinite(value) ? nlohmann::ordered_json(value) : nlohmann::ordered_json();
  };
  return {number(interval.low), number(interval.high)};
}

// Lists what the stages left of a query's matches, and how its pose was found.
void AddDetail(const QueryDetail& detail, nlohmann::ordered_json& entry) {
  entry["retrieved"] = detail.retrieved;
  entry["matched"] = detail.matched;
  entry["hit"] = detail.hit;
  entry["consistent"] = detail.consistent;
  entry["inliers_2d3d"] = detail.inliers_2d3d;
  entry["inliers_2d2d"] = detail.inliers_2d2d;
  entry["solver"] = detail.solver;
  for (const QueryDetail::Candidate& candidate : detail.candidates) {
    AppendTo(entry, "candidates",
             {{"solver", candidate.solver},
              {"position", candidate.error.position},
              {"rotation_deg", candidate.error.rotation_deg},
              {"inliers_2d2d", candidate.inliers_2d2d},
              {"chosen", candidate.chosen}});
  }
  for (const QueryDetail::Keypoint& keypoint : detail.keypoints) {
    AppendTo(entry, "keypoints",
             {std::round(keypoint.pixel.x() * 10) / 10, std::round(keypoint.pixel.y() * 10) / 10,
              keypoint.is_inlier ? 1 : 0});
  }
}

}  // namespace

std::string FormatLocalizationText(const LocalizationComparison& comparison) {
  TableRow header = {"method", "geometry", "align", "filter"};
  for (const Threshold& threshold : comparison.thresholds) {
    header.push_back(fmt::format("{},{}deg % [95 %]", FormatDouble(threshold.position),
                                 FormatDouble(threshold.rotation_deg)));
    header.emplace_back("to the best");
  }
  header.insert(header.end(), {"median position", "median deg"});
  std::vector<TableRow> rows = {header};
  for (const LocalizationRow& row : comparison.rows) {
    TableRow line = {row.method + (row.is_oracle ? " *" : ""), OrDash(row.source),
                     OrDash(row.alignment), OrDash(row.filter)};
    for (size_t t = 0; t < comparison.thresholds.size(); ++t) {
      line.push_back(fmt::format("{:.1f} [{:.0f}, {:.0f}]", row.summary.recalls_percent[t],
                                 row.recalls[t].low, row.recalls[t].high));
      line.push_back(Verdict(row, t));
    }
    line.push_back(Error(row.summary.median_position));
    line.push_back(Error(row.summary.median_rotation_deg));
    rows.push_back(std::move(line));
  }
  return AlignColumns(rows) +
         "noise: the difference to the best row may be luck with the queries (paired bootstrap, "
         "95 %)\n* chosen with the ground truth\n";
}

std::string FormatLocalizationCsv(const LocalizationComparison& comparison) {
  TableRow header = {"method",  "geometry", "align", "filter", "uses_ground_truth",
                     "queries", "localized"};
  for (const Threshold& threshold : comparison.thresholds) {
    const std::string key = fmt::format("recall_percent_{}_{}deg", FormatDouble(threshold.position),
                                        FormatDouble(threshold.rotation_deg));
    for (const char* end : {"", "_low", "_high", "_to_best_low", "_to_best_high", "_verdict"}) {
      header.push_back(key + end);
    }
  }
  header.insert(header.end(), {"median_position", "median_position_low", "median_position_high",
                               "median_rotation_deg", "inliers_2d3d", "inliers_2d2d"});
  std::string text = CsvLine(header);
  for (const LocalizationRow& row : comparison.rows) {
    TableRow line = {row.method,
                     row.source,
                     row.alignment,
                     row.filter,
                     row.is_oracle ? "true" : "false",
                     std::to_string(row.summary.num_queries),
                     std::to_string(row.summary.num_localized)};
    for (size_t t = 0; t < comparison.thresholds.size(); ++t) {
      for (const double value :
           {row.summary.recalls_percent[t], row.recalls[t].low, row.recalls[t].high,
            row.difference_to_best[t].low, row.difference_to_best[t].high}) {
        line.push_back(fmt::format("{:.2f}", value));
      }
      line.push_back(Verdict(row, t));
    }
    for (const double value : {row.summary.median_position, row.median_position.low,
                               row.median_position.high, row.summary.median_rotation_deg}) {
      line.push_back(fmt::format("{:.6g}", value));
    }
    for (const double value : row.median_inliers) line.push_back(FormatDouble(value));
    text += CsvLine(line);
  }
  return text;
}

std::string FormatLocalizationJson(const LocalizationComparison& comparison) {
  using Json = nlohmann::ordered_json;
  Json rows = Json::array();
  for (const LocalizationRow& row : comparison.rows) {
    Json recalls = Json::array();
    for (size_t t = 0; t < comparison.thresholds.size(); ++t) {
      recalls.push_back({{"position", comparison.thresholds[t].position},
                         {"rotation_deg", comparison.thresholds[t].rotation_deg},
                         {"percent", row.summary.recalls_percent[t]},
                         {"interval", ToJson(row.recalls[t])},
                         {"difference_to_best", ToJson(row.difference_to_best[t])},
                         {"verdict", Verdict(row, t)}});
    }
    Json errors = Json::array();
    for (const QueryError& query : row.comparison.queries) {
      Json entry = {{"query", query.name}, {"position", nullptr}, {"rotation_deg", nullptr}};
      if (query.error) {
        entry["position"] = query.error->position;
        entry["rotation_deg"] = query.error->rotation_deg;
      }
      if (const auto detail = row.details.find(query.name); detail != row.details.end()) {
        AddDetail(detail->second, entry);
      }
      errors.push_back(std::move(entry));
    }
    const double median = row.summary.median_position;
    rows.push_back({{"name", row.Name() + (row.is_oracle ? " *" : "")},
                    {"method", row.method},
                    {"geometry", row.source},
                    {"align", row.alignment},
                    {"filter", row.filter},
                    {"uses_ground_truth", row.is_oracle},
                    {"recalls", recalls},
                    {"median_position", std::isfinite(median) ? Json(median) : Json()},
                    {"queries", errors}});
  }
  return JsonText(Json({{"rows", rows}}), 1) + '\n';
}

}  // namespace raylift
