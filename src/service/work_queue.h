// Work that waits for a thread, no more of it and no longer than bounds.

#pragma once

#include <chrono>
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
  // What the time of a piece of work tells of how long others will take: nothing, as it is not like
  // them; or it took this long; or, where it was given up, it would have taken longer.
  enum class Tells { kNothing, kTime, kLeastTime };
  // Throws nothing.
  using Work = std::function<Tells()>;

  using Seconds = std::chrono::duration<double>;

  // Throws ResourceError where threads cannot be started.
  WorkQueue(int threads, size_t most_waiting, Seconds longest_wait);
  // Ends the work in hand and drops what waits.
  ~WorkQueue();
  WorkQueue(const WorkQueue&) = delete;
  WorkQueue& operator=(const WorkQueue&) = delete;

  // Returns whether there was room: while all threads are busy there is none for what would wait
  // too long, as work that tells has taken lately. Thread safe, as all of these.
  bool TryAdd(Work work);
  // What was admitted before goes on behind all that waits, so that others have their turn, and
  // takes the room of none of them.
  void AddAgain(Work work);

  bool IsFull() const;
  size_t NumWaiting() const;  // for the first time
  size_t NumInHand() const;
  Seconds usual() const;  // time of a piece of work that tells; 0: there was none
  int threads() const { return static_cast<int>(threads_.size()); }

 private:
  struct Waiting {
    Work work;
    bool is_new;
  };
  void Serve();
  void Learn(Tells tells, Seconds taken);  // with the mutex
  void End();
  bool HasRoom() const;  // with the mutex

  const size_t most_waiting_;
  const Seconds longest_wait_;
  mutable std::mutex mutex_;  // guards what follows
  std::condition_variable changed_;
  std::deque<Waiting> waiting_;
  size_t num_new_ = 0;  // of those that wait
  size_t in_hand_ = 0;
  Seconds usual_ = {};
  bool ends_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace raylift
