#include "service/work_queue.h"

#include <algorithm>
#include <system_error>
#include <utility>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"

namespace raylift {

WorkQueue::WorkQueue(int threads, size_t most_waiting, Seconds longest_wait)
    : most_waiting_(most_waiting), longest_wait_(longest_wait) {
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
    if (!HasRoom()) return false;
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

bool WorkQueue::HasRoom() const {
  if (num_new_ >= most_waiting_) return false;
  const size_t before_it = waiting_.size() + in_hand_;
  if (before_it < threads_.size()) return true;
  return usual_ * static_cast<double>(before_it) / static_cast<double>(threads_.size()) <=
         longest_wait_;
}

bool WorkQueue::IsFull() const {
  const std::lock_guard lock(mutex_);
  return !HasRoom();
}

size_t WorkQueue::NumWaiting() const {
  const std::lock_guard lock(mutex_);
  return num_new_;
}

size_t WorkQueue::NumInHand() const {
  const std::lock_guard lock(mutex_);
  return in_hand_;
}

WorkQueue::Seconds WorkQueue::usual() const {
  const std::lock_guard lock(mutex_);
  return usual_;
}

void WorkQueue::Learn(Tells tells, Seconds taken) {
  constexpr double kWeightOfNewest = 0.1;
  if (tells == Tells::kNothing) return;
  if (tells == Tells::kLeastTime) taken = std::max(taken, usual_);
  usual_ += (usual_ == Seconds{} ? 1 : kWeightOfNewest) * (taken - usual_);
}

void WorkQueue::Serve() {
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [this] { return ends_ || !waiting_.empty(); });
    if (ends_) return;
    Tells tells = Tells::kNothing;
    Seconds taken = {};
    {
      const Work work = std::move(waiting_.front().work);
      num_new_ -= waiting_.front().is_new ? 1 : 0;
      waiting_.pop_front();
      ++in_hand_;
      lock.unlock();
      const auto begin = std::chrono::steady_clock::now();
      tells = work();
      taken = std::chrono::steady_clock::now() - begin;
    }  // what it holds is freed without the lock
    lock.lock();
    --in_hand_;
    Learn(tells, taken);
  }
}

}  // namespace raylift
