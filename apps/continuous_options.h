// The options of continuous localization: `localize --continuous`.

#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "apps/command_line.h"

#include "raylift/localization/continuous_gate.h"
#include "raylift/localization/references.h"
#include "raylift/scene/photographs.h"

namespace raylift {

struct ContinuousFlags {
  bool enabled = false;
  std::filesystem::path times;
  std::optional<int> max_joined;
  bool trust_joined = false;
  bool join_any_difference = false;
  JoinGateOptions gate;

  // Throws OptionError.
  void Check() const;
  JoinGateOptions Gate() const;
  // Of the `top_k` references of a query.
  int MaxJoined(int top_k) const;
  // By the times file, or by name where there is none.
  std::vector<size_t> Order(std::span<const Query> queries, const ReferenceSet& references) const;
};
void AddContinuousOptions(CLI::App& command, ContinuousFlags& flags);

// Equal for runs that give the same results: a hash of the effective options, but for those that
// change no result, of the references, and of the queries in their order.
std::string ContinuousRunKey(const std::string& options_json, const ReferenceSet& references,
                             std::span<const Query> queries, std::span<const size_t> order);

}  // namespace raylift
