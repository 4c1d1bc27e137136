#include "apps/interrupt.h"

#include <csignal>
#include <string_view>

#include "apps/program.h"
#include <unistd.h>

#include "raylift/base/parallel.h"

namespace raylift {
namespace {

std::atomic<bool> stop_wanted{false};
static_assert(std::atomic<bool>::is_always_lock_free, "set by a signal handler");

constexpr unsigned kSecondsToEnd = 4;

void OnSignal(int) {
  stop_wanted = true;
  alarm(kSecondsToEnd);
}

void OnAlarm(int) {
  constexpr std::string_view kMessage =
      "raylift: stopped by a signal in the midst of its work; but for the last, what is done is "
      "kept\n";
  [[maybe_unused]] const ssize_t count = write(STDERR_FILENO, kMessage.data(), kMessage.size());
  _exit(kInterrupted);
}

void Handle(std::initializer_list<int> signals, void (*handler)(int), int flags) {
  struct sigaction action {};
  action.sa_handler = handler;
  sigemptyset(&action.sa_mask);
  action.sa_flags = flags;
  for (const int signal : signals) sigaction(signal, &action, nullptr);
}

}  // namespace

SignalGuard::SignalGuard() {
  stop_wanted = false;
  if (CallWatch::Current() != nullptr) return;
  // SA_RESETHAND gives a second signal its usual effect.
  Handle({SIGINT, SIGTERM}, &OnSignal, SA_RESTART | static_cast<int>(SA_RESETHAND));
  Handle({SIGALRM}, &OnAlarm, 0);
}

SignalGuard::~SignalGuard() {
  if (CallWatch::Current() != nullptr) return;
  alarm(0);
  Handle({SIGINT, SIGTERM, SIGALRM}, SIG_DFL, 0);
}

const std::atomic<bool>& SignalGuard::stop() { return stop_wanted; }

void UntilSignal(const std::function<void()>& work, const std::function<std::string()>& message) {
  if (CallWatch::Current() != nullptr) {
    work();
    return;
  }
  if (stop_wanted) throw Interrupted(message());
  try {
    CallWatch watch({.stop_wanted = [] { return stop_wanted.load(); }});
    work();
  } catch (const Cancelled&) {
    throw Interrupted(message());
  }
}

void UntilSignal(const std::function<void()>& work) {
  const auto whole_work = [&work] {
    work();
    CallWatch::Current()->Check();
  };
  UntilSignal(whole_work, [] { return "stopped by a signal before the work has begun"; });
}

std::string BeginsAnew() { return "stopped by a signal; the same command begins anew"; }

}  // namespace raylift
