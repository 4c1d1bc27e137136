#include "apps/job_runs.h"

#include <csignal>
#include <cstdlib>
#include <fstream>

#include "jobs/manifest_file.h"
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include "raylift/base/file.h"
#include "raylift/base/text.h"

namespace raylift {

namespace fs = std::filesystem;
using OrderedJson = nlohmann::ordered_json;

void EraseTimes(OrderedJson& json) {
  if (!json.is_structured()) return;
  if (json.is_object()) {
    for (const char* name : {"milliseconds", "seconds", "match_ms", "lift_ms", "filter_ms",
                             "estimate_ms", "time_ms", "stage_seconds", "thread_seconds"}) {
      json.erase(name);
    }
  }
  for (OrderedJson& value : json) EraseTimes(value);
}

std::vector<std::string> LinesWithoutTimes(const fs::path& file) {
  std::vector<std::string> lines;
  for (const std::string& line : Lines(ReadFile(file))) {
    OrderedJson json = OrderedJson::parse(line);
    EraseTimes(json);
    lines.push_back(json.dump());
  }
  return lines;
}

std::string JsonWithoutTimes(const fs::path& file) {
  OrderedJson json = OrderedJson::parse(ReadFile(file));
  EraseTimes(json);
  return json.dump();
}

size_t CountDone(const fs::path& out) {
  size_t count = 0;
  for (const fs::path& manifest : ListManifests(out)) {
    count += ReadManifestText(manifest).CountTasks();
  }
  return count;
}

namespace {

pid_t StartUntil(size_t count, const Arguments& command, const fs::path& out) {
  const pid_t process = StartRaylift(command);
  while (count > 0 && CountDone(out) < count && !HasEnded(process)) usleep(1000);
  return process;
}

}  // namespace

int Interrupt(const Arguments& command, const fs::path& out, int signal, size_t count,
              size_t microseconds) {
  const pid_t process = StartUntil(count, command, out);
  usleep(static_cast<useconds_t>(microseconds));
  kill(process, signal);
  return WaitFor(process);
}

int RemoveMidway(const Arguments& command, const fs::path& out, size_t count,
                 const fs::path& removed) {
  const pid_t process = StartUntil(count, command, out);
  kill(process, SIGSTOP);
  siginfo_t stopped{};
  waitid(P_PID, static_cast<id_t>(process), &stopped, WSTOPPED | WEXITED | WNOWAIT);
  fs::remove_all(removed);
  kill(process, SIGCONT);
  return WaitFor(process);
}

int Terminate(pid_t process) {
  // The signals that are caught, as a mask.
  const auto catches = [process] {
    std::ifstream status("/proc/" + std::to_string(process) + "/status");
    for (std::string line; std::getline(status, line);) {
      if (!line.starts_with("SigCgt:")) continue;
      return (std::stoull(line.substr(7), nullptr, 16) >> (SIGTERM - 1) & 1) != 0;
    }
    return false;
  };
  while (!catches() && !HasEnded(process)) usleep(1000);
  kill(process, SIGTERM);
  return WaitFor(process);
}

void InterruptAtRandom(const InterruptedRun& run, const fs::path& folder, int default_rounds,
                       Rng rng) {
  const char* rounds_text = std::getenv("RAYLIFT_TEST_KILLS");
  const auto rounds = rounds_text != nullptr ? ParseInt(rounds_text) : std::nullopt;
  size_t interrupted = 0;
  for (int64_t i = 0; i < rounds.value_or(default_rounds); ++i) {
    const fs::path out = folder / ("round" + std::to_string(i));
    const int signal = i % 2 == 0 ? SIGKILL : SIGTERM;
    // Before the first task is done, or among them.
    const size_t count = rng.UniformIndex(run.tasks + 1);
    const size_t microseconds =
        rng.UniformIndex(count == 0 ? run.start_microseconds : run.task_microseconds);
    const Arguments command = run.command(out);
    const int code =
        Interrupt(command + Arguments{"--threads", "1"}, out, signal, count, microseconds);
    // Signals have their usual effect before the work has begun and when all is written.
    const bool at_an_end = count == 0 || fs::exists(out / run.result);
    EXPECT_TRUE(code == 0 || code == (signal == SIGKILL ? 128 + SIGKILL : 4) ||
                (at_an_end && code == 128 + SIGTERM))
        << code;
    interrupted += code == 0 ? 0 : 1;
    ASSERT_TRUE(Succeeds(RunRaylift(command)));
    run.expect_whole(out);
    if (::testing::Test::HasFailure()) {
      FAIL() << "round " << i << ", exit code " << code << ", " << count;
    }
    fs::remove_all(out);
  }
  EXPECT_GT(interrupted, 0u);
}

Arguments WithFullDisk(size_t blocks, const Arguments& command) {
  return Arguments{"/bin/sh", "-c", "ulimit -f " + std::to_string(blocks) + "; exec \"$@\"", "sh",
                   RAYLIFT_PROGRAM} +
         command;
}

}  // namespace raylift
