#include <atomic>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <new>
#include <string>
#include <vector>

#include "apps/mesh_trial.h"
#include "apps/program.h"
#include "io/hloc/hdf5_file.h"
#include <opencv2/core/utility.hpp>
#include <sys/resource.h>

namespace {

const std::terminate_handler kUsualEnd = std::get_terminate();

int FailWithoutMemory() {
  std::fputs("raylift: out of memory\n", stderr);
  return raylift::kNoResources;
}

std::atomic<bool> without_memory = false;

void NoteAndThrow() {
  without_memory = true;
  throw std::bad_alloc();
}

// Ends the program with a message where memory runs out in what must not throw (nlohmann's JSON
// takes some to destroy itself, the standard library to go through a folder): outputs appear only
// when they are whole, as in a run that is killed.
[[noreturn]] void End() {
  bool of_memory = without_memory;
  try {
    if (const auto error = std::current_exception()) std::rethrow_exception(error);
  } catch (const std::bad_alloc&) {
    of_memory = true;
  } catch (...) {  // a bug
    of_memory = false;
  }
  if (of_memory) std::_Exit(FailWithoutMemory());
  kUsualEnd();
  std::abort();
}

// Returns whether the stack is large enough: libraries use what they need, and too small a stack
// ends in a crash.
bool HasStack() {
  constexpr rlim_t kLeast = 1024 * 1024;
  struct rlimit limit {};
  return getrlimit(RLIMIT_STACK, &limit) != 0 || limit.rlim_cur >= kLeast;
}

}  // namespace

int main(int argc, char** argv) {
  if (!HasStack()) {
    std::fputs("raylift: the stack is limited to less than 1 MB: `ulimit -s 8192` helps\n", stderr);
    return raylift::kNoResources;
  }
  std::signal(SIGXFSZ, SIG_IGN);  // the write that is too large fails, and says so
  std::set_terminate(&End);
  std::set_new_handler(&NoteAndThrow);
  raylift::LeaveHdf5AsItIsAtExit();
  try {
    raylift::TryMeshesBy({"/proc/self/exe", raylift::kTryMesh});
    // Images are worked on side by side, on --threads; OpenCV's own threads would come on top.
    cv::setNumThreads(1);
    const int code = raylift::RunProgram(std::vector<std::string>(argv + 1, argv + argc));
    // Libraries report lack of memory as another error, such as a file that cannot be made.
    const bool is_of_files = code == raylift::kBadInput || code == raylift::kBadOutput;
    return is_of_files && without_memory ? FailWithoutMemory() : code;
  } catch (const std::bad_alloc&) {  // before the program runs, or where it says what was wrong
    return FailWithoutMemory();
  }
}
