// SIGINT and SIGTERM as a wish to stop soon: long commands finish what they have in hand.

#pragma once

#include <atomic>
#include <functional>
#include <stdexcept>
#include <string>

namespace raylift {

// A command was stopped by a signal and has left all in order, or else found that work is left.
// Exit code 4.
class Interrupted : public std::runtime_error {
 public:
  explicit Interrupted(const std::string& message) : std::runtime_error(message) {}
};

// While one exists, the first signal sets stop(); a second one ends the program at once. So does
// the end of 4 s in which the first one was not heeded, as in the midst of a large file: with its
// exit code, and as outputs appear when they are whole, what is there is good. Where the call is
// watched (base/parallel.h), signals are the watcher's.
class SignalGuard {
 public:
  SignalGuard();
  ~SignalGuard();
  SignalGuard(const SignalGuard&) = delete;
  SignalGuard& operator=(const SignalGuard&) = delete;

  static const std::atomic<bool>& stop();
};

// Does work that a signal ends before it or between two items of its loops. Throws Interrupted with
// what `message` then says.
void UntilSignal(const std::function<void()>& work, const std::function<std::string()>& message);
// Work that leaves nothing to go on with: what comes before the first task,
void UntilSignal(const std::function<void()>& work);
// and, as `message`, a whole command.
std::string BeginsAnew();

}  // namespace raylift
