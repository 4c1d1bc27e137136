#include "support/test_data.h"

#include <array>
#include <cstdio>
#include <cstdlib>
#include <stdexcept>

#include <gtest/gtest.h>
#include <sys/wait.h>

namespace raylift {

std::filesystem::path TestFolder() {
  const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
  std::string name = std::string(info->test_suite_name()) + "." + info->name();
  for (char& c : name) {
    if (c == '/') c = '_';
  }
  std::filesystem::path folder = std::filesystem::path(RAYLIFT_TEST_TEMP_DIR) / name;
  std::filesystem::remove_all(folder);
  std::filesystem::create_directories(folder);
  return folder;
}

std::filesystem::path DemoFolder() {
  return std::filesystem::path(RAYLIFT_SOURCE_DIR) / "assets" / "demo";
}

std::optional<std::filesystem::path> FindTestData(const std::string& name) {
  std::vector<std::filesystem::path> candidates;
  if (const char* variable = std::getenv("RAYLIFT_TEST_DATA")) {
    candidates.emplace_back(variable);
  }
  candidates.push_back(std::filesystem::path(RAYLIFT_SOURCE_DIR).parent_path() / "shared" / "data");
  for (const auto& candidate : candidates) {
    if (std::filesystem::is_directory(candidate / name)) {
      return candidate / name;
    }
  }
  return std::nullopt;
}

bool HasProgram(const std::string& program) {
  return std::system(("command -v " + program + " > /dev/null 2>&1").c_str()) == 0;
}

std::string RunProgram(const std::string& command_line) {
  FILE* pipe = popen((command_line + " 2>&1").c_str(), "r");
  if (pipe == nullptr) {
    throw std::runtime_error("cannot run: " + command_line);
  }
  std::string output;
  std::array<char, 4096> buffer;
  size_t count = 0;
  while ((count = fread(buffer.data(), 1, buffer.size(), pipe)) > 0) {
    output.append(buffer.data(), count);
  }
  const int status = pclose(pipe);
  if (!WIFEXITED(status) || WEXITSTATUS(status) != 0) {
    throw std::runtime_error("failed: " + command_line + "\n" + output);
  }
  return output;
}

}  // namespace raylift
