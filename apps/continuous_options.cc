#include "apps/continuous_options.h"

#include <algorithm>
#include <utility>

#include "apps/options.h"
#include "base/hash.h"
#include "localization/fields.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/io/scene_file.h"
#include "raylift/localization/continuous_order.h"

namespace raylift {

void ContinuousFlags::Check() const {
  const auto needs_continuous = [this](std::string_view option, bool given) {
    if (given && !enabled) throw OptionError(fmt::format("{} needs --continuous", option));
  };
  needs_continuous("--times", !times.empty());
  needs_continuous("--max-joined", max_joined.has_value());
  needs_continuous("--trust-joined", trust_joined);
  if (max_joined) RequireAtLeast("--max-joined", *max_joined, 0);
  gate.Validate();
}

JoinGateOptions ContinuousFlags::Gate() const {
  JoinGateOptions options = gate;
  options.needs_agreement = !join_any_difference;
  return options;
}

int ContinuousFlags::MaxJoined(int top_k) const {
  return std::min(max_joined.value_or(std::max(1, top_k / 2)), top_k);
}

std::vector<size_t> ContinuousFlags::Order(std::span<const Query> queries,
                                           const ReferenceSet& references) const {
  if (times.empty()) return OrderByName(queries);
  return OrderByTime(queries, references.images, ReadTimes(times), times);
}

void AddContinuousOptions(CLI::App& command, ContinuousFlags& flags) {
  const OptionGroup group(command, "Continuous localization");
  group.Flag("--continuous", flags.enabled,
             "Localize one query after the other; each that is localized well\n"
             "becomes a reference for those that follow");
  group.Add("--times", flags.times,
            "Their order: lines `name seconds` of queries and references. Those\n"
            "older than the references first, backwards (default: by name)");
  group.Add("--max-joined", flags.max_joined,
            "Joined queries among a query's references (default: half of --top-k)");
  group.Flag("--trust-joined", flags.trust_joined, "Take the poses of joined queries for exact");
  group.Add(FieldsOf(flags.gate));
  group.Flag("--join-any-difference", flags.join_any_difference,
             "Do not ask for poses by P3P and E5+1 alone");
}

std::string ContinuousRunKey(const std::string& options_json, const ReferenceSet& references,
                             std::span<const Query> queries, std::span<const size_t> order) {
  auto options = nlohmann::ordered_json::parse(options_json);
  for (const char* name : {"threads", "quiet", "resume", "overwrite", "shard", "config", "cache",
                           "report", "pictures", "write-problems", "no-doctor", "out", "times"}) {
    options.erase(name);
  }
  std::string text = options.dump();
  for (const PosedImage& image : references.images) {
    const Eigen::Quaterniond& q = image.cam_from_world.rotation;
    const Eigen::Vector3d& t = image.cam_from_world.translation;
    text += fmt::format("\n{} {} {} {} {} {} {} {} {}", image.name, image.camera.ToString(), q.w(),
                        q.x(), q.y(), q.z(), t.x(), t.y(), t.z());
  }
  for (const size_t i : order) {
    text += fmt::format("\n{} {}", queries[i].name, queries[i].camera.ToString());
  }
  return HexText(HashBytes64(text));
}

}  // namespace raylift
