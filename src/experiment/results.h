// Collects the results of an experiment's cells: pose errors against the ground truth, pooled over
// runs, which are the seeds times the offsets of the subsampling.

#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "raylift/base/enum_names.h"
#include "raylift/evaluation/pose_errors.h"
#include "raylift/experiment/experiment.h"
#include "raylift/experiment/run_cells.h"

namespace raylift {

// Values per query are means over the runs.
struct SettingResult {
  Setting setting;
  bool uses_ground_truth = false;       // an oracle's
  std::vector<Threshold> thresholds;    // of its scene
  std::vector<Comparison> comparisons;  // one per run; none: no ground truth is known

  size_t NumQueries() const;
  double RecallPercent(size_t threshold) const;
  double AucPercent(size_t threshold) const;
  double LocalizedPercent() const;
  double MedianPosition() const;  // over all queries and runs; infinite for no pose
  double MedianRotationDeg() const;

  // Returns the share of the runs in which the query was within the threshold, in percent.
  std::vector<double> RecallPerQuery(size_t threshold) const;
  // Returns the area under the recall curve up to the threshold: 100 for no error at all, 0 beyond
  // it.
  std::vector<double> AucPerQuery(size_t threshold) const;
};

// Returns one result per setting, in order. Throws InputError where a scene's ground truth is
// damaged.
std::vector<SettingResult> CollectResults(const Experiment& experiment,
                                          std::span<const Setting> settings,
                                          std::span<const Cell> cells, const CellStore& store);

// Returns one line per setting and threshold, for tables and figures of other programs.
std::string FormatResultsCsv(std::span<const SettingResult> results);

// Writes the poses of the scenes without ground truth, SCENE/SETTING-SEED.txt, as a benchmark's
// server takes them. Returns the number of files.
size_t WriteSubmissions(const std::filesystem::path& folder, const Experiment& experiment,
                        std::span<const Setting> settings, std::span<const Cell> cells,
                        const CellStore& store);

enum class ClaimVerdict {
  kShown,         // better, which luck does not explain
  kHolds,         // of "not worse" alone: the interval ends above -kNotWorsePercent
  kNoise,         // the queries do not tell
  kContradicted,  // worse, which luck does not explain
};
template <>
inline constexpr auto kEnumNames<ClaimVerdict> = std::to_array<EnumName<ClaimVerdict>>({
    {ClaimVerdict::kShown, "shown"},
    {ClaimVerdict::kHolds, "holds"},
    {ClaimVerdict::kNoise, "noise"},
    {ClaimVerdict::kContradicted, "contradicted"},
});

// Returns 0 for no values.
double MeanOf(const std::vector<double>& values);

// A difference up to so many percentage points counts as not worse.
inline constexpr double kNotWorsePercent = 1;
// Holm's level (1979): lines whose difference survives his correction at it, over all claims
// together, count as shown or contradicted.
inline constexpr double kClaimLevel = 0.05;

struct ClaimLine {
  std::string place;          // "The demo, 1/5, mesh"
  std::string first, second;  // "Adaptive, sum. msac"
  std::string measure;        // "recall (0.1, 1deg)", "AUC (0.1, 1deg)"
  double first_percent = 0, second_percent = 0;
  Interval difference_percent;  // 95 %
  double p_value = 1;           // of the difference's direction, two-sided, before the correction
  ClaimVerdict verdict = ClaimVerdict::kNoise;
};

struct JudgedClaim {
  std::string name, text;
  std::vector<ClaimLine> lines;

  size_t Count(ClaimVerdict verdict) const;
};

// Judges each claim at every combination of the axes that are not of the method and that the claim
// leaves open. Where a claim has several opponents, the difference is that to the best of them,
// which every draw of the bootstrap looks for anew. AUC is judged beside the recalls, as these are
// the same for all where the data are easy.
std::vector<JudgedClaim> JudgeClaims(const Experiment& experiment,
                                     std::span<const SettingResult> results);

std::string FormatClaimsText(std::span<const JudgedClaim> claims);  // a summary
std::string FormatClaimsMarkdown(std::span<const JudgedClaim> claims);
std::string FormatClaimsCsv(std::span<const JudgedClaim> claims);

}  // namespace raylift
