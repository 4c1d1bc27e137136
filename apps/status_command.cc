// raylift status: how far the jobs of a folder are.

#include <memory>

#include "commands.h"
#include "interrupt.h"
#include "options.h"
#include <fmt/format.h>

#include "raylift/jobs/job_status.h"

namespace raylift {
namespace {

std::string_view StateName(ShardStatus::State state) {
  switch (state) {
    case ShardStatus::State::kDone:
      return "done";
    case ShardStatus::State::kRunning:
      return "running";
    case ShardStatus::State::kStopped:
      return "stopped or failed";
    case ShardStatus::State::kNotBegun:
      return "nothing done yet";
  }
  return {};
}

void PrintStatus(const JobStatus& status) {
  for (const ShardStatus& shard : status.shards) {
    if (status.shards.size() == 1) {
      fmt::print("{}: {}\n", status.command, StateName(shard.state));
    } else {
      fmt::print("shard {}/{}: {} of {}, {}\n", shard.shard.index, shard.shard.count, shard.done,
                 shard.tasks, StateName(shard.state));
    }
  }
  fmt::print("done: {} of {}\n", status.done, status.tasks);
  const std::string left = ShardsToSubmit(status);
  if (!left.empty() && status.shards.size() > 1) {
    fmt::print("to submit again: --array={} with --shard auto/{} --resume\n", left,
               status.shards.size());
  }
}

}  // namespace

Command AddStatusCommand(CLI::App& program) {
  auto out = std::make_shared<std::filesystem::path>();
  CLI::App* command = program.add_subcommand(
      "status", "How far a run with --shard and --resume is, and its shards");
  command->add_option("OUT", *out, "The folder of --out")->required();
  AddConfigOption(*command);
  command->footer(
      "The exit code is 0 where all is done, 4 where work is left.\n"
      "Example:\n"
      "  raylift status result || sbatch --array=... job.sh");
  return {command, [out] {
            const JobStatus status = ReadJobStatus(*out);
            PrintStatus(status);
            if (!status.IsComplete()) {
              throw Interrupted(fmt::format("{}: {} of {} are not done", out->string(),
                                            status.tasks - status.done, status.tasks));
            }
          }};
}

}  // namespace raylift
