// Loops over independent items (queries, images, tiles) on TBB. Results must be written to the
// item's own place, so that the thread count never changes them.

#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <functional>
#include <stdexcept>
#include <string>
#include <thread>

namespace raylift {

// Returns `threads`, or the count of hardware threads if `threads` <= 0.
int ResolveThreads(int threads);

// Calls body(0) ... body(count - 1) on up to `threads` threads (<= 0: all). The first exception of
// the lowest index among those that were thrown is rethrown after the running items end.
void ParallelFor(size_t count, int threads, const std::function<void(size_t)>& body);

// Calls body(begin, end) likewise for parts of 0 ... count - 1 of `part` items each, the last one
// of what is left.
void ParallelForParts(size_t count, size_t part, int threads,
                      const std::function<void(size_t begin, size_t end)>& body);

// A caller that is no command line (a binding to another language, a window) follows a long call
// and ends it by a CallWatch: loops of ParallelFor() ask between their items whether to go on, and
// report what Progress counts.
//
//   CallWatch watch({.stop_wanted = [&] { return button_pressed; }});
//   localizer.LocalizeAll();  // throws Cancelled soon after the button

// Leaves a call that its watch has ended.
class Cancelled : public std::runtime_error {
 public:
  Cancelled() : std::runtime_error("the call was canceled") {}
};

// Watches what its thread calls while it exists, and what is done for that on other threads.
class CallWatch {
 public:
  struct Hooks {
    // Is asked now and then, on the thread that made the watch, whether to stop. Empty: the call is
    // never ended.
    std::function<bool()> stop_wanted = {};
    // Is called from any thread: `done` of `total` items ("queries") are done. Empty: nobody wants
    // to know.
    std::function<void(const std::string& what, size_t done, size_t total)> on_progress = {};
  };

  explicit CallWatch(Hooks hooks);
  ~CallWatch();
  CallWatch(const CallWatch&) = delete;
  CallWatch& operator=(const CallWatch&) = delete;

  // Returns this thread's watch; null where nobody watches.
  static CallWatch* Current();

  // Throws Cancelled where the call is to end.
  void Check();

  const Hooks& hooks() const { return hooks_; }

  // While it exists, this thread works for the watch (which may be null).
  class OnThisThread {
   public:
    explicit OnThisThread(CallWatch* watch);
    ~OnThisThread();
    OnThisThread(const OnThisThread&) = delete;
    OnThisThread& operator=(const OnThisThread&) = delete;

   private:
    CallWatch* before_;
  };

 private:
  Hooks hooks_;
  std::thread::id caller_;
  std::chrono::steady_clock::time_point last_asked_;  // only the caller's
  std::atomic<bool> stopped_{false};
  OnThisThread on_this_thread_;
};

}  // namespace raylift
