// Long commands that are stopped and killed, and what must not change by that.

#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "apps/program.h"
#include "base/rng.h"
#include <nlohmann/json.hpp>

namespace raylift {

// Without what a run measures of its own time.
void EraseTimes(nlohmann::ordered_json& json);
std::vector<std::string> LinesWithoutTimes(const std::filesystem::path& file);
std::string JsonWithoutTimes(const std::filesystem::path& file);

// The tasks that the manifests of a folder say are done.
size_t CountDone(const std::filesystem::path& out);

// Starts a run and ends it by `signal` when `count` tasks are done and some time has passed. Its
// exit code.
int Interrupt(const Arguments& command, const std::filesystem::path& out, int signal, size_t count,
              size_t microseconds);

// Stops a run when `count` tasks are done, removes a folder while nothing is written, and lets it
// go on. Its exit code.
int RemoveMidway(const Arguments& command, const std::filesystem::path& out, size_t count,
                 const std::filesystem::path& removed);

// Sends SIGTERM once the run takes it as a wish to stop. Its exit code.
int Terminate(pid_t process);

struct InterruptedRun {
  std::function<Arguments(const std::filesystem::path& out)> command;  // with --resume
  size_t tasks = 0;
  size_t start_microseconds = 0;  // until the first task may be done
  size_t task_microseconds = 0;
  std::string result;  // a file of a complete run
  // Of what a run leaves that was left alone, and one that was not.
  std::function<void(const std::filesystem::path& out)> expect_whole;
};

// Runs are interrupted at random moments, RAYLIFT_TEST_KILLS times or `default_rounds`, and then
// left alone. Their folders are in `folder`.
void InterruptAtRandom(const InterruptedRun& run, const std::filesystem::path& folder,
                       int default_rounds, Rng rng);

// The command where no file may be larger than so many blocks of 512 bytes, as on a full disk.
Arguments WithFullDisk(size_t blocks, const Arguments& command);

}  // namespace raylift
