#include "raylift/service/server.h"

#include <chrono>
#include <future>
#include <string>

#include <boost/asio.hpp>
#include <gtest/gtest.h>
#include <poll.h>

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

TEST(Server, ClientsThatDoNotReadTheirAnswersAreLetGo) {
  Server server([] { return std::vector<ServedScene>(); },
                {.port = 0, .threads = 1, .limits = {.write_s = 0.1}});
  const auto run = std::async(std::launch::async, [&] { server.Run(); });
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
    EXPECT_EQ(error, asio::error::connection_reset);  // by now
  }
  client.close();
  server.Stop();
}

}  // namespace
}  // namespace raylift
