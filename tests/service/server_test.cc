#include "raylift/service/server.h"

#include <atomic>
#include <chrono>
#include <csignal>
#include <future>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <boost/asio.hpp>
#include <gtest/gtest.h>
#include <poll.h>

#include "raylift/base/parallel.h"

namespace raylift {
namespace {

namespace asio = boost::asio;

TEST(Server, StopEndsItsRunFromAnotherThread) {
  Server server([] { return std::vector<ServedScene>(); }, {.port = 0, .threads = 1});
  const auto run = std::async(std::launch::async, [&] { server.Run(); });
  server.Stop();
  // Else its future would wait for ever.
  ASSERT_EQ(run.wait_for(std::chrono::minutes(1)), std::future_status::ready) << std::flush;
}

TEST(Server, EndsWhereItIsToldToReopenAtTheSameTime) {
  Server server([] { return std::vector<ServedScene>(); }, {.port = 0, .threads = 1});
  std::raise(SIGTERM);  // as a machine hands them over that were sent the other way around
  std::raise(SIGHUP);
  const auto run = std::async(std::launch::async, [&] { server.Run(); });
  ASSERT_EQ(run.wait_for(std::chrono::minutes(1)), std::future_status::ready) << std::flush;
}

TEST(Server, EndsWhileItOpensScenesAnew) {
  std::promise<void> reopens;
  std::atomic<int> opened = 0;
  const auto open = [&] {
    if (++opened == 1) return std::vector<ServedScene>();
    reopens.set_value();
    while (true) {
      CallWatch::Current()->Check();
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  };
  auto server = std::make_unique<Server>(open, ServerOptions{.port = 0, .threads = 1});
  auto run = std::async(std::launch::async, [&] { server->Run(); });
  std::raise(SIGHUP);
  reopens.get_future().wait();
  server->Stop();
  ASSERT_EQ(run.wait_for(std::chrono::minutes(1)), std::future_status::ready) << std::flush;
  server.reset();
}

TEST(Server, ClientsThatDoNotReadTheirAnswersAreLetGo) {
  Server server([] { return std::vector<ServedScene>(); },
                {.port = 0, .threads = 1, .limits = {.write_s = 0.1}});
  const auto run = std::async(std::launch::async, [&] { server.Run(); });
  // Whatever fails below, as the future waits for the server's end.
  const std::shared_ptr<void> stopped(nullptr, [&](void*) { server.Stop(); });
  asio::io_context io;
  asio::ip::tcp::socket client(io);
  const std::string url = server.url();
  const auto port = static_cast<uint16_t>(std::stoi(url.substr(url.rfind(':') + 1)));
  client.connect({asio::ip::make_address("127.0.0.1"), port});
  const std::string request = "GET /openapi.json HTTP/1.1\r\nHost: a\r\n\r\n";
  client.non_blocking(true);
  boost::system::error_code error;
  while (!error) client.write_some(asio::buffer(request), error);
  if (error == asio::error::would_block) {
    pollfd ended{.fd = client.native_handle(), .events = 0, .revents = 0};  // nothing but its end
    constexpr int kMinuteMs = 60'000;
    EXPECT_EQ(poll(&ended, 1, kMinuteMs), 1);
  } else {
    // By now.
    EXPECT_TRUE(error == asio::error::connection_reset || error == asio::error::broken_pipe)
        << error.message();
  }
}

}  // namespace
}  // namespace raylift
