#include "raylift/base/parallel.h"

#include <algorithm>
#include <exception>
#include <limits>
#include <mutex>
#include <thread>

#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include "raylift/base/call_watch.h"

#if defined(__SANITIZE_THREAD__)
#define RAYLIFT_THREAD_SANITIZER 1
#elif defined(__has_feature)
#if __has_feature(thread_sanitizer)
#define RAYLIFT_THREAD_SANITIZER 1
#endif
#endif
#ifdef RAYLIFT_THREAD_SANITIZER
extern "C" void __tsan_acquire(void* address);
extern "C" void __tsan_release(void* address);
#endif

namespace raylift {
namespace {

// TBB gives work to threads and waits for them by means that the thread sanitizer does not see, as
// TBB is not compiled with it: what one thread did before Release(), another sees after Acquire().
void Acquire([[maybe_unused]] void* address) {
#ifdef RAYLIFT_THREAD_SANITIZER
  __tsan_acquire(address);
#endif
}
void Release([[maybe_unused]] void* address) {
#ifdef RAYLIFT_THREAD_SANITIZER
  __tsan_release(address);
#endif
}

}  // namespace

int ResolveThreads(int threads) {
  if (threads > 0) {
    return threads;
  }
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
  size_t first_index = std::numeric_limits<size_t>::max();
  // TBB's pool is as large as the hardware; a user may ask for more.
  const tbb::global_control allow(tbb::global_control::max_allowed_parallelism,
                                  static_cast<size_t>(std::max(num_threads, ResolveThreads(0))));
  tbb::task_arena arena(num_threads);
  int begin = 0, end = 0;  // their addresses name two events
  Release(&begin);
  arena.execute([&] {
    tbb::parallel_for(
        tbb::blocked_range<size_t>(0, count, 1),
        [&](const tbb::blocked_range<size_t>& range) {
          Acquire(&begin);
          const CallWatch::OnThisThread watched(watch);
          for (size_t i = range.begin(); i != range.end(); ++i) {
            {
              const std::lock_guard<std::mutex> lock(mutex);
              if (first_index < i) {
                return;
              }
            }
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
            Release(&end);
          }
        },
        tbb::simple_partitioner());
  });
  Acquire(&end);
  if (first_exception) {
    std::rethrow_exception(first_exception);
  }
}

}  // namespace raylift
