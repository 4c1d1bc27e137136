#include "raylift/base/parallel.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <mutex>
#include <numeric>
#include <stdexcept>
#include <thread>
#include <vector>

#include "base/progress.h"
#include <gtest/gtest.h>

namespace raylift {
namespace {

TEST(ParallelFor, VisitsEveryIndexOnceForAnyThreadCount) {
  for (const int threads : {0, 1, 4}) {
    std::vector<int> visits(1000, 0);
    ParallelFor(visits.size(), threads, [&](size_t i) { ++visits[i]; });
    EXPECT_EQ(std::accumulate(visits.begin(), visits.end(), 0), 1000);
    EXPECT_EQ(*std::min_element(visits.begin(), visits.end()), 1);
  }
}

TEST(ParallelFor, RethrowsTheExceptionOfTheLowestIndex) {
  for (const int threads : {1, 4}) {
    try {
      ParallelFor(100, threads, [](size_t i) {
        if (i % 10 == 7) throw std::runtime_error(std::to_string(i));
      });
      FAIL() << "nothing was thrown";
    } catch (const std::runtime_error& error) {
      EXPECT_STREQ(error.what(), "7");
    }
  }
}

#if defined(__SANITIZE_THREAD__)
// The gate sees what it is there for: a race in a loop's body ends the thread sanitizer's process
// with its exit code.
TEST(ParallelForDeathTest, TheSanitizerFindsARaceInItsBody) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const auto count = [] {
    size_t counter = 0;
    ParallelFor(100000, 4, [&](size_t) { ++counter; });
    std::exit(counter > 0 ? 0 : 1);
  };
  EXPECT_EXIT(count(), testing::ExitedWithCode(66), "data race");
}

// How items are handed out puts no order between two of them, which would hide this one.
TEST(ParallelForDeathTest, TheSanitizerFindsARaceOfItemsFarApart) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const auto write_first_and_last = [] {
    const std::thread::id caller = std::this_thread::get_id();
    size_t shared = 0;
    ParallelFor(64, 2, [&](size_t i) {
      const bool writes = std::this_thread::get_id() == caller ? i < 8 : i >= 56;
      if (writes) ++shared;
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    });
    std::exit(shared > 0 ? 0 : 1);
  };
  EXPECT_EXIT(write_first_and_last(), testing::ExitedWithCode(66), "data race");
}
#endif

void Work() { std::this_thread::sleep_for(std::chrono::milliseconds(1)); }

TEST(CallWatch, NobodyWatchesByDefault) {
  EXPECT_EQ(CallWatch::Current(), nullptr);
  {
    CallWatch watch({});
    EXPECT_EQ(CallWatch::Current(), &watch);
    watch.Check();
  }
  EXPECT_EQ(CallWatch::Current(), nullptr);
}

TEST(CallWatch, EndsLoopsOfAnyNumberOfThreads) {
  for (const int threads : {1, 3}) {
    std::atomic<size_t> done{0};
    CallWatch watch({.stop_wanted = [&] { return done > 2; }});
    constexpr size_t kItems = 100000;
    const auto count = [&](size_t) {
      Work();
      ++done;
    };
    EXPECT_THROW(ParallelFor(kItems, threads, count), Cancelled);
    EXPECT_LT(done, kItems);
  }
}

TEST(CallWatch, EndsLoopsWithinLoops) {
  std::atomic<size_t> done{0};
  CallWatch watch({.stop_wanted = [&] { return done > 2; }});
  EXPECT_THROW(ParallelFor(2, 2,
                           [&](size_t) {
                             ParallelFor(100000, 2, [&](size_t) {
                               Work();
                               ++done;
                             });
                           }),
               Cancelled);
}

TEST(CallWatch, AsksOnTheCallersThreadAlone) {
  const auto caller = std::this_thread::get_id();
  std::atomic<int> asked_elsewhere{0};
  std::atomic<int> asked{0};
  CallWatch watch({.stop_wanted = [&] {
    ++(std::this_thread::get_id() == caller ? asked : asked_elsewhere);
    return false;
  }});
  ParallelFor(300, 2, [](size_t) { Work(); });
  EXPECT_GT(asked, 0);
  EXPECT_EQ(asked_elsewhere, 0);
}

TEST(CallWatch, IsToldOfProgress) {
  std::mutex mutex;
  std::vector<size_t> told;
  CallWatch watch({.on_progress = [&](const std::string& what, size_t done, size_t total) {
    const std::lock_guard<std::mutex> lock(mutex);
    EXPECT_EQ(what, "items");
    EXPECT_EQ(total, 50u);
    told.push_back(done);
  }});
  Progress progress("items", 50, Progress::Show::kNever);
  ParallelFor(50, 2, [&](size_t) { progress.Advance(); });
  ASSERT_FALSE(told.empty());
  EXPECT_EQ(*std::max_element(told.begin(), told.end()), 50u);
}

}  // namespace

}  // namespace raylift
