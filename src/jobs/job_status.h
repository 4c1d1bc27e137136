// Tells the progress of a job by its manifests.

#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "raylift/jobs/shard.h"

namespace raylift {

struct ShardStatus {
  enum class State {
    kDone,
    kRunning,   // as far as the file system has locks
    kStopped,   // killed, stopped or failed
    kNotBegun,  // or nothing is done yet
  };

  Shard shard;
  State state = State::kNotBegun;
  size_t tasks = 0;
  size_t done = 0;
};

struct JobStatus {
  std::string command;  // of raylift
  size_t tasks = 0;
  size_t done = 0;
  std::vector<ShardStatus> shards;  // all of them; of a whole job one

  bool IsComplete() const { return done >= tasks; }
};

// Throws InputError where the folder holds no job, or parts of different ones.
JobStatus ReadJobStatus(const std::filesystem::path& out);

// Returns "0,3-5", the shards that are neither done nor at work, as job arrays take them.
std::string ShardsToSubmit(const JobStatus& status);

}  // namespace raylift
