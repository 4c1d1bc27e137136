#include "service/work_queue.h"

#include <chrono>
#include <future>
#include <thread>

#include <gtest/gtest.h>

namespace raylift {
namespace {

constexpr WorkQueue::Seconds kLong(1e6);

using Tells = WorkQueue::Tells;

Tells Nothing() { return Tells::kTime; }

TEST(WorkQueue, TakesNoMoreThanMayWait) {
  WorkQueue queue(1, 2, kLong);
  std::promise<void> begun, go_on;
  auto may_go_on = go_on.get_future().share();
  ASSERT_TRUE(queue.TryAdd([&] {
    begun.set_value();
    may_go_on.wait();
    return Tells::kTime;
  }));
  begun.get_future().wait();  // it waits no more
  std::vector<int> done;
  const auto push = [&done](int i) {
    return [&done, i] {
      done.push_back(i);
      return Tells::kTime;
    };
  };
  EXPECT_TRUE(queue.TryAdd(push(1)));
  EXPECT_TRUE(queue.TryAdd(push(2)));
  EXPECT_TRUE(queue.IsFull());
  EXPECT_EQ(queue.NumInHand(), 1u);
  EXPECT_FALSE(queue.TryAdd(push(3)));
  std::promise<void> ended;
  queue.AddAgain([&] {
    ended.set_value();
    return Tells::kTime;
  });
  go_on.set_value();
  ended.get_future().wait();
  EXPECT_EQ(done, (std::vector<int>{1, 2}));
}

TEST(WorkQueue, WhatGoesOnTakesNoRoom) {
  WorkQueue queue(1, 1, kLong);
  std::promise<void> begun, go_on, ended;
  auto may_go_on = go_on.get_future().share();
  ASSERT_TRUE(queue.TryAdd([&] {
    begun.set_value();
    may_go_on.wait();
    return Tells::kTime;
  }));
  begun.get_future().wait();
  queue.AddAgain(Nothing);
  EXPECT_FALSE(queue.IsFull());
  EXPECT_TRUE(queue.TryAdd([&] {
    ended.set_value();
    return Tells::kTime;
  }));
  EXPECT_TRUE(queue.IsFull());
  go_on.set_value();
  ended.get_future().wait();
}

TEST(WorkQueue, TakesNothingThatWouldWaitTooLong) {
  WorkQueue queue(1, 10, WorkQueue::Seconds(0));
  const auto wait_until_idle = [&] {
    while (queue.NumWaiting() + queue.NumInHand() > 0) std::this_thread::yield();
  };
  std::promise<void> go_on;
  auto may_go_on = go_on.get_future().share();
  ASSERT_TRUE(queue.TryAdd(Nothing));  // tells how long work takes
  wait_until_idle();
  EXPECT_FALSE(queue.IsFull());
  ASSERT_TRUE(queue.TryAdd([&] {
    may_go_on.wait();
    return Tells::kTime;
  }));
  EXPECT_TRUE(queue.IsFull());
  EXPECT_FALSE(queue.TryAdd(Nothing));
  go_on.set_value();
  wait_until_idle();
  EXPECT_TRUE(queue.TryAdd(Nothing));  // its thread is free
}

TEST(WorkQueue, WhatIsNotLikeTheOthersTellsNoTime) {
  WorkQueue queue(1, 10, WorkQueue::Seconds(0));
  const auto run = [&](const WorkQueue::Work& work) {
    ASSERT_TRUE(queue.TryAdd(work));
    while (queue.NumWaiting() + queue.NumInHand() > 0) std::this_thread::yield();
  };
  run([] { return Tells::kNothing; });
  EXPECT_EQ(queue.usual(), WorkQueue::Seconds(0));
  run(Nothing);
  const WorkQueue::Seconds usual = queue.usual();
  EXPECT_GT(usual, WorkQueue::Seconds(0));
  run([] { return Tells::kNothing; });
  EXPECT_EQ(queue.usual(), usual);
  run([] { return Tells::kLeastTime; });  // at once: that it would have taken longer is no news
  EXPECT_GE(queue.usual(), usual);
  run([] {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    return Tells::kLeastTime;
  });
  EXPECT_GT(queue.usual(), WorkQueue::Seconds(0.002 * 0.9));
}

}  // namespace
}  // namespace raylift
