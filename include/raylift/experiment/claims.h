// Whether an experiment shows what its file claims: the paired bootstrap over the queries says for
// each place where a claim applies whether a difference is more than luck.

#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "raylift/base/enum_names.h"
#include "raylift/evaluation/bootstrap.h"
#include "raylift/experiment/experiment.h"
#include "raylift/experiment/results.h"

namespace raylift {

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

// What counts as not worse: a percentage point.
inline constexpr double kNotWorsePercent = 1;
// Of all lines of all claims together, shown and contradicted are those whose difference survives
// Holm's correction (1979) at this level.
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

// Where a claim has several opponents, the difference is that to the best of them, which every draw
// of the bootstrap looks for anew. Each claim at every combination of the axes that are not of the
// method and that the claim leaves open. AUC is judged beside the recalls, as these are the same
// for all where the data are easy.
std::vector<JudgedClaim> JudgeClaims(const Experiment& experiment,
                                     std::span<const SettingResult> results);

std::string FormatClaimsText(std::span<const JudgedClaim> claims);  // a summary
std::string FormatClaimsMarkdown(std::span<const JudgedClaim> claims);
std::string FormatClaimsCsv(std::span<const JudgedClaim> claims);

}  // namespace raylift
