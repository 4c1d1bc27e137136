#include "raylift/base/call_watch.h"

#include <utility>

namespace raylift {
namespace {

thread_local CallWatch* current_watch = nullptr;

// Asking may be dear: a binding takes its interpreter's lock for it.
constexpr std::chrono::milliseconds kBetweenQuestions{20};

}  // namespace

CallWatch::CallWatch(Hooks hooks)
    : hooks_(std::move(hooks)),
      caller_(std::this_thread::get_id()),
      last_asked_(std::chrono::steady_clock::now()),
      on_this_thread_(this) {}

CallWatch::~CallWatch() = default;

CallWatch* CallWatch::Current() { return current_watch; }

void CallWatch::Check() {
  if (hooks_.stop_wanted && std::this_thread::get_id() == caller_) {
    const auto now = std::chrono::steady_clock::now();
    if (now - last_asked_ > kBetweenQuestions) {
      last_asked_ = now;
      if (hooks_.stop_wanted()) stopped_ = true;
    }
  }
  if (stopped_) throw Cancelled();
}

CallWatch::OnThisThread::OnThisThread(CallWatch* watch)
    : before_(std::exchange(current_watch, watch)) {}

CallWatch::OnThisThread::~OnThisThread() { current_watch = before_; }

}  // namespace raylift
