#include "raylift/service/client.h"

#include "support/matchers.h"
#include <gtest/gtest.h>

namespace raylift {
namespace {

TEST(ServerUrl, HasAHostAPortAPathAndParameters) {
  const ServerUrl plain = ServerUrl::Parse("http://localhost");
  EXPECT_EQ(plain.host, "localhost");
  EXPECT_EQ(plain.port, "80");
  EXPECT_EQ(plain.path + plain.parameters, "");
  const ServerUrl full = ServerUrl::Parse("http://[::1]:8080/vps/?scene=a%20b");
  EXPECT_EQ(full.host, "::1");
  EXPECT_EQ(full.port, "8080");
  EXPECT_EQ(full.path, "/vps");
  EXPECT_EQ(full.parameters, "?scene=a%20b");
}

TEST(ServerUrl, WhatIsNoneIsRefused) {
  for (const char* text :
       {"", "localhost:80", "ftp://a", "http://", "http://:80", "http://a:0", "http://a:99999",
        "http://a:b", "http://a b", "http://a/\r\nX: y", "http://user@a"}) {
    EXPECT_TRUE(FailsWithInputError([&] { ServerUrl::Parse(text); }, {"http://HOST:PORT"})) << text;
  }
  EXPECT_TRUE(FailsWithInputError([&] { ServerUrl::Parse("https://a"); }, {"proxy"}));
}

}  // namespace
}  // namespace raylift
