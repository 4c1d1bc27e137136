#include "support/matchers.h"

#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {

::testing::AssertionResult IsNearPose(const Rigid3& actual, const Rigid3& expected, double deg,
                                      double units) {
  const double rotation_error_deg = AngleBetweenDeg(actual.rotation, expected.rotation);
  const double position_error = (actual.OriginInSource() - expected.OriginInSource()).norm();
  if (rotation_error_deg <= deg && position_error <= units) {
    return ::testing::AssertionSuccess();
  }
  return ::testing::AssertionFailure()
         << fmt::format("rotation differs by {} deg (allowed {}), position by {} (allowed {})",
                        rotation_error_deg, deg, position_error, units);
}

::testing::AssertionResult FailsWithInputError(const std::function<void()>& action,
                                               const std::vector<std::string>& parts) {
  try {
    action();
  } catch (const InputError& error) {
    const std::string message = error.what();
    for (const std::string& part : parts) {
      if (message.find(part) == std::string::npos) {
        return ::testing::AssertionFailure()
               << "\"" << message << "\" does not contain \"" << part << "\"";
      }
    }
    if (message.find('\n') != std::string::npos) {
      return ::testing::AssertionFailure() << "\"" << message << "\" is more than one line";
    }
    return ::testing::AssertionSuccess();
  } catch (const std::exception& error) {
    return ::testing::AssertionFailure() << "another exception was thrown: " << error.what();
  }
  return ::testing::AssertionFailure() << "no exception was thrown";
}

Rng TestRng() {
  const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
  return Rng(StreamSeed(0, info->test_suite_name(), info->name()));
}

Rigid3 RandomRigid3(Rng& rng, double translation_extent) {
  Eigen::Quaterniond rotation(rng.Normal(), rng.Normal(), rng.Normal(), rng.Normal());
  rotation.normalize();
  const double e = translation_extent;
  return {rotation, {rng.Uniform(-e, e), rng.Uniform(-e, e), rng.Uniform(-e, e)}};
}

}  // namespace raylift
