// Times one stage of a command after the other.

#pragma once

#include <chrono>

namespace raylift {

class LapClock {
 public:
  // Seconds since the last lap, at first since it was made.
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
