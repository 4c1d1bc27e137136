// Chooses the tasks of a job (images, queries) that this process does, so that machines share the
// work without communication.

#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <string>

namespace raylift {

// A part of a job. Tasks are dealt in turn: of a list that all parts have in the same order, the
// task at `position` belongs to part `position` modulo `count`. Sizes differ by one at most.
struct Shard {
  int index = 0;
  int count = 1;

  bool Contains(size_t position) const {
    return position % static_cast<size_t>(count) == static_cast<size_t>(index);
  }
  bool IsAll() const { return count == 1; }
  bool operator==(const Shard&) const = default;
};

// Parses "i/n": i counts from 1 to n or from 0 to n - 1, as the scheduler does: n / n is the same
// shard as 0 / n, so that either way all n are different.
// "auto": i and n are read from the environment that a launcher sets (the table in shard.cc): a job
// array, the tasks of srun or mpirun, or an array of such tasks. Throws OptionError with the way
// out wherever a shard could be lost or done twice. "auto/N": the same where N is not told or not
// the whole: an array's index is i and counts from 0. Throws OptionError for anything else.
using Environment = std::function<std::optional<std::string>(const std::string&)>;
Shard ParseShard(const std::string& text, const Environment& environment);

// Returns a variable of this process's environment.
std::optional<std::string> EnvironmentVariable(const std::string& name);

}  // namespace raylift
