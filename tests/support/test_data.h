// Where tests find files and may write them.

#pragma once

#include <filesystem>
#include <optional>
#include <string>

namespace raylift {

// A folder for the running test alone, empty at its start.
std::filesystem::path TestFolder();

// assets/demo.
std::filesystem::path DemoFolder();

// The folder of a real data set (e.g. "rgbd_small") where the environment variable
// RAYLIFT_TEST_DATA, or the folder shared/data beside the checkout, has it; a test skips otherwise:
//   const auto data = FindTestData("rgbd_small");
//   if (!data) GTEST_SKIP() << "rgbd_small is not on this machine";
std::optional<std::filesystem::path> FindTestData(const std::string& name);

// Runs a Debian tool or script (python3, colmap, ...) and returns its output; throws with the
// output if it fails. HasProgram() says whether it is installed.
bool HasProgram(const std::string& program);
std::string RunProgram(const std::string& command_line);

}  // namespace raylift
