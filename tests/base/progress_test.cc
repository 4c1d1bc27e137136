#include "base/progress.h"

#include <algorithm>
#include <chrono>
#include <string>
#include <thread>

#include <gtest/gtest.h>

namespace raylift {
namespace {

using std::chrono::milliseconds;

// What a loop of `steps` leaves on an stderr that is a file.
std::string Output(int steps, Progress::Show show, milliseconds between_lines) {
  ::testing::internal::CaptureStderr();
  {
    Progress progress("images", 4, show, between_lines);
    for (int i = 0; i < steps; ++i) {
      std::this_thread::sleep_for(milliseconds(2));
      progress.Advance();
    }
  }
  return ::testing::internal::GetCapturedStderr();
}

TEST(Progress, FilesGetALineNowAndThenWithRateAndTimeLeft) {
  const std::string text = Output(3, Progress::Show::kAuto, milliseconds(1));
  EXPECT_NE(text.find("2 / 4 images, "), std::string::npos) << text;
  EXPECT_NE(text.find(" / s, "), std::string::npos) << text;
  EXPECT_NE(text.find(" left\n"), std::string::npos) << text;
  EXPECT_EQ(text.find_first_of("\r\033"), std::string::npos) << text;
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 4) << "each step and the end: " << text;
}

TEST(Progress, ShortLoopsAndQuietOnesLeaveNothing) {
  EXPECT_EQ(Output(3, Progress::Show::kAuto, std::chrono::minutes(1)), "");
  EXPECT_EQ(Output(3, Progress::Show::kNever, milliseconds(1)), "");
}

}  // namespace
}  // namespace raylift
