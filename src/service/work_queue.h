// Work that waits for a thread, no more of it than a bound.

#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace raylift {

class WorkQueue {
 public:
  using Work = std::function<void()>;  // throws nothing

  // Throws ResourceError where threads cannot be started.
  WorkQueue(int threads, size_t most_waiting);
  // Ends the work in hand and drops what waits.
  ~WorkQueue();
  WorkQueue(const WorkQueue&) = delete;
  WorkQueue& operator=(const WorkQueue&) = delete;

  // Returns whether there was room. Thread safe, as all of these.
  bool TryAdd(Work work);
  // What was admitted before goes on behind all that waits, so that others have their turn, and
  // takes the room of none of them.
  void AddAgain(Work work);

  bool IsFull() const;
  size_t NumWaiting() const;  // for the first time
  size_t NumInHand() const;
  int threads() const { return static_cast<int>(threads_.size()); }

 private:
  struct Waiting {
    Work work;
    bool is_new;
  };
  void Serve();
  void End();

  const size_t most_waiting_;
  mutable std::mutex mutex_;  // guards what follows
  std::condition_variable changed_;
  std::deque<Waiting> waiting_;
  size_t num_new_ = 0;  // of those that wait
  size_t in_hand_ = 0;
  bool ends_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace raylift
