#include "service/work_queue.h"

#include <system_error>
#include <utility>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"

namespace raylift {

WorkQueue::WorkQueue(int threads, size_t most_waiting) : most_waiting_(most_waiting) {
  const int count = ResolveThreads(threads);
  threads_.reserve(static_cast<size_t>(count));
  try {
    for (int i = 0; i < count; ++i) threads_.emplace_back([this] { Serve(); });
  } catch (const std::system_error& error) {
    End();
    throw ResourceError(error.what());
  }
}

WorkQueue::~WorkQueue() { End(); }

void WorkQueue::End() {
  {
    const std::lock_guard lock(mutex_);
    ends_ = true;
  }
  changed_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

bool WorkQueue::TryAdd(Work work) {
  {
    const std::lock_guard lock(mutex_);
    if (num_new_ >= most_waiting_) return false;
    waiting_.push_back({std::move(work), true});
    ++num_new_;
  }
  changed_.notify_one();
  return true;
}

void WorkQueue::AddAgain(Work work) {
  {
    const std::lock_guard lock(mutex_);
    waiting_.push_back({std::move(work), false});
  }
  changed_.notify_one();
}

bool WorkQueue::IsFull() const { return NumWaiting() >= most_waiting_; }

size_t WorkQueue::NumWaiting() const {
  const std::lock_guard lock(mutex_);
  return num_new_;
}

size_t WorkQueue::NumInHand() const {
  const std::lock_guard lock(mutex_);
  return in_hand_;
}

void WorkQueue::Serve() {
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [this] { return ends_ || !waiting_.empty(); });
    if (ends_) return;
    {
      const Work work = std::move(waiting_.front().work);
      num_new_ -= waiting_.front().is_new ? 1 : 0;
      waiting_.pop_front();
      ++in_hand_;
      lock.unlock();
      work();
    }  // what it holds is freed without the lock
    lock.lock();
    --in_hand_;
  }
}

}  // namespace raylift
