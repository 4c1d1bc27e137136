// What fuzzing has found, once and for all: each input that once made a reader crash, hang, throw
// what it must not or take memory on a header's word; and the inputs that fuzzing begins with.

#include <algorithm>
#include <filesystem>
#include <ostream>

#include "fuzz/fuzz_targets.h"
#include <gtest/gtest.h>
#include <sys/resource.h>

#include "raylift/base/file.h"

// Memory taken on a header's word is a failure: of a sanitizer here, of new in other builds.
extern "C" __attribute__((visibility("default"))) const char* __asan_default_options() {
  return "max_allocation_size_mb=512";
}

namespace raylift {

// For GoogleTest's messages.
static void PrintTo(const FuzzTarget& target, std::ostream* stream) { *stream << target.name; }

namespace {

namespace fs = std::filesystem;

class Replay : public testing::TestWithParam<FuzzTarget> {
 protected:
  static void SetUpTestSuite() {
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__) && !defined(__clang__)
    constexpr rlim_t kAddressSpace = rlim_t{4} << 30;  // that of the libraries and threads included
    const rlimit limit = {kAddressSpace, kAddressSpace};
    ASSERT_EQ(setrlimit(RLIMIT_AS, &limit), 0);
#endif
  }
};

TEST_P(Replay, FindingsAreSuccessOrAnErrorOfOneLine) {
  const fs::path folder = fs::path(RAYLIFT_FINDINGS_DIR) / GetParam().name;
  if (!fs::exists(folder)) return;
  for (const auto& entry : fs::directory_iterator(folder)) {
    SCOPED_TRACE(entry.path());
    std::string message;
    EXPECT_NO_THROW(message = RunFuzzTarget(GetParam(), ReadFile(entry.path())));
    EXPECT_EQ(message.find('\n'), std::string::npos) << message;
  }
}

TEST_P(Replay, SeedsAreReadWithoutError) {
  for (const std::string& seed : GetParam().seeds()) {
    EXPECT_EQ(RunFuzzTarget(GetParam(), seed), "");
  }
}

// Some of what a fuzzer tries first: it costs little, and comes without one.
TEST_P(Replay, CutAndSpoiltSeedsAreSuccessOrAnError) {
  constexpr size_t kTries = 100;
  for (const std::string& seed : GetParam().seeds()) {
    const size_t step = std::max<size_t>(1, seed.size() / kTries);
    for (size_t at = 0; at < seed.size(); at += step) {
      SCOPED_TRACE(at);
      EXPECT_NO_THROW(RunFuzzTarget(GetParam(), seed.substr(0, at)));
      std::string spoilt = seed;
      spoilt[at] = static_cast<char>(~spoilt[at]);
      if (GetParam().repair != nullptr) GetParam().repair(spoilt);
      EXPECT_NO_THROW(RunFuzzTarget(GetParam(), spoilt));
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Readers, Replay, testing::ValuesIn(AllFuzzTargets()),
                         [](const auto& test) { return std::string(test.param.name); });

}  // namespace
}  // namespace raylift
