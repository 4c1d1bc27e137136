// Shows the progress of a long loop on stderr: count, rate, time left. It is one line that changes
// where stderr is a terminal, else, as in the logs of a cluster, a line every minute, so that short
// loops leave none; a watch of the call (base/parallel.h) is told in any case.

#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <mutex>
#include <string>

#include "raylift/base/parallel.h"

namespace raylift {

class Progress {
 public:
  enum class Show { kAuto, kNever };

  // `what` names the items: "queries", "images".
  Progress(std::string what, size_t total, Show show = Show::kAuto,
           std::chrono::milliseconds between_lines = std::chrono::minutes(1));
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  // Adds a second quantity whose rate is shown ("Mrays"); the time left then follows from it. To be
  // called before the first Advance().
  void CountAlso(std::string unit, double total);

  // Counts an item as done, and so much of the second quantity. May be called from any thread.
  void Advance(double amount = 0);

 private:
  enum class Form { kNone, kTerminal, kLines };

  void Print(size_t done);

  std::string what_;
  size_t total_;
  Form form_;
  std::chrono::milliseconds between_lines_;
  CallWatch* watch_;  // outlives the loop; may be null
  std::atomic<size_t> done_{0};
  std::mutex mutex_;
  std::string unit_;  // of the second quantity; empty: there is none
  double total_amount_ = 0;
  double amount_ = 0;
  std::chrono::steady_clock::time_point start_;
  std::chrono::steady_clock::time_point last_print_;
  std::chrono::steady_clock::time_point last_line_;
};

}  // namespace raylift
