// Runs the built program and reads what it writes.

#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "support/room_scene.h"
#include "support/run_command.h"
#include <gtest/gtest.h>
#include <sys/types.h>

#include "raylift/geometry/rigid3.h"

namespace raylift {

using Arguments = std::vector<std::string>;
Arguments operator+(Arguments a, const Arguments& b);

// Leaves out the lines of progress that a run of more than a minute writes to stderr.
CommandResult RunRaylift(const Arguments& arguments);

// Starts the program and does not wait for it; its output is lost.
pid_t StartRaylift(const Arguments& arguments);
// Its exit code, as RunRaylift() has it.
int WaitFor(pid_t process);
// It can still be waited for.
bool HasEnded(pid_t process);

// The options of a scene's queries with hloc's files.
Arguments HlocMatches(const RoomScene& scene);

// `localize` with hloc's files and the mesh, to `out`.
Arguments LocalizeWithHloc(const RoomScene& scene, const std::filesystem::path& out);
// `localize` from the images and the mesh, to `out`.
Arguments LocalizeFromImages(const RoomScene& scene, const std::filesystem::path& out);

// `localize` of the demo's queries from the images and the mesh, to `out`.
Arguments LocalizeDemo(const std::filesystem::path& cache, const std::filesystem::path& out);

// Exit code 0 and nothing on stderr.
::testing::AssertionResult Succeeds(const CommandResult& result);
// This exit code and one line on stderr, which contains each of `parts`.
::testing::AssertionResult FailsWith(int exit_code, const std::vector<std::string>& parts,
                                     const CommandResult& result);

std::vector<std::string> Lines(const std::string& text);

// The lines of queries.jsonl, by name, without the times.
std::map<std::string, std::string> Diagnostics(const std::filesystem::path& file);

// The lines of a pose file by name.
std::map<std::string, std::string> PoseLines(const std::filesystem::path& file);

// Every pose of the file is within these of the truth, and all queries are there.
::testing::AssertionResult HoldsTruePoses(const std::filesystem::path& pose_file,
                                          const std::vector<PosedImage>& queries, double deg,
                                          double units);

// All files below a folder, relative to it, sorted.
std::vector<std::string> FilesBelow(const std::filesystem::path& folder);

// Replaces the first `from` in a text file, which must hold it.
void Replace(const std::filesystem::path& file, const std::string& from, const std::string& to);

}  // namespace raylift
