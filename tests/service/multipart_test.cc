#include "service/multipart.h"

#include "support/matchers.h"
#include <gtest/gtest.h>

namespace raylift {
namespace {

std::string Part(const std::string& disposition, const std::string& content) {
  return "--b\r\nContent-Disposition: " + disposition + "\r\nContent-Type: any\r\n\r\n" + content +
         "\r\n";
}

TEST(Multipart, PartsAreTakenInTheirOrder) {
  const std::string body =
      Part("form-data; name=\"image\"; filename=\"a \\\"b\\\".jpg\"", "any\r\n-- bytes\r\n-\0x") +
      Part("form-data; name=query", "") + "--b--\r\n";
  const auto parts = ParseMultipart(body, "b");
  ASSERT_EQ(parts.size(), 2u);
  EXPECT_EQ(parts[0].name, "image");
  EXPECT_EQ(parts[0].file_name, "a \"b\".jpg");
  EXPECT_EQ(parts[1].name, "query");
  EXPECT_FALSE(parts[1].file_name);
  EXPECT_EQ(parts[1].content, "");
}

TEST(Multipart, WhatStandsAroundThePartsIsPassedOver) {
  const std::string body =
      "To whom it may concern\r\n" + Part("form-data; name=a", "1") + "--b--\r\nbye";
  const auto parts = ParseMultipart(body, "b");
  ASSERT_EQ(parts.size(), 1u);
  EXPECT_EQ(parts[0].content, "1");
}

TEST(Multipart, ABodyThatEndsTooSoonIsRefusedWhereverItEnds) {
  const std::string body = Part("form-data; name=a", "content") + "--b--";
  for (size_t size = 0; size < body.size(); ++size) {
    EXPECT_TRUE(FailsWithInputError([&] { ParseMultipart(body.substr(0, size), "b"); }, {""}))
        << size;
  }
  EXPECT_EQ(ParseMultipart(body, "b").size(), 1u);
}

TEST(Multipart, WhatFollowsNoGrammarIsRefused) {
  const auto refuses = [](const std::string& body, const char* message) {
    return FailsWithInputError([&] { ParseMultipart(body, "b"); }, {message});
  };
  EXPECT_TRUE(refuses(Part("form-data", "1") + "--b--", "with a name"));
  EXPECT_TRUE(refuses("--b\r\nno header\r\n\r\n1\r\n--b--", "Name: value"));
  EXPECT_TRUE(refuses("--b\r\nA: " + std::string(kMaxPartHeaderBytes, 'a') + "\r\n\r\n\r\n--b--",
                      "does not end"));
  std::string many;
  for (size_t i = 0; i <= kMaxFormParts; ++i) many += Part("form-data; name=a", "");
  EXPECT_TRUE(refuses(many + "--b--", "at most"));
  EXPECT_TRUE(FailsWithInputError([] { ParseMultipart("--\r\n", ""); }, {"boundary"}));
}

TEST(Multipart, ParametersOfHeadersAreFoundByTheirNames) {
  const std::string_view value = "multipart/Form-Data; charset=x ;Boundary=\"a;b\"; boundary=c";
  EXPECT_EQ(MediaType(value), "multipart/form-data");
  EXPECT_EQ(HeaderParameter(value, "boundary"), "a;b");
  EXPECT_EQ(HeaderParameter(value, "charset"), "x");
  EXPECT_EQ(HeaderParameter(value, "other"), std::nullopt);
  EXPECT_EQ(HeaderParameter("a; b", "b"), std::nullopt);
  EXPECT_EQ(HeaderParameter("a; b=\"c", "b"), "c");
}

}  // namespace
}  // namespace raylift
