#include "raylift/base/parallel.h"

#include <algorithm>
#include <exception>
#include <limits>
#include <mutex>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include "raylift/base/error.h"

// TBB gives work to threads and waits for them by means that the thread sanitizer does not see, as
// TBB is not compiled with it.
#if defined(__SANITIZE_THREAD__)
#define RAYLIFT_THREAD_SANITIZER 1
#elif defined(__has_feature)
#if __has_feature(thread_sanitizer)
#define RAYLIFT_THREAD_SANITIZER 1
#endif
#endif

namespace raylift {
namespace {

// Calls run(0) ... run(count - 1), which throw nothing, on this thread and others. Items are handed
// out without any order among threads: it would hide races of bodies from the sanitizer.
#ifdef RAYLIFT_THREAD_SANITIZER
void RunOnThreads(size_t count, int num_threads, const std::function<void(size_t)>& run) {
  std::atomic<size_t> next = 0;
  const auto work = [&] {
    constexpr auto kNoOrder = std::memory_order_relaxed;
    for (size_t i = next.fetch_add(1, kNoOrder); i < count; i = next.fetch_add(1, kNoOrder)) run(i);
  };
  std::vector<std::jthread> others;
  for (int t = 1; t < num_threads; ++t) others.emplace_back(work);
  work();
}
#else
void RunOnThreads(size_t count, int num_threads, const std::function<void(size_t)>& run) {
  // TBB's pool is as large as the hardware; a user may ask for more.
  const tbb::global_control allow(tbb::global_control::max_allowed_parallelism,
                                  static_cast<size_t>(std::max(num_threads, ResolveThreads(0))));
  tbb::task_arena arena(num_threads);
  try {
    arena.execute([&] {
      tbb::parallel_for(
          tbb::blocked_range<size_t>(0, count, 1),
          [&](const tbb::blocked_range<size_t>& range) {
            for (size_t i = range.begin(); i != range.end(); ++i) run(i);
          },
          tbb::simple_partitioner());
    });
  } catch (const std::runtime_error& error) {  // of TBB itself, as `run` throws nothing
    throw ResourceError(fmt::format("a thread cannot be started: {}", error.what()));
  }
}
#endif

thread_local CallWatch* current_watch = nullptr;

// Asking may be costly: a binding takes its interpreter's lock for it.
constexpr std::chrono::milliseconds kBetweenQuestions{20};

}  // namespace

int ResolveThreads(int threads) {
  if (threads > 0) return threads;
  return std::max(1u, std::thread::hardware_concurrency());
}

void ParallelFor(size_t count, int threads, const std::function<void(size_t)>& body) {
  const int num_threads = ResolveThreads(threads);
  CallWatch* const watch = CallWatch::Current();
  if (num_threads == 1 || count <= 1) {
    for (size_t i = 0; i < count; ++i) {
      if (watch != nullptr) watch->Check();
      body(i);
    }
    return;
  }
  std::mutex mutex;
  std::exception_ptr first_exception;
  std::atomic<size_t> first_index = std::numeric_limits<size_t>::max();
  RunOnThreads(count, num_threads, [&](size_t i) {
    const CallWatch::OnThisThread watched(watch);
    if (first_index.load(std::memory_order_relaxed) < i) return;
    try {
      if (watch != nullptr) watch->Check();
      body(i);
    } catch (...) {
      const std::lock_guard<std::mutex> lock(mutex);
      if (i < first_index) {
        first_index = i;
        first_exception = std::current_exception();
      }
    }
  });
  if (first_exception) std::rethrow_exception(first_exception);
}

void ParallelForParts(size_t count, size_t part, int threads,
                      const std::function<void(size_t begin, size_t end)>& body) {
  ParallelFor((count + part - 1) / part, threads,
              [&](size_t i) { body(i * part, std::min((i + 1) * part, count)); });
}

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
