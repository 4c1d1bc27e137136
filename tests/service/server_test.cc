#include "raylift/service/server.h"

#include <future>

#include <gtest/gtest.h>

namespace raylift {
namespace {

TEST(Server, StopEndsItsRunFromAnotherThread) {
  Server server([] { return std::vector<ServedScene>(); }, {.port = 0, .threads = 1});
  const auto run = std::async(std::launch::async, [&] { server.Run(); });
  server.Stop();
}

}  // namespace
}  // namespace raylift
