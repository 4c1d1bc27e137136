// Which of a job's images this process does, so that machines share the work without talking.

#pragma once

#include <functional>
#include <optional>
#include <string>
#include <string_view>

namespace raylift {

// The images whose name's hash is `index` modulo `count`.
struct Shard {
  int index = 0;
  int count = 1;

  bool Contains(std::string_view name) const;
  bool IsAll() const { return count == 1; }
  bool operator==(const Shard&) const = default;
};

// "i/n". i counts from 1 to n or from 0 to n - 1, as the scheduler does: n / n is the same shard as
// 0 / n, so that either way all n are different. "auto" takes i and n from the environment, the
// first of these that is there:
//   SLURM_ARRAY_TASK_ID, SLURM_ARRAY_TASK_COUNT (array jobs; _MIN and _STEP are honoured)
//   OMPI_COMM_WORLD_RANK, OMPI_COMM_WORLD_SIZE
//   SLURM_PROCID, SLURM_NTASKS (srun)
// OptionError for anything else.
using Environment = std::function<std::optional<std::string>(const std::string&)>;
Shard ParseShard(const std::string& text, const Environment& environment);

// Of this process.
std::optional<std::string> EnvironmentVariable(const std::string& name);

}  // namespace raylift
