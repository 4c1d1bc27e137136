// Progress of a long loop on stderr: count, rate, time left. Shown only where stderr is a terminal.

#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <mutex>
#include <string>

namespace raylift {

class Progress {
 public:
  enum class Show { kAuto, kNever };

  // `what` names the items: "queries", "images".
  Progress(std::string what, size_t total, Show show = Show::kAuto);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  // One item is done. May be called from any thread.
  void Advance();

 private:
  void Print(size_t done);

  std::string what_;
  size_t total_;
  bool visible_;
  std::atomic<size_t> done_{0};
  std::mutex mutex_;
  std::chrono::steady_clock::time_point start_;
  std::chrono::steady_clock::time_point last_print_;
};

}  // namespace raylift
