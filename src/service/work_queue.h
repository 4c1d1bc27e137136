// A queue of work that waits for threads, bounded in length and in waiting time.

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
  // Says what the time of a piece of work tells of others: kNothing, as they are not alike; kTime,
  // they take this time; kLeastTime, it was given up and would have taken longer.
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

  // Adds work and returns true where there is room: while all threads are busy, there is none for
  // work that would wait too long, judged by the time that work has taken lately. Thread safe, as
  // all of these.
  bool TryAdd(Work work);
  // Adds work that was admitted before, behind all that waits, so that others have their turn; it
  // takes the room of none of them.
  void AddAgain(Work work);

  bool IsFull() const;
  size_t NumWaiting() const;  // without AddAgain()
  size_t NumInHand() const;
  Seconds usual() const;  // usual time of a piece of work; 0: none is known
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
  size_t num_new_ = 0;  // waiting without AddAgain()
  size_t in_hand_ = 0;
  Seconds usual_ = {};
  bool ends_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace raylift
