// Turns SIGINT and SIGTERM into a request to stop soon: long commands finish what they have in
// hand.

#pragma once

#include <atomic>
#include <functional>
#include <stdexcept>
#include <string>

namespace raylift {

// Is thrown where a signal stopped a command, which has left all files in order, or where work is
// left. The exit code is 4.
class Interrupted : public std::runtime_error {
 public:
  explicit Interrupted(const std::string& message) : std::runtime_error(message) {}
};

// While one exists, the first signal sets stop() and a second one ends the program at once. The
// program also ends, with exit code 4, where the first signal is not heeded within 4 s, as in the
// midst of a large file; what is written by then is good, as outputs appear only when they are
// whole. Where the call is watched (base/parallel.h), signals are left to the watcher.
class SignalGuard {
 public:
  SignalGuard();
  ~SignalGuard();
  SignalGuard(const SignalGuard&) = delete;
  SignalGuard& operator=(const SignalGuard&) = delete;

  static const std::atomic<bool>& stop();
};

// Does work that a signal ends before it begins or between two iterations of its loops. Throws
// Interrupted with the text of `message` then.
void UntilSignal(const std::function<void()>& work, const std::function<std::string()>& message);
// Does work that comes before the first task, after which there is nothing to resume.
void UntilSignal(const std::function<void()>& work);
// Returns the message of a whole command that cannot be resumed.
std::string BeginsAnew();

}  // namespace raylift
