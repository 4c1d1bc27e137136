#include "raylift/jobs/shard.h"

#include <array>
#include <cstdlib>
#include <limits>
#include <string_view>
#include <vector>

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

constexpr std::string_view kExpected =
    "expected i/n with 0 <= i <= n (i from 0 or from 1), auto, or auto/N";

// The variables by which a launcher tells a process its rank and their count.
struct Launcher {
  enum class Kind {
    kArray,  // jobs that are submitted together; each may be several tasks
    kTasks,  // processes of one parallel run
    kStep,   // the same, but perhaps only what mpirun has started its own helpers by
    kLoose,  // the same by names that scripts use for anything: counts only where both are there
  };
  std::string_view name;
  Kind kind;
  std::string_view index;
  std::string_view count = {};  // empty: is not told
  // These are for arrays whose indices are first, first + step, ..., last; `count` checks them.
  std::string_view first = {}, last = {}, step = {};
};

using enum Launcher::Kind;
constexpr auto kLaunchers = std::to_array<Launcher>({
    {"Slurm array", kArray, "SLURM_ARRAY_TASK_ID", "SLURM_ARRAY_TASK_COUNT", "SLURM_ARRAY_TASK_MIN",
     "SLURM_ARRAY_TASK_MAX", "SLURM_ARRAY_TASK_STEP"},
    {"SGE array",
     kArray,
     "SGE_TASK_ID",
     {},
     "SGE_TASK_FIRST",
     "SGE_TASK_LAST",
     "SGE_TASK_STEPSIZE"},
    {"PBS array", kArray, "PBS_ARRAY_INDEX"},
    {"Torque array", kArray, "PBS_ARRAYID"},
    {"AWS Batch array", kArray, "AWS_BATCH_JOB_ARRAY_INDEX", "AWS_BATCH_JOB_ARRAY_SIZE"},
    {"Kubernetes indexed job", kArray, "JOB_COMPLETION_INDEX"},
    {"Open MPI", kTasks, "OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE"},
    {"MPI (PMI)", kTasks, "PMI_RANK", "PMI_SIZE"},
    {"MPI (PMIx)", kTasks, "PMIX_RANK"},
    {"WORLD_SIZE", kLoose, "RANK", "WORLD_SIZE"},
    {"srun", kStep, "SLURM_PROCID", "SLURM_STEP_NUM_TASKS"},
});

// A process's rank and their count, as one launcher tells it.
struct Rank {
  std::string_view launcher;
  Launcher::Kind kind;
  std::string_view variable;  // of the index
  int64_t index;
  std::optional<int64_t> count;  // nullopt: not told

  std::string Text() const {
    return fmt::format("{}: {} of {}", launcher, index, count ? std::to_string(*count) : "?");
  }
};

// The ranks that the environment tells.
class LauncherRanks {
 public:
  // `text` is the option's, for errors; `total` is the N of "auto/N".
  LauncherRanks(std::string text, std::optional<int64_t> total, const Environment& environment)
      : text_(std::move(text)), total_(total), environment_(environment) {}

  [[noreturn]] void Fail(const std::string& why) const { throw OptionError("shard", text_, why); }

  std::optional<int64_t> Number(std::string_view name) const {
    if (name.empty()) return std::nullopt;
    const auto text = Text(name);
    if (!text) return std::nullopt;
    const auto number = ParseInt(*text);
    if (!number || *number < 0 || *number > std::numeric_limits<int>::max()) {
      Fail(fmt::format("expected {} to be a count, found \"{}\"", name, *text));
    }
    return number;
  }

  std::vector<Rank> Of(std::initializer_list<Launcher::Kind> kinds) const {
    std::vector<Rank> ranks;
    for (const Launcher& launcher : kLaunchers) {
      for (const Launcher::Kind kind : kinds) {
        if (launcher.kind == kind && IsThere(launcher)) ranks.push_back(RankOf(launcher));
      }
    }
    return ranks;
  }

 private:
  std::optional<std::string> Text(std::string_view name) const {
    return environment_(std::string(name));
  }

  bool IsThere(const Launcher& launcher) const {
    const auto text = Text(launcher.index);
    if (launcher.kind == kLoose && !Text(launcher.count)) return false;
    return text && *text != "undefined";  // SGE says so outside of arrays
  }

  // Returns the index, counted from 0, and the count of an array with a first, a last and a step.
  Rank RangeRank(const Launcher& launcher, int64_t id) const {
    const auto first = Number(launcher.first);
    const auto last = Number(launcher.last);
    const auto step = Number(launcher.step);
    const std::optional<int64_t> count = Number(launcher.count);  // nullopt where it has no name
    const std::string remedy =
        fmt::format("; say of how many it is one: auto/N where the indices count from 0, or ${}/N",
                    launcher.index);
    if (!first || !last || !step || (!launcher.count.empty() && !count)) {
      Fail(fmt::format("{} = {}, but the environment does not tell of which indices{}",
                       launcher.index, id, remedy));
    }
    const bool regular = *step > 0 && id >= *first && id <= *last && (id - *first) % *step == 0 &&
                         (!count || *last - *first == *step * (*count - 1));
    if (!regular) {
      Fail(fmt::format(
          "the indices of the {} are not evenly spaced: {} of {}{} to {} by {}, so that its place "
          "among them is not known{}",
          launcher.name, id, count ? std::to_string(*count) + " from " : "", *first, *last, *step,
          remedy));
    }
    if (*last == *first) {
      Fail(fmt::format("the {} has one task, {}, as when a part is submitted again{}; 0/1 is all",
                       launcher.name, id, remedy));
    }
    return {launcher.name, launcher.kind, launcher.index, (id - *first) / *step,
            (*last - *first) / *step + 1};
  }

  Rank RankOf(const Launcher& launcher) const {
    const int64_t index = *Number(launcher.index);
    const bool counted_by_user = launcher.kind == kArray && total_;
    if (counted_by_user) return {launcher.name, launcher.kind, launcher.index, index, total_};
    if (!launcher.first.empty()) return RangeRank(launcher, index);
    return {launcher.name, launcher.kind, launcher.index, index, Number(launcher.count)};
  }

  std::string text_;
  std::optional<int64_t> total_;
  const Environment& environment_;
};

class AutoShard {
 public:
  // `total` is the N of "auto/N".
  AutoShard(std::string text, std::optional<int64_t> total, const Environment& environment)
      : total_(total), ranks_(std::move(text), total, environment) {}

  Shard Resolve() const {
    const auto array = Array();
    const auto task = Task(array.has_value());
    if (!array && !task) FailWithoutLauncher();
    const Rank& rank = array ? *array : *task;
    int64_t index = rank.index;
    int64_t count = rank.count.value_or(1);
    if (array && task) {
      index = index * *task->count + task->index;
      count *= *task->count;
    }
    if (count > std::numeric_limits<int>::max()) ranks_.Fail("these are too many shards");
    return {static_cast<int>(index), static_cast<int>(count)};
  }

 private:
  void RequireInRange(const Rank& rank) const {
    if (rank.index < *rank.count) return;
    ranks_.Fail(
        fmt::format("{} = {} is not below {}{}", rank.variable, rank.index, *rank.count,
                    rank.kind == kArray
                        ? fmt::format(": count the indices from 0, or give ${}/{}, which may count "
                                      "from 1 as well",
                                      rank.variable, *rank.count)
                        : ""));
  }

  [[noreturn]] void FailByContradiction(const Rank& a, const Rank& b) const {
    ranks_.Fail(
        fmt::format("the environment says two things ({}; {}): give i/n", a.Text(), b.Text()));
  }

  // Returns the rank of this job in its array.
  std::optional<Rank> Array() const {
    const std::vector<Rank> ranks = ranks_.Of({kArray});
    if (ranks.empty()) return std::nullopt;
    if (ranks.size() > 1) FailByContradiction(ranks[0], ranks[1]);
    const Rank& rank = ranks.front();
    if (!rank.count) {
      ranks_.Fail(
          fmt::format("{} = {}, but a {} does not tell of how many: give auto/N where the indices "
                      "count from 0, or ${}/N",
                      rank.variable, rank.index, rank.launcher, rank.variable));
    }
    RequireInRange(rank);
    return rank;
  }

  // Returns the rank on which all of these agree.
  Rank Common(const std::vector<Rank>& ranks) const {
    Rank common = ranks.front();
    for (const Rank& rank : ranks) {
      if (rank.index != common.index ||
          (rank.count && common.count && *rank.count != *common.count)) {
        FailByContradiction(common, rank);
      }
      if (rank.count) common = rank;
    }
    return common;
  }

  // Returns the rank of this process in a parallel run.
  std::optional<Rank> Task(bool in_array) const {
    std::vector<Rank> tasks = ranks_.Of({kTasks, kLoose});
    const std::vector<Rank> steps = ranks_.Of({kStep});
    const bool has_step = !steps.empty() && steps.front().count;
    if (tasks.empty() && !has_step) return WithoutStep(in_array);
    const auto loose_only = tasks.size() == 1 && tasks.front().kind == kLoose && !has_step;
    if (in_array && loose_only && *tasks.front().count > 1) {
      ranks_.Fail(
          "RANK and WORLD_SIZE beside a job array may mean its jobs or tasks within one: give "
          "i/n");
    }
    if (has_step) CheckStep(steps.front());
    if (tasks.empty()) tasks = steps;
    Rank task = Common(tasks);
    if (has_step) task = UnderStep(task, steps.front());
    if (!task.count && !in_array) task.count = total_;
    if (!task.count) {
      ranks_.Fail(fmt::format("{} = {}, but its launcher does not tell of how many: give {}",
                              task.variable, task.index, in_array ? "i/n" : "auto/N"));
    }
    if (total_ && !in_array && *total_ != *task.count) {
      ranks_.Fail(fmt::format("{} has started {} tasks", task.launcher, *task.count));
    }
    RequireInRange(task);
    return task;
  }

  // Returns the rank that counts. mpirun starts its helpers by srun, one on each machine, whose
  // numbers the processes then see: the task's rank counts then. But each of several tasks that has
  // a run of its own would do the same.
  Rank UnderStep(const Rank& task, const Rank& step) const {
    if (task.kind == kStep) return task;
    if (!task.count || *task.count < *step.count) {
      return Common({task, step});
    }
    return task;
  }

  // Fails where SLURM_NTASKS and the step disagree: srun sets both, and one of them may be left
  // over from where the job was submitted.
  void CheckStep(const Rank& step) const {
    const auto tasks = ranks_.Number("SLURM_NTASKS");
    if (tasks && *tasks != *step.count && ranks_.Of({kTasks}).empty()) {
      ranks_.Fail(
          fmt::format("SLURM_NTASKS = {} and SLURM_STEP_NUM_TASKS = {} disagree: start it by srun, "
                      "or give i/n",
                      *tasks, *step.count));
    }
  }

  // Returns the rank of a job of Slurm that runs one process, whatever it has asked for; nullopt in
  // an array, and outside of Slurm. Fails where the job has several tasks.
  std::optional<Rank> WithoutStep(bool in_array) const {
    if (in_array) return std::nullopt;
    const auto tasks = ranks_.Number("SLURM_NTASKS");
    const auto index = ranks_.Number("SLURM_PROCID");
    if (!tasks && !index) return std::nullopt;
    if (tasks.value_or(1) == 1 && index.value_or(0) == 0) {
      return Rank{"Slurm", kStep, "SLURM_PROCID", 0, 1};
    }
    ranks_.Fail(
        fmt::format("the Slurm job has {} tasks, but this process is not started by srun and would "
                    "be the only one: put srun before the command, or give i/n",
                    tasks ? std::to_string(*tasks) : "several"));
  }

  [[noreturn]] void FailWithoutLauncher() const {
    std::vector<std::string_view> names;
    names.reserve(kLaunchers.size());
    for (const Launcher& launcher : kLaunchers) names.push_back(launcher.index);
    ranks_.Fail(
        fmt::format("found none of {} in the environment: give i/n", fmt::join(names, ", ")));
  }

  std::optional<int64_t> total_;
  LauncherRanks ranks_;
};

}  // namespace

Shard ParseShard(const std::string& text, const Environment& environment) {
  if (text == "auto") return AutoShard(text, std::nullopt, environment).Resolve();
  const auto parts = SplitBy(text, '/');
  const auto count = ParseInt(parts.back());
  if (parts.size() != 2 || !count || *count < 1 || *count > std::numeric_limits<int>::max()) {
    throw OptionError("shard", text, std::string(kExpected));
  }
  if (parts.front() == "auto") return AutoShard(text, count, environment).Resolve();
  const auto index = ParseInt(parts.front());
  if (!index || *index < 0 || *index > *count) {
    throw OptionError("shard", text, std::string(kExpected));
  }
  return {static_cast<int>(*index % *count), static_cast<int>(*count)};
}

std::optional<std::string> EnvironmentVariable(const std::string& name) {
  const char* value = std::getenv(name.c_str());
  return value != nullptr ? std::optional<std::string>(value) : std::nullopt;
}

}  // namespace raylift
