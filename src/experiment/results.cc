#include "experiment/results.h"

#include <algorithm>
#include <limits>
#include <map>

#include "base/statistics.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/io/query_list.h"

namespace raylift {
namespace {

using std::filesystem::path;

// A seed and an offset of the subsampling.
using Run = std::pair<uint64_t, size_t>;

// The outcomes of a scene's queries, by name.
using Outcomes = std::map<std::string, QueryOutcome>;

// Chooses a pose by eq. 6, as the estimator itself does.
QueryOutcome ChooseBySelect(const QueryOutcome& p3p, const QueryOutcome& e5p1, double alpha) {
  const bool has_p3p = p3p.cam_from_world.has_value();
  bool take_p3p = has_p3p && p3p.inliers_2d2d > alpha * e5p1.inliers_2d2d;
  if (!e5p1.cam_from_world || (!e5p1.position_observable && has_p3p)) take_p3p = has_p3p;
  return take_p3p ? p3p : e5p1;
}

class ResultCollector {
 public:
  ResultCollector(const Experiment& experiment, std::span<const Cell> cells, const CellStore& store)
      : experiment_(experiment), store_(store) {
    for (const Cell& cell : cells) cells_[cell.setting].push_back(&cell);
  }

  // Returns nullopt if there is no ground truth of these queries.
  std::optional<Comparison> Compare(const Setting& setting, Run run) {
    const ExperimentScene& scene = experiment_.SceneOf(setting);
    if (scene.ground_truth.empty()) return std::nullopt;
    if (setting.IsOracle()) {
      return ChooseByOracle(*Compare(P3pOf(setting), run), *Compare(E5p1Of(setting), run));
    }
    const Outcomes outcomes = OutcomesOf(setting, run);
    PosesByName poses;
    for (const auto& [name, outcome] : outcomes) {
      if (outcome.reason.empty()) poses.emplace(name, *outcome.cam_from_world);
    }
    return CompareWithGroundTruth(TruthOf(scene, outcomes), poses);
  }

  Outcomes OutcomesOf(const Setting& setting, Run run) const {
    if (setting.Is(Method::kSelect) && IsChosen(setting, experiment_)) {
      const double alpha = std::get<double>(setting[Axis::kAlpha]);
      Outcomes chosen = OutcomesOf(P3pOf(setting), run);
      const Outcomes e5p1 = OutcomesOf(E5p1Of(setting), run);
      for (auto& [name, outcome] : chosen) {
        outcome = ChooseBySelect(outcome, e5p1.at(name), alpha);
      }
      return chosen;
    }
    Outcomes outcomes;
    const auto cells = cells_.find(setting);
    RAYLIFT_CHECK(cells != cells_.end());
    for (const Cell* cell : cells->second) {
      if (Run(cell->seed, cell->offset) != run) continue;
      const auto read = store_.Read(*cell);
      if (!read) throw InputError("a result is missing or damaged: " + setting.Name());
      for (const QueryOutcome& outcome : *read) outcomes.emplace(outcome.name, outcome);
    }
    return outcomes;
  }

 private:
  // Returns the true poses of those queries that have an outcome, as a list may hold a part of
  // them.
  const PosesByName& TruthOf(const ExperimentScene& scene, const Outcomes& outcomes) {
    const auto known = truth_.find(scene.name);
    if (known != truth_.end()) return known->second;
    PosesByName truth = ReadModelOrPoses(scene.ground_truth);
    std::erase_if(truth, [&](const auto& entry) { return !outcomes.contains(entry.first); });
    if (truth.empty()) throw InputError(scene.ground_truth, "holds none of the queries");
    return truth_.emplace(scene.name, std::move(truth)).first->second;
  }

  const Experiment& experiment_;
  const CellStore& store_;
  std::map<Setting, std::vector<const Cell*>> cells_;
  std::map<std::string, PosesByName> truth_;
};

std::vector<Run> RunsOf(const Experiment& experiment, const Setting& setting) {
  std::vector<Run> runs;
  for (size_t offset = 0; offset < NumOffsets(experiment, setting); ++offset) {
    for (const uint64_t seed : experiment.seeds) runs.emplace_back(seed, offset);
  }
  return runs;
}

// Returns the mean over the runs of a value of each query's error.
template <typename Value>
std::vector<double> PerQuery(const std::vector<Comparison>& comparisons, const Value& value) {
  std::vector<double> means(comparisons.empty() ? 0 : comparisons.front().queries.size(), 0.0);
  for (const Comparison& comparison : comparisons) {
    for (size_t q = 0; q < means.size(); ++q) {
      const auto& error = comparison.queries[q].error;
      if (error) means[q] += value(*error);
    }
  }
  for (double& mean : means) mean /= static_cast<double>(comparisons.size());
  return means;
}

template <typename Value>
double MedianOver(const std::vector<Comparison>& comparisons, const Value& value) {
  std::vector<double> values;
  for (const Comparison& comparison : comparisons) {
    for (const QueryError& query : comparison.queries) {
      values.push_back(query.error ? value(*query.error) : std::numeric_limits<double>::infinity());
    }
  }
  if (values.empty()) return std::numeric_limits<double>::infinity();
  return MidpointMedianInPlace(std::span(values));
}

// Returns a name that any file system accepts.
std::string FileName(const Setting& setting, Run run) {
  std::string name;
  for (const Axis axis : AllValues<Axis>()) {
    if (axis == Axis::kScene || !Matters(setting[axis])) continue;
    if (!name.empty()) name += '-';
    if (axis == Axis::kEvery) name += "every";
    name += TextOf(setting[axis]);
  }
  for (char& c : name) {
    const bool plain =
        std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '-' || c == '.' || c == '_';
    if (!plain) c = '_';
  }
  if (run.second > 0) name += fmt::format("-offset{}", run.second);
  return fmt::format("{}-seed{}.txt", name, run.first);
}

}  // namespace

double MeanOf(const std::vector<double>& values) {
  double sum = 0;
  for (const double value : values) sum += value;
  return values.empty() ? 0 : sum / static_cast<double>(values.size());
}

size_t SettingResult::NumQueries() const {
  return comparisons.empty() ? 0 : comparisons.front().queries.size();
}

double SettingResult::RecallPercent(size_t threshold) const {
  return MeanOf(RecallPerQuery(threshold));
}

double SettingResult::AucPercent(size_t threshold) const { return MeanOf(AucPerQuery(threshold)); }

double SettingResult::LocalizedPercent() const {
  return MeanOf(PerQuery(comparisons, [](const PoseError&) { return 100.0; }));
}

double SettingResult::MedianPosition() const {
  return MedianOver(comparisons, [](const PoseError& error) { return error.position; });
}

double SettingResult::MedianRotationDeg() const {
  return MedianOver(comparisons, [](const PoseError& error) { return error.rotation_deg; });
}

std::vector<double> SettingResult::RecallPerQuery(size_t threshold) const {
  const Threshold& limit = thresholds.at(threshold);
  return PerQuery(comparisons,
                  [&](const PoseError& error) { return limit.Accepts(error) ? 100.0 : 0.0; });
}

std::vector<double> SettingResult::AucPerQuery(size_t threshold) const {
  const Threshold& limit = thresholds.at(threshold);
  return PerQuery(comparisons, [&](const PoseError& error) {
    const double share =
        std::max(error.position / limit.position, error.rotation_deg / limit.rotation_deg);
    return 100 * std::max(0.0, 1 - share);
  });
}

std::vector<SettingResult> CollectResults(const Experiment& experiment,
                                          std::span<const Setting> settings,
                                          std::span<const Cell> cells, const CellStore& store) {
  ResultCollector collector(experiment, cells, store);
  std::vector<SettingResult> results;
  for (const Setting& setting : settings) {
    SettingResult& result = results.emplace_back();
    result.setting = setting;
    result.uses_ground_truth = setting.IsOracle();
    result.thresholds = experiment.SceneOf(setting).thresholds;
    for (const Run& run : RunsOf(experiment, setting)) {
      if (auto comparison = collector.Compare(setting, run)) {
        result.comparisons.push_back(*std::move(comparison));
      }
    }
  }
  return results;
}

std::string FormatResultsCsv(std::span<const SettingResult> results) {
  TableRow header;
  for (const Axis axis : AllValues<Axis>()) header.emplace_back(ToString(axis));
  for (const char* name :
       {"uses_ground_truth", "queries", "runs", "localized_percent", "threshold_position",
        "threshold_deg", "recall_percent", "recall_lowest_run", "recall_highest_run", "auc_percent",
        "median_position", "median_rotation_deg"}) {
    header.emplace_back(name);
  }
  std::string text = CsvLine(header);
  for (const SettingResult& result : results) {
    for (size_t t = 0; t < result.thresholds.size(); ++t) {
      if (result.comparisons.empty()) continue;
      TableRow row;
      for (const AxisValue& value : result.setting.values) row.push_back(TextOf(value));
      double lowest = 100, highest = 0;
      for (const Comparison& comparison : result.comparisons) {
        const double recall = Summarize("", comparison, result.thresholds).recalls_percent[t];
        lowest = std::min(lowest, recall);
        highest = std::max(highest, recall);
      }
      row.insert(row.end(),
                 {result.uses_ground_truth ? "true" : "false", std::to_string(result.NumQueries()),
                  std::to_string(result.comparisons.size()),
                  fmt::format("{:.2f}", result.LocalizedPercent()),
                  FormatDouble(result.thresholds[t].position),
                  FormatDouble(result.thresholds[t].rotation_deg),
                  fmt::format("{:.2f}", result.RecallPercent(t)), fmt::format("{:.2f}", lowest),
                  fmt::format("{:.2f}", highest), fmt::format("{:.2f}", result.AucPercent(t)),
                  fmt::format("{:.6g}", result.MedianPosition()),
                  fmt::format("{:.6g}", result.MedianRotationDeg())});
      text += CsvLine(row);
    }
  }
  return text;
}

size_t WriteSubmissions(const path& folder, const Experiment& experiment,
                        std::span<const Setting> settings, std::span<const Cell> cells,
                        const CellStore& store) {
  const ResultCollector collector(experiment, cells, store);
  size_t written = 0;
  for (const Setting& setting : settings) {
    const ExperimentScene& scene = experiment.SceneOf(setting);
    if (!scene.ground_truth.empty() || setting.IsOracle()) continue;
    for (const Run& run : RunsOf(experiment, setting)) {
      std::vector<NamedPose> poses;
      for (const auto& [name, outcome] : collector.OutcomesOf(setting, run)) {
        if (outcome.reason.empty()) poses.push_back({name, *outcome.cam_from_world});
      }
      WritePoseFile(folder / scene.name / FileName(setting, run), poses);
      ++written;
    }
  }
  return written;
}

}  // namespace raylift
