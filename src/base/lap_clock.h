// Measures what work takes.

#pragma once

#include <chrono>

namespace raylift {

class LapClock {
 public:
  // Returns the seconds since the last lap, at first since it was made.
  double Seconds() const { return std::chrono::duration<double>(Clock::now() - begin_).count(); }

  // Returns the same, and begins the next lap.
  double Lap() {
    const Clock::time_point now = Clock::now();
    const std::chrono::duration<double> lap = now - begin_;
    begin_ = now;
    return lap.count();
  }

 private:
  using Clock = std::chrono::steady_clock;
  Clock::time_point begin_ = Clock::now();
};

}  // namespace raylift
