#include "apps/program.h"

#include <algorithm>
#include <cstdio>
#include <sstream>
#include <utility>

#include "support/matchers.h"
#include "support/test_data.h"
#include <nlohmann/json.hpp>
#include <sys/wait.h>
#include <unistd.h>

#include "raylift/base/file.h"
#include "raylift/io/query_list.h"

namespace raylift {

namespace fs = std::filesystem;

Arguments operator+(Arguments a, const Arguments& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

CommandResult RunRaylift(const Arguments& arguments) {
  CommandResult result = RunProcess(Arguments{RAYLIFT_PROGRAM} + arguments);
  std::istringstream lines(std::exchange(result.err, ""));
  for (std::string line; std::getline(lines, line);) {
    const bool is_progress = line.find(" / ") != std::string::npos && line.ends_with(" left");
    if (!is_progress) result.err += line + (lines.eof() ? "" : "\n");
  }
  return result;
}

pid_t StartRaylift(const Arguments& arguments) {
  Arguments all = Arguments{RAYLIFT_PROGRAM} + arguments;
  std::vector<char*> argv;
  for (std::string& argument : all) argv.push_back(argument.data());
  argv.push_back(nullptr);
  std::fflush(nullptr);
  const pid_t process = fork();
  if (process == 0) {
    if (std::freopen("/dev/null", "w", stdout) == nullptr) _exit(126);
    if (std::freopen("/dev/null", "w", stderr) == nullptr) _exit(126);
    execv(argv[0], argv.data());
    _exit(127);
  }
  return process;
}

int WaitFor(pid_t process) {
  int status = 0;
  waitpid(process, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

bool HasEnded(pid_t process) {
  siginfo_t ended{};
  waitid(P_PID, static_cast<id_t>(process), &ended, WEXITED | WNOHANG | WNOWAIT);
  return ended.si_pid != 0;
}

Arguments HlocMatches(const RoomScene& scene) {
  return {"--queries", scene.query_list(), "--features", scene.features(),
          "--matches", scene.matches(),    "--pairs",    scene.pairs()};
}

Arguments LocalizeWithHloc(const RoomScene& scene, const fs::path& out) {
  return Arguments{"localize", "--model", scene.model(), "--geometry",
                   "mesh:" + scene.mesh().string()} +
         HlocMatches(scene) + Arguments{"--out", out};
}

Arguments LocalizeFromImages(const RoomScene& scene, const fs::path& out) {
  return {"localize",
          "--model",
          scene.model(),
          "--geometry",
          "mesh:" + scene.mesh().string(),
          "--queries",
          scene.query_list(),
          "--images",
          scene.images(),
          "--out",
          out};
}

Arguments LocalizeDemo(const fs::path& cache, const fs::path& out) {
  const fs::path demo = DemoFolder();
  return Arguments{"localize", "--model", demo / "model", "--images", demo / "images"} +
         Arguments{"--geometry", "mesh:" + (demo / "scene.obj").string()} +
         Arguments{"--queries", demo / "queries.txt", "--cache", cache, "--out", out};
}

::testing::AssertionResult Succeeds(const CommandResult& result) {
  if (result.exit_code == 0 && result.err.empty()) {
    return ::testing::AssertionSuccess();
  }
  return ::testing::AssertionFailure()
         << "exit code " << result.exit_code << ", stderr: " << result.err;
}

::testing::AssertionResult FailsWith(int exit_code, const std::vector<std::string>& parts,
                                     const CommandResult& result) {
  const auto failure = [&] {
    return ::testing::AssertionFailure()
           << "exit code " << result.exit_code << ", stderr: " << result.err;
  };
  if (result.exit_code != exit_code) {
    return failure() << "(expected exit code " << exit_code << ")";
  }
  if (Lines(result.err).size() != 1) {
    return failure() << "(expected one line)";
  }
  for (const std::string& part : parts) {
    if (result.err.find(part) == std::string::npos) {
      return failure() << "(expected \"" << part << "\" in it)";
    }
  }
  if (!result.out.empty()) {
    return failure() << "(expected nothing on stdout, found " << result.out << ")";
  }
  return ::testing::AssertionSuccess();
}

std::vector<std::string> Lines(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) {
    lines.push_back(line);
  }
  return lines;
}

std::map<std::string, std::string> Diagnostics(const fs::path& file) {
  std::map<std::string, std::string> diagnostics;
  for (const std::string& line : Lines(ReadFile(file))) {
    auto json = nlohmann::ordered_json::parse(line);
    EXPECT_FALSE(json.contains("milliseconds"));
    EXPECT_TRUE(diagnostics.emplace(json.at("name"), json.dump()).second);
  }
  return diagnostics;
}

std::map<std::string, std::string> PoseLines(const fs::path& file) {
  std::map<std::string, std::string> poses;
  for (const std::string& line : Lines(ReadFile(file))) {
    EXPECT_TRUE(poses.emplace(line.substr(0, line.find(' ')), line).second);
  }
  return poses;
}

::testing::AssertionResult HoldsTruePoses(const fs::path& pose_file,
                                          const std::vector<PosedImage>& queries, double deg,
                                          double units) {
  const std::vector<NamedPose> poses = ReadPoseFile(pose_file);
  if (poses.size() != queries.size()) {
    return ::testing::AssertionFailure() << poses.size() << " poses of " << queries.size();
  }
  for (const PosedImage& query : queries) {
    const auto pose = std::find_if(poses.begin(), poses.end(),
                                   [&](const NamedPose& p) { return p.name == query.name; });
    if (pose == poses.end()) {
      return ::testing::AssertionFailure() << "no pose of " << query.name;
    }
    const auto near = IsNearPose(pose->cam_from_world, query.cam_from_world, deg, units);
    if (!near) {
      return ::testing::AssertionFailure() << query.name << ": " << near.message();
    }
  }
  return ::testing::AssertionSuccess();
}

std::vector<std::string> FilesBelow(const fs::path& folder) {
  std::vector<std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (!entry.is_directory()) {
      files.push_back(fs::relative(entry.path(), folder).string());
    }
  }
  std::sort(files.begin(), files.end());
  return files;
}

void Replace(const fs::path& file, const std::string& from, const std::string& to) {
  std::string text = ReadFile(file);
  const size_t position = text.find(from);
  ASSERT_NE(position, std::string::npos) << "no \"" << from << "\" in " << file;
  WriteFile(file, text.replace(position, from.size(), to));
}

}  // namespace raylift
