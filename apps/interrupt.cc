#include "apps/interrupt.h"

#include <csignal>

#include "raylift/base/parallel.h"

namespace raylift {
namespace {

std::atomic<bool> stop_wanted{false};
static_assert(std::atomic<bool>::is_always_lock_free, "set by a signal handler");

void OnSignal(int) { stop_wanted = true; }

void Handle(void (*handler)(int), int flags) {
  struct sigaction action {};
  action.sa_handler = handler;
  sigemptyset(&action.sa_mask);
  action.sa_flags = flags;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

}  // namespace

SignalGuard::SignalGuard() {
  stop_wanted = false;
  if (CallWatch::Current() != nullptr) return;
  // SA_RESETHAND: a second signal has its usual effect.
  Handle(&OnSignal, SA_RESTART | static_cast<int>(SA_RESETHAND));
}

SignalGuard::~SignalGuard() {
  if (CallWatch::Current() == nullptr) Handle(SIG_DFL, 0);
}

const std::atomic<bool>& SignalGuard::stop() { return stop_wanted; }

void UntilSignal(const std::function<void()>& work, const std::function<std::string()>& message) {
  if (CallWatch::Current() != nullptr) {
    work();
    return;
  }
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

}  // namespace raylift
