#include "raylift/evaluation/pose_errors.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/constants.h"
#include "base/json_text.h"
#include "base/statistics.h"
#include <Eigen/Cholesky>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/geometry/residuals.h"

namespace raylift {
namespace {

// Finds the true name that each estimate stands for.
class NameMatcher {
 public:
  NameMatcher(const PosesByName& ground_truth, const PosesByName& estimated) {
    for (const auto& [name, pose] : estimated) {
      if (ground_truth.contains(name)) {
        estimate_of_true_name_[name] = name;
      }
    }
    const auto true_names_by_end = CollectNameEnds(ground_truth);
    std::map<std::string, std::vector<std::string>> claims;
    for (const auto& [name, pose] : estimated) {
      const auto found = true_names_by_end.find(name);
      if (!ground_truth.contains(name) && found != true_names_by_end.end() &&
          found->second.size() == 1) {
        claims[found->second.front()].push_back(name);
      }
    }
    for (const auto& [true_name, names] : claims) {
      if (names.size() == 1) {
        estimate_of_true_name_.try_emplace(true_name, names.front());
      }
    }
  }

  const std::map<std::string, std::string>& estimate_of_true_name() const {
    return estimate_of_true_name_;
  }

 private:
  // "a/b/c" is listed under "b/c" and "c".
  static std::map<std::string, std::vector<std::string>> CollectNameEnds(const PosesByName& poses) {
    std::map<std::string, std::vector<std::string>> names_by_end;
    for (const auto& [name, pose] : poses) {
      for (size_t i = 0; i < name.size(); ++i) {
        if (name[i] == '/') {
          names_by_end[name.substr(i + 1)].push_back(name);
        }
      }
    }
    return names_by_end;
  }

  std::map<std::string, std::string> estimate_of_true_name_;
};

}  // namespace

PoseError ComparePoses(const Rigid3& estimated_cam_from_world, const Rigid3& true_cam_from_world) {
  return {
      .position =
          (estimated_cam_from_world.OriginInSource() - true_cam_from_world.OriginInSource()).norm(),
      .rotation_deg =
          AngleBetweenDeg(estimated_cam_from_world.rotation, true_cam_from_world.rotation)};
}

Comparison CompareWithGroundTruth(const PosesByName& ground_truth, const PosesByName& estimated) {
  const NameMatcher matcher(ground_truth, estimated);
  Comparison comparison;
  PosesByName unknown = estimated;
  for (const auto& [name, true_pose] : ground_truth) {
    QueryError query = {name, std::nullopt};
    const auto match = matcher.estimate_of_true_name().find(name);
    if (match != matcher.estimate_of_true_name().end()) {
      const Rigid3& pose = estimated.at(match->second);
      if (pose.IsFinite()) {
        query.error = ComparePoses(pose, true_pose);
      }
      unknown.erase(match->second);
    }
    comparison.queries.push_back(std::move(query));
  }
  for (const auto& [name, pose] : unknown) {
    comparison.unknown_names.push_back(name);
  }
  return comparison;
}

PosesByName MatchNames(const PosesByName& ground_truth, const PosesByName& estimated) {
  const NameMatcher matcher(ground_truth, estimated);
  PosesByName poses;
  for (const auto& [true_name, name] : matcher.estimate_of_true_name()) {
    poses.emplace(true_name, estimated.at(name));
  }
  return poses;
}

std::map<std::string, Comparison> SplitByGroup(
    const Comparison& comparison, const std::map<std::string, std::string>& group_of_query) {
  std::map<std::string, Comparison> groups;
  for (const QueryError& query : comparison.queries) {
    const auto group = group_of_query.find(query.name);
    if (group == group_of_query.end()) continue;
    Comparison& part = groups[group->second];
    part.uses_ground_truth = comparison.uses_ground_truth;
    part.queries.push_back(query);
  }
  return groups;
}

Comparison ChooseByOracle(const Comparison& a, const Comparison& b, double cm_per_scene_unit) {
  RAYLIFT_CHECK_EQ(a.queries.size(), b.queries.size());
  const auto cost = [cm_per_scene_unit](const PoseError& error) {
    return std::max(error.position * cm_per_scene_unit, error.rotation_deg);
  };
  Comparison chosen = {.queries = a.queries, .unknown_names = {}, .uses_ground_truth = true};
  for (size_t i = 0; i < chosen.queries.size(); ++i) {
    RAYLIFT_CHECK(a.queries[i].name == b.queries[i].name);
    auto& error = chosen.queries[i].error;
    const auto& other = b.queries[i].error;
    if (other && (!error || cost(*other) < cost(*error))) {
      error = other;
    }
  }
  return chosen;
}

namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;

// The 90 % quantile of chi-squared with six degrees of freedom.
constexpr double kChiSquared90 = 10.644640675668422;

}  // namespace

Calibration Calibrate(std::span<const UncertainPose> poses) {
  Calibration calibration;
  std::vector<double> squares, sigmas;
  size_t covered = 0, below_3 = 0;
  double sum = 0;
  for (const UncertainPose& pose : poses) {
    const Eigen::LDLT<Eigen::Matrix<double, 6, 6>> factors(pose.covariance);
    if (factors.info() != Eigen::Success || !factors.isPositive() || !(factors.rcond() > 1e-16)) {
      continue;
    }
    const Vector6d step = StepBetween(pose.true_cam_from_world, pose.estimated_cam_from_world);
    const double squared = step.dot(factors.solve(step));
    if (!std::isfinite(squared)) continue;
    squares.push_back(squared / 6);
    sum += squared / 6;
    covered += squared < kChiSquared90 ? 1 : 0;
    const double error =
        (pose.estimated_cam_from_world.OriginInSource() - pose.true_cam_from_world.OriginInSource())
            .norm();
    sigmas.push_back(error / std::sqrt(pose.covariance.bottomRightCorner<3, 3>().trace()));
    below_3 += sigmas.back() < 3 ? 1 : 0;
  }
  calibration.poses = squares.size();
  if (squares.empty()) return calibration;
  const auto count = static_cast<double>(squares.size());
  calibration.mean_normalized_square = sum / count;
  calibration.coverage_90 = static_cast<double>(covered) / count;
  calibration.share_below_3_sigma = static_cast<double>(below_3) / count;
  calibration.median_normalized_square = UpperMedianOr(std::move(squares), 0);
  calibration.median_sigmas = UpperMedianOr(std::move(sigmas), 0);
  return calibration;
}

namespace {

// The thresholds that the data sets' own papers and benchmarks report.
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

std::string DescribeMissing(const ResultSummary& summary) {
  constexpr size_t kMost = 5;
  const std::vector<std::string>& names = summary.missing_names;
  if (names.empty()) return {};
  std::vector<std::string> some;
  for (size_t i = 0; i < std::min(kMost, names.size()); ++i) some.push_back(Printable(names[i]));
  return fmt::format(
      "{}: {} of {} images of the ground truth have no pose and count as not localized: {}{}",
      Printable(summary.name), names.size(), summary.num_queries, fmt::join(some, ", "),
      names.size() > kMost ? ", ..." : "");
}

std::string UnknownNamesWarning(const ResultSummary& summary) {
  if (summary.unknown_names.empty()) {
    return {};
  }
  return fmt::format("{}: {} of the poses are not in the ground truth, e.g. \"{}\"", summary.name,
                     summary.unknown_names.size(), summary.unknown_names.front());
}

namespace {

std::string Percent(double recall_percent) { return fmt::format("{:.2f}", recall_percent); }

std::string Median(double error) {
  return std::isfinite(error) ? fmt::format("{:.5g}", error) : "inf";
}

nlohmann::ordered_json JsonNumber(const std::string& text) {
  const auto value = ParseDouble(text);
  RAYLIFT_CHECK(value.has_value());
  if (!std::isfinite(*value)) {
    return nullptr;
  }
  return *value;
}

nlohmann::ordered_json CalibrationJson(const Calibration& calibration) {
  const auto number = [](double value) { return JsonNumber(Median(value)); };
  return {{"poses", calibration.poses},
          {"mean_normalized_square", number(calibration.mean_normalized_square)},
          {"median_normalized_square", number(calibration.median_normalized_square)},
          {"coverage_90_percent", number(100 * calibration.coverage_90)},
          {"median_sigmas", number(calibration.median_sigmas)},
          {"below_3_sigma_percent", number(100 * calibration.share_below_3_sigma)}};
}

using Row = TableRow;

// Says how well the covariances of the results fit that have some; empty where none has.
std::string FormatCalibrationText(std::span<const ResultSummary> results) {
  std::vector<Row> rows = {{"covariances", "poses", "mean e2/6", "median e2/6", "in 90% %",
                            "median sigmas", "< 3 sigma %"}};
  for (const ResultSummary& result : results) {
    if (!result.calibration) continue;
    const Calibration& c = *result.calibration;
    rows.push_back({Printable(result.name), std::to_string(c.poses),
                    Median(c.mean_normalized_square), Median(c.median_normalized_square),
                    Percent(100 * c.coverage_90), Median(c.median_sigmas),
                    Percent(100 * c.share_below_3_sigma)});
  }
  return rows.size() > 1 ? AlignColumns(rows) : std::string();
}

// Returns the numbers of a result, in the order of the columns.
Row Numbers(const ResultSummary& result) {
  Row numbers = {std::to_string(result.num_queries), std::to_string(result.num_localized),
                 std::to_string(result.unknown_names.size())};
  for (const double recall : result.recalls_percent) {
    numbers.push_back(Percent(recall));
  }
  numbers.push_back(Median(result.median_position));
  numbers.push_back(Median(result.median_rotation_deg));
  return numbers;
}

}  // namespace

std::string FormatTableText(const ResultTable& table) {
  Row header = {"result", "queries", "localized", "unknown"};
  for (const Threshold& threshold : table.thresholds) {
    header.push_back(fmt::format("{},{}deg %", FormatDouble(threshold.position),
                                 FormatDouble(threshold.rotation_deg)));
  }
  header.insert(header.end(), {"median position", "median deg"});
  std::vector<Row> rows = {header};
  bool any_uses_ground_truth = false;
  for (const ResultSummary& result : table.results) {
    Row row = Numbers(result);
    std::replace(row.begin(), row.end(), std::string("inf"), std::string("-"));
    row.insert(row.begin(), Printable(result.name) + (result.uses_ground_truth ? " *" : ""));
    rows.push_back(std::move(row));
    any_uses_ground_truth = any_uses_ground_truth || result.uses_ground_truth;
  }
  return AlignColumns(rows) + (any_uses_ground_truth ? "* chosen with the ground truth\n" : "") +
         FormatCalibrationText(table.results);
}

std::string FormatTableCsv(const ResultTable& table) {
  Row header = {"name", "uses_ground_truth", "queries", "localized", "unknown"};
  for (const Threshold& threshold : table.thresholds) {
    header.push_back(fmt::format("recall_percent_{}_{}deg", FormatDouble(threshold.position),
                                 FormatDouble(threshold.rotation_deg)));
  }
  header.insert(header.end(), {"median_position", "median_rotation_deg"});
  std::string text = CsvLine(header);
  for (const ResultSummary& result : table.results) {
    Row row = Numbers(result);
    row.insert(row.begin(), {result.name, result.uses_ground_truth ? "true" : "false"});
    text += CsvLine(row);
  }
  return text;
}

std::string FormatTableJson(const ResultTable& table) {
  using Json = nlohmann::ordered_json;
  Json thresholds = Json::array();
  for (const Threshold& threshold : table.thresholds) {
    thresholds.push_back(
        {{"position", threshold.position}, {"rotation_deg", threshold.rotation_deg}});
  }
  Json results = Json::array();
  for (const ResultSummary& result : table.results) {
    Json recalls = Json::array();
    for (const double recall : result.recalls_percent) {
      recalls.push_back(JsonNumber(Percent(recall)));
    }
    results.push_back({{"name", result.name},
                       {"uses_ground_truth", result.uses_ground_truth},
                       {"queries", result.num_queries},
                       {"localized", result.num_localized},
                       {"unknown", result.unknown_names.size()},
                       {"recalls_percent", recalls},
                       {"median_position", JsonNumber(Median(result.median_position))},
                       {"median_rotation_deg", JsonNumber(Median(result.median_rotation_deg))},
                       {"missing_names", result.missing_names},
                       {"unknown_names", result.unknown_names}});
    if (result.calibration) results.back()["calibration"] = CalibrationJson(*result.calibration);
  }
  const Json document = {{"thresholds", thresholds}, {"results", results}};
  return JsonText(document, 2) + '\n';
}

}  // namespace raylift
