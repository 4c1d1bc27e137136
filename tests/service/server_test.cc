#include "raylift/service/server.h"

#include <chrono>
#include <future>

#include <gtest/gtest.h>

namespace raylift {
namespace {

TEST(Server, StopEndsItsRunFromAnotherThread) {
  Server server([] { return std::vector<ServedScene>(); }, {.port = 0, .threads = 1});
  const auto run = std::async(std::launch::async, [&] { server.Run(); });
  server.Stop();
  // Else its future would wait for ever.
  ASSERT_EQ(run.wait_for(std::chrono::minutes(1)), std::future_status::ready) << std::flush;
}

}  // namespace
}  // namespace raylift
