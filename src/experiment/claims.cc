#include <algorithm>
#include <functional>

#include "experiment/pivot.h"
#include "experiment/results.h"
#include <fmt/format.h>

#include "raylift/base/text.h"

namespace raylift {
namespace {

// The quantity that is judged: a value of each query.
struct Measure {
  std::string name;
  std::function<std::vector<double>(const SettingResult&)> per_query;
};

std::vector<Measure> MeasuresOf(const std::vector<Threshold>& thresholds) {
  std::vector<Measure> measures;
  for (size_t t = 0; t < thresholds.size(); ++t) {
    const std::string limit = fmt::format("({}, {}deg)", FormatDouble(thresholds[t].position),
                                          FormatDouble(thresholds[t].rotation_deg));
    measures.push_back(
        {"recall " + limit, [t](const SettingResult& result) { return result.RecallPerQuery(t); }});
    measures.push_back(
        {"AUC " + limit, [t](const SettingResult& result) { return result.AucPerQuery(t); }});
  }
  return measures;
}

// Judges all claims by Holm's method: the smallest p-value is compared with the level over the
// number of lines, the next with the level over one less, until one fails.
void Judge(const std::vector<Claim>& claims, std::vector<JudgedClaim>& judged) {
  struct Ref {
    const Claim* claim;
    ClaimLine* line;
  };
  std::vector<Ref> lines;
  for (size_t c = 0; c < judged.size(); ++c) {
    for (ClaimLine& line : judged[c].lines) lines.push_back({&claims[c], &line});
  }
  std::stable_sort(lines.begin(), lines.end(),
                   [](const Ref& a, const Ref& b) { return a.line->p_value < b.line->p_value; });
  bool significant = true;
  for (size_t i = 0; i < lines.size(); ++i) {
    ClaimLine& line = *lines[i].line;
    significant =
        significant && line.p_value <= kClaimLevel / static_cast<double>(lines.size() - i);
    const double difference = line.first_percent - line.second_percent;
    if (significant && difference != 0) {
      line.verdict = difference > 0 ? ClaimVerdict::kShown : ClaimVerdict::kContradicted;
    } else if (lines[i].claim->relation == Claim::Relation::kNotWorse &&
               line.difference_percent.low > -kNotWorsePercent) {
      line.verdict = ClaimVerdict::kHolds;
    } else {
      line.verdict = ClaimVerdict::kNoise;
    }
  }
}

class ClaimJudge {
 public:
  ClaimJudge(const Experiment& experiment, const Claim& claim,
             std::span<const SettingResult> results)
      : experiment_(experiment), claim_(claim), results_(results) {
    for (const Axis axis : AllValues<Axis>()) {
      const bool is_named = claim.first.values.contains(axis) ||
                            claim.second.values.contains(axis) || claim.to.values.contains(axis);
      if (!IsOfMethod(axis) && !is_named) open_axes_.push_back(axis);
    }
  }

  JudgedClaim Judged() {
    JudgedClaim judged{claim_.name, claim_.text, {}};
    for (const Setting& place : Places()) {
      const auto firsts = Find(claim_.first, place);
      const auto seconds = Find(claim_.second, place);
      if (seconds.empty()) continue;
      for (const SettingResult* first : firsts) {
        for (const Measure& measure : MeasuresOf(first->thresholds)) {
          judged.lines.push_back(Compare(place, *first, seconds, measure));
        }
      }
    }
    return judged;
  }

 private:
  bool Takes(const Selection& selection, const SettingResult& result) const {
    return !result.comparisons.empty() && claim_.where.Matches(result.setting) &&
           selection.Matches(result.setting) && claim_.to.Matches(result.setting) &&
           (claim_.to.values.empty() || FindBefore(result) != nullptr);
  }

  // Returns the combinations of values on the open axes: those in which every axis matters or, if
  // there are none, the others.
  std::vector<Setting> Places() const {
    std::vector<Setting> places, incomplete;
    for (const SettingResult& result : results_) {
      if (!Takes(claim_.first, result) && !Takes(claim_.second, result)) continue;
      Setting place;
      bool complete = true;
      for (const Axis axis : open_axes_) {
        place[axis] = result.setting[axis];
        complete = complete && Matters(place[axis]);
      }
      std::vector<Setting>& list = complete ? places : incomplete;
      if (std::find(list.begin(), list.end(), place) == list.end()) list.push_back(place);
    }
    return places.empty() ? incomplete : places;
  }

  std::vector<const SettingResult*> Find(const Selection& selection, const Setting& place) const {
    std::vector<const SettingResult*> found;
    for (const SettingResult& result : results_) {
      const bool fits = std::all_of(open_axes_.begin(), open_axes_.end(), [&](Axis axis) {
        const AxisValue& value = result.setting[axis];
        return !Matters(value) || value == place[axis];
      });
      if (fits && Takes(selection, result)) found.push_back(&result);
    }
    return found;
  }

  // Returns the same setting where the change begins; null where there is none.
  const SettingResult* FindBefore(const SettingResult& result) const {
    for (const SettingResult& other : results_) {
      Setting moved = other.setting;
      for (const auto& [axis, values] : claim_.from.values) moved[axis] = result.setting[axis];
      if (moved == result.setting && claim_.from.Matches(other.setting)) return &other;
    }
    return nullptr;
  }

  // Returns the values of the queries, or how much they change where the claim is on a change.
  std::vector<double> PerQuery(const SettingResult& result, const Measure& measure) const {
    std::vector<double> values = measure.per_query(result);
    if (claim_.from.values.empty()) return values;
    const std::vector<double> before = measure.per_query(*FindBefore(result));
    for (size_t q = 0; q < values.size(); ++q) values[q] -= before[q];
    return values;
  }

  ClaimLine Compare(const Setting& place, const SettingResult& first,
                    const std::vector<const SettingResult*>& seconds,
                    const Measure& measure) const {
    const std::vector<double> of_first = PerQuery(first, measure);
    std::vector<std::vector<double>> of_seconds;
    of_seconds.reserve(seconds.size());
    for (const SettingResult* second : seconds) of_seconds.push_back(PerQuery(*second, measure));
    const auto best =
        std::max_element(of_seconds.begin(), of_seconds.end(),
                         [](const auto& a, const auto& b) { return MeanOf(a) < MeanOf(b); });
    const QueryBootstrap::Difference difference =
        QueryBootstrap(of_first.size(), 0).ToBest(of_first, of_seconds);
    return {.place = PlaceTitle(place, first),
            .first = MethodTitleOf(first),
            .second = MethodTitleOf(*seconds[static_cast<size_t>(best - of_seconds.begin())]),
            .measure = measure.name,
            .first_percent = MeanOf(of_first),
            .second_percent = MeanOf(*best),
            .difference_percent = difference.interval,
            .p_value =
                2 * (MeanOf(of_first) > MeanOf(*best) ? difference.p_better : difference.p_worse)};
  }

  std::string PlaceTitle(const Setting& place, const SettingResult& first) const {
    Setting named = place;
    if (!Matters(named[Axis::kScene])) named[Axis::kScene] = first.setting[Axis::kScene];
    std::string title;
    for (const Axis axis : open_axes_) {
      const std::string text = ValueTitle(experiment_, named, axis);
      if (text.empty() || text == "off") continue;
      title += (title.empty() ? "" : ", ") + text;
    }
    return title;
  }

  // Returns the title by the axes that the claim names and the method's own.
  std::string MethodTitleOf(const SettingResult& result) const {
    std::string title;
    for (const Axis axis : AllValues<Axis>()) {
      const bool is_open =
          std::find(open_axes_.begin(), open_axes_.end(), axis) != open_axes_.end();
      if (is_open || !Matters(result.setting[axis])) continue;
      title += (title.empty() ? "" : ", ") + ValueTitle(experiment_, result.setting, axis);
    }
    return title;
  }

  const Experiment& experiment_;
  const Claim& claim_;
  std::span<const SettingResult> results_;
  std::vector<Axis> open_axes_;
};

TableRow Fields(const ClaimLine& line) {
  return {line.place,
          line.first,
          line.second,
          line.measure,
          fmt::format("{:.1f}", line.first_percent),
          fmt::format("{:.1f}", line.second_percent),
          fmt::format("{:+.1f}", line.first_percent - line.second_percent),
          fmt::format("{:+.1f}", line.difference_percent.low),
          fmt::format("{:+.1f}", line.difference_percent.high),
          std::string(ToString(line.verdict))};
}

std::string Summary(const JudgedClaim& claim) {
  std::string text;
  for (const ClaimVerdict verdict : AllValues<ClaimVerdict>()) {
    const size_t count = claim.Count(verdict);
    if (count == 0) continue;
    text += fmt::format("{}{} {}", text.empty() ? "" : ", ", ToString(verdict), count);
  }
  return text.empty() ? "nothing to compare" : text;
}

}  // namespace

size_t JudgedClaim::Count(ClaimVerdict verdict) const {
  return static_cast<size_t>(std::count_if(
      lines.begin(), lines.end(), [&](const ClaimLine& line) { return line.verdict == verdict; }));
}

std::vector<JudgedClaim> JudgeClaims(const Experiment& experiment,
                                     std::span<const SettingResult> results) {
  std::vector<JudgedClaim> judged;
  for (const Claim& claim : experiment.claims) {
    judged.push_back(ClaimJudge(experiment, claim, results).Judged());
  }
  Judge(experiment.claims, judged);
  return judged;
}

std::string FormatClaimsText(std::span<const JudgedClaim> claims) {
  std::string text;
  for (const JudgedClaim& claim : claims) {
    text += fmt::format("{}: {}\n    {}\n", claim.name, claim.text, Summary(claim));
  }
  return text;
}

std::string FormatClaimsMarkdown(std::span<const JudgedClaim> claims) {
  std::string text =
      "Differences of means over the queries with their 95 % intervals (paired bootstrap; to the "
      "best of several opponents in each draw). Shown: better, contradicted: worse, each beyond "
      "luck by Holm's correction over all lines at 5 %; holds: not worse by more than a percentage "
      "point; noise: the queries do not tell.\n";
  for (const JudgedClaim& claim : claims) {
    text += fmt::format("\n**{}. {}** {}.\n\n", EscapeMarkdown(claim.name),
                        EscapeMarkdown(claim.text), Summary(claim));
    if (claim.lines.empty()) continue;
    text +=
        "| where | first | second | measure | first % | second % | difference | low | high | |\n"
        "|---|---|---|---|---|---|---|---|---|---|\n";
    for (const ClaimLine& line : claim.lines) {
      text += "|";
      for (const std::string& field : Fields(line)) text += " " + EscapeMarkdown(field) + " |";
      text += "\n";
    }
  }
  return text;
}

std::string FormatClaimsCsv(std::span<const JudgedClaim> claims) {
  std::string text = CsvLine({"claim", "where", "first", "second", "measure", "first_percent",
                              "second_percent", "difference", "low", "high", "verdict"});
  for (const JudgedClaim& claim : claims) {
    for (const ClaimLine& line : claim.lines) {
      TableRow fields = Fields(line);
      fields.insert(fields.begin(), claim.name);
      text += CsvLine(fields);
    }
  }
  return text;
}

}  // namespace raylift
