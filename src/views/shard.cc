#include "raylift/views/shard.h"

#include <algorithm>
#include <cstdlib>
#include <limits>

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/rng.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

constexpr std::string_view kExpected =
    "expected i/n with 0 <= i <= n (i from 0 or from 1), or auto";

Shard MakeShard(int64_t index, int64_t count) {
  return {static_cast<int>(index % count), static_cast<int>(count)};
}

// A count or an index that a scheduler has set.
int64_t Number(const Environment& environment, const std::string& name) {
  const auto text = environment(name);
  if (!text) {
    throw OptionError("shard", "auto", fmt::format("{} is not in the environment", name));
  }
  const auto number = ParseInt(*text);
  if (!number || *number < 0 || *number > std::numeric_limits<int>::max()) {
    throw OptionError("shard", "auto",
                      fmt::format("expected {} to be a count, found \"{}\"", name, *text));
  }
  return *number;
}

int64_t NumberOr(const Environment& environment, const std::string& name, int64_t otherwise) {
  return environment(name) ? Number(environment, name) : otherwise;
}

Shard FromNumbers(const std::string& count_name, int64_t index, int64_t count) {
  if (count < 1 || index < 0 || index > count) {
    throw OptionError("shard", "auto",
                      fmt::format("task {} of {} = {} makes no sense", index, count_name, count));
  }
  return MakeShard(index, count);
}

Shard AutoShard(const Environment& environment) {
  if (environment("SLURM_ARRAY_TASK_ID")) {
    const int64_t id = Number(environment, "SLURM_ARRAY_TASK_ID");
    const int64_t first = NumberOr(environment, "SLURM_ARRAY_TASK_MIN", 0);
    const int64_t step = NumberOr(environment, "SLURM_ARRAY_TASK_STEP", 1);
    return FromNumbers("SLURM_ARRAY_TASK_COUNT", (id - first) / std::max<int64_t>(step, 1),
                       Number(environment, "SLURM_ARRAY_TASK_COUNT"));
  }
  if (environment("OMPI_COMM_WORLD_RANK")) {
    return FromNumbers("OMPI_COMM_WORLD_SIZE", Number(environment, "OMPI_COMM_WORLD_RANK"),
                       Number(environment, "OMPI_COMM_WORLD_SIZE"));
  }
  if (environment("SLURM_PROCID")) {
    return FromNumbers("SLURM_NTASKS", Number(environment, "SLURM_PROCID"),
                       Number(environment, "SLURM_NTASKS"));
  }
  throw OptionError("shard", "auto",
                    "found none of SLURM_ARRAY_TASK_ID, OMPI_COMM_WORLD_RANK and SLURM_PROCID in "
                    "the environment");
}

}  // namespace

bool Shard::Contains(std::string_view name) const {
  return StreamSeed(0, name, "shard") % static_cast<uint64_t>(count) ==
         static_cast<uint64_t>(index);
}

Shard ParseShard(const std::string& text, const Environment& environment) {
  if (text == "auto") return AutoShard(environment);
  const auto parts = SplitBy(text, '/');
  const auto index = ParseInt(parts.front());
  const auto count = ParseInt(parts.back());
  if (parts.size() != 2 || !index || !count || *count < 1 || *index < 0 || *index > *count ||
      *count > std::numeric_limits<int>::max()) {
    throw OptionError("shard", text, kExpected);
  }
  return MakeShard(*index, *count);
}

std::optional<std::string> EnvironmentVariable(const std::string& name) {
  const char* value = std::getenv(name.c_str());
  return value != nullptr ? std::optional<std::string>(value) : std::nullopt;
}

}  // namespace raylift
