#include "apps/mesh_trial.h"

#include <cerrno>
#include <csignal>
#include <exception>

#include <fcntl.h>
#include <spawn.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

bool Survives(std::vector<std::string> command, const std::filesystem::path& file) {
  command.push_back(file.string());
  std::vector<char*> arguments;
  for (std::string& argument : command) arguments.push_back(argument.data());
  arguments.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
  pid_t process = 0;
  const int error =
      posix_spawn(&process, arguments[0], &actions, nullptr, arguments.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  if (error != 0) return true;  // nothing can be told
  int status = 0;
  while (waitpid(process, &status, 0) < 0 && errno == EINTR) {
  }
  return WIFEXITED(status);
}

}  // namespace

void TryMeshesBy(const std::vector<std::string>& command) {
  SetMeshTrial([command](const std::filesystem::path& file) { return Survives(command, file); });
}

int TryMesh(const std::filesystem::path& file) {
  constexpr unsigned int kLongest_s = 600;
  alarm(kLongest_s);
  prctl(PR_SET_PDEATHSIG, SIGKILL);  // with the process that waits
  SetMeshTrial(nullptr);
  try {
    ReadMesh(file);
  } catch (const std::exception&) {  // is told by the process that goes on
  }
  return 0;
}

}  // namespace raylift
