#include "raylift/evaluation/depth_errors.h"

#include <array>
#include <cmath>
#include <fstream>
#include <numbers>
#include <numeric>
#include <sstream>

#include "base/rng.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

// What numpy makes of the two arrays `e` and `t`, which hold what both maps know: the numbers that
// the script prints.
std::vector<double> AskNumpy(const std::vector<float>& estimated, const std::vector<float>& truth,
                             const std::string& script) {
  const auto folder = TestFolder();
  const auto write = [&](const char* name, const std::vector<float>& values) {
    std::ofstream file(folder / name, std::ios::binary);
    file.write(reinterpret_cast<const char*>(values.data()),
               static_cast<std::streamsize>(values.size() * sizeof(float)));
  };
  write("e", estimated);
  write("t", truth);
  std::ofstream(folder / "script.py")
      << "import numpy as np\n"
      << "e = np.fromfile('" << (folder / "e").string() << "', np.float32).astype(np.float64)\n"
      << "t = np.fromfile('" << (folder / "t").string() << "', np.float32).astype(np.float64)\n"
      << "known = (e > 0) & (t > 0)\n"
      << "e, t = e[known], t[known]\n"
      << script;
  std::istringstream output(RunProgram("/usr/bin/python3 " + (folder / "script.py").string()));
  std::vector<double> numbers;
  for (double number = 0; output >> number;) numbers.push_back(number);
  return numbers;
}

struct Maps {
  std::vector<float> estimated, truth;
};

// With holes in both.
Maps RandomMaps(const char* test) {
  Rng rng(StreamSeed(0, test, "depth"));
  Maps maps;
  for (int i = 0; i < 5000; ++i) {
    const double z = rng.Uniform(0.5, 8);
    maps.truth.push_back(rng.Uniform() < 0.1 ? 0.0F : static_cast<float>(z));
    maps.estimated.push_back(
        rng.Uniform() < 0.1 ? 0.0F : static_cast<float>(z * std::exp(0.1 + 0.2 * rng.Normal())));
  }
  return maps;
}

TEST(DepthErrors, AgreeWithNumpy) {
  const Maps maps = RandomMaps("DepthErrors.AgreeWithNumpy");
  const auto expected = AskNumpy(maps.estimated, maps.truth, R"(
d = np.log(e) - np.log(t)
ratio = np.maximum(e / t, t / e)
for value in [len(t), np.mean(abs(e - t) / t), np.mean((e - t) ** 2 / t), np.sqrt(np.mean((e - t) ** 2)),
              np.sqrt(np.mean(d ** 2)), 100 * np.std(d), 100 * np.mean(ratio < 1.25),
              100 * np.mean(ratio < 1.25 ** 2), 100 * np.mean(ratio < 1.25 ** 3), np.mean(abs(e - t)),
              np.median(e - t)]:
    print(repr(float(value)))
)");
  const auto errors = ComputeDepthErrors(maps.estimated, maps.truth);
  ASSERT_TRUE(errors.has_value());
  const std::vector<double> found = {static_cast<double>(errors->count),
                                     errors->abs_rel,
                                     errors->sq_rel,
                                     errors->rmse,
                                     errors->rmse_log,
                                     errors->si_log,
                                     errors->delta_percent[0],
                                     errors->delta_percent[1],
                                     errors->delta_percent[2],
                                     errors->mae,
                                     errors->median_signed_error};
  ASSERT_EQ(found.size(), expected.size());
  for (size_t i = 0; i < found.size(); ++i) {
    EXPECT_NEAR(found[i], expected[i], 1e-9 * (1 + std::abs(expected[i]))) << i;
  }
}

TEST(DepthErrors, FitsAgreeWithNumpy) {
  const Maps maps = RandomMaps("DepthErrors.FitsAgreeWithNumpy");
  const auto expected = AskNumpy(maps.estimated, maps.truth, R"(
scale, shift = np.polyfit(e, t, 1)
for value in [np.median(t) / np.median(e), scale, shift]:
    print(repr(float(value)))
)");
  const auto median = FitDepth(maps.estimated, maps.truth, DepthFitKind::kMedian);
  const auto affine = FitDepth(maps.estimated, maps.truth, DepthFitKind::kAffine);
  ASSERT_EQ(expected.size(), 3u);
  EXPECT_NEAR(median->scale, expected[0], 1e-12);
  EXPECT_EQ(median->shift, 0);
  EXPECT_NEAR(affine->scale, expected[1], 1e-9);
  EXPECT_NEAR(affine->shift, expected[2], 1e-9);
}

// The evaluations of three papers, written down in numpy from their equations: Eigen et al. 2014
// (metric, a range of depths, prediction clamped to it), Zhou et al. 2017 (ratio of the medians)
// and Ranftl et al. 2020 (least squares of scale and shift of inverse depth; what lies beyond the
// cap is put there), and the same of depth (Ke et al. 2024).
TEST(DepthProtocols, AgreeWithNumpyTranscriptions) {
  const Maps maps = RandomMaps("DepthProtocols.AgreeWithNumpyTranscriptions");
  const DepthRange range = {1, 6};
  const auto expected = AskNumpy(maps.estimated, maps.truth, R"(
counted = (t >= 1) & (t <= 6)
e, t = e[counted], t[counted]
def metrics(z):
    z = np.clip(z, 1, 6)
    d = np.log(z) - np.log(t)
    worst = np.maximum(z / t, t / z)
    return [np.mean(np.abs(z - t) / t), np.mean((z - t) ** 2 / t), np.sqrt(np.mean((z - t) ** 2)),
            np.sqrt(np.mean(d ** 2)), np.mean(np.abs(np.log10(z) - np.log10(t))),
            100 * np.sqrt(np.mean(d ** 2) - np.mean(d) ** 2)] + [100 * np.mean(worst < 1.25 ** k) for k in (1, 2, 3)]
def solved(columns, right): return columns @ np.linalg.lstsq(columns, right, rcond=None)[0]
def inverse(disparity): return 1 / np.maximum(disparity, 1 / 6)
one = np.ones_like(e)
for z in [e, e * np.median(t) / np.median(e), solved(np.stack([e, one], 1), t),
          inverse(solved(np.stack([1 / e], 1), 1 / t)), inverse(solved(np.stack([1 / e, one], 1), 1 / t))]:
    for value in metrics(z):
        print(repr(float(value)))
)");
  size_t next = 0;
  for (const DepthProtocol protocol : AllValues<DepthProtocol>()) {
    const auto errors = ComputeDepthErrors(maps.estimated, maps.truth, protocol, range);
    ASSERT_TRUE(errors.has_value());
    for (const double found : {errors->abs_rel, errors->sq_rel, errors->rmse, errors->rmse_log,
                               errors->log10, errors->si_log, errors->delta_percent[0],
                               errors->delta_percent[1], errors->delta_percent[2]}) {
      // Aligned depth is kept in float.
      ASSERT_LT(next, expected.size());
      EXPECT_NEAR(found, expected[next], 1e-6 * (1 + std::abs(expected[next])))
          << ToString(protocol) << " " << next % 9;
      ++next;
    }
  }
  EXPECT_EQ(next, expected.size());
}

// What MiDaS-like networks give: inverse depth up to scale and shift.
TEST(DepthProtocols, AffineInverseForgivesScaleAndShiftOfInverseDepth) {
  std::vector<float> truth, estimated;
  for (int i = 0; i < 400; ++i) {
    const double z = 1 + 0.005 * i;
    truth.push_back(static_cast<float>(z));
    estimated.push_back(static_cast<float>(1 / (300 / z - 60)));
  }
  const auto abs_rel = [&](DepthProtocol protocol) {
    return ComputeDepthErrors(estimated, truth, protocol)->abs_rel;
  };
  EXPECT_NEAR(abs_rel(DepthProtocol::kAffineInverse), 0, 1e-6);
  EXPECT_GT(abs_rel(DepthProtocol::kAffine), 0.005);
  EXPECT_GT(abs_rel(DepthProtocol::kScale), 0.05);
  EXPECT_GT(abs_rel(DepthProtocol::kMetric), 0.9);
}

TEST(DepthProtocols, AlignedDepthIsClampedToTheRange) {
  const std::vector<float> depth = {0.5F, 1, 2, 4, 0};
  const auto fitted = ApplyFit(depth, {.scale = 1, .shift = -0.4, .of_inverse = true}, {1, 9});
  ASSERT_EQ(fitted.size(), 5u);
  EXPECT_EQ(fitted[0], 1);  // 1 / 1.6
  EXPECT_EQ(fitted[2], 9);  // 1 / 0.1
  EXPECT_EQ(fitted[3], 9);  // beyond infinity
  EXPECT_EQ(fitted[4], 0);
  EXPECT_EQ(ApplyFit(depth, {.scale = 1, .shift = -0.4, .of_inverse = true})[3], 0);
  EXPECT_FALSE(ComputeDepthErrors(depth, depth, DepthProtocol::kAffine, {10, 20}));
  EXPECT_THROW((DepthRange{2, 2}.Validate()), OptionError);
  EXPECT_THROW((DepthRange{-1, 2}.Validate()), OptionError);
}

TEST(DepthErrors, AFactorIsAllThatAWrongScaleCosts) {
  const std::vector<float> truth = {1, 2, 4, 0, 8};
  const std::vector<float> estimated = {1.5F, 3, 6, 5, 12};
  const auto errors = ComputeDepthErrors(estimated, truth);
  EXPECT_EQ(errors->count, 4u);
  EXPECT_NEAR(errors->abs_rel, 0.5, 1e-12);
  EXPECT_NEAR(errors->rmse_log, std::log(1.5), 1e-12);
  EXPECT_NEAR(errors->si_log, 0, 1e-6);  // the root of a canceled sum
  EXPECT_EQ(errors->delta_percent[0], 0);
  EXPECT_EQ(errors->delta_percent[1], 100);
  EXPECT_NEAR(errors->median_signed_error, 1.5, 1e-12);
  for (const DepthFitKind kind : {DepthFitKind::kMedian, DepthFitKind::kAffine}) {
    const auto fitted = ApplyFit(estimated, *FitDepth(estimated, truth, kind));
    EXPECT_NEAR(ComputeDepthErrors(fitted, truth)->abs_rel, 0, 1e-7);
  }
}

TEST(DepthErrors, ThereAreNoneWithoutCommonPixels) {
  const std::vector<float> a = {0, 1}, b = {1, 0};
  EXPECT_FALSE(ComputeDepthErrors(a, b).has_value());
  EXPECT_FALSE(FitDepth(a, b, DepthFitKind::kMedian).has_value());
  EXPECT_FALSE(FitDepth(b, b, DepthFitKind::kAffine).has_value());  // one value has no slope
}

TEST(BinnedDepthErrors, EachPixelCountsInItsBin) {
  BinnedDepthErrors errors({0, 2, 4});
  const std::vector<float> truth = {1, 2, 3, 4, 1}, estimated = {1.1F, 1, 3, 5, 0};
  errors.Add(estimated, truth, truth);
  BinnedDepthErrors twice({0, 2, 4});
  twice.Add(errors);
  twice.Add(errors);
  ASSERT_EQ(twice.bins().size(), 2u);
  EXPECT_EQ(twice.bins()[0].count, 2u);  // z = 1, twice; 4 is beyond, a hole is nowhere
  EXPECT_NEAR(twice.bins()[0].AbsRel(), 0.1, 1e-6);
  EXPECT_EQ(twice.bins()[1].count, 4u);
  EXPECT_NEAR(twice.bins()[1].Mae(), 0.5, 1e-12);
  EXPECT_NEAR(twice.bins()[1].Bias(), -0.25, 1e-12);
}

TEST(NormalErrors, AreTheAnglesBetween) {
  std::vector<float> truth, estimated;
  for (const double deg : {0.0, 10.0, 20.0, 40.0}) {
    const double rad = deg * std::numbers::pi / 180;
    truth.insert(truth.end(), {0, 0, 1});
    estimated.insert(estimated.end(),
                     {static_cast<float>(std::sin(rad)), 0.0F, static_cast<float>(std::cos(rad))});
  }
  truth.insert(truth.end(), {0, 0, 0});  // not known: not counted
  estimated.insert(estimated.end(), {0, 0, 1});
  const auto errors = ComputeNormalErrors(estimated, truth);
  EXPECT_EQ(errors->count, 4u);
  EXPECT_NEAR(errors->mean_deg, 17.5, 1e-4);
  EXPECT_NEAR(errors->median_deg, 15, 1e-4);
  EXPECT_EQ(errors->within_percent, (std::array<double, 3>{50, 75, 75}));
}

TEST(Coverage, CountsWhatIsMissingAndWhatIsInvented) {
  //  a hole of 4 pixels, one of 1 (too small to count), one pixel that the truth does not know
  const std::vector<float> truth = {1, 1, 1, 1, 0,  //
                                    1, 1, 1, 1, 1};
  const std::vector<float> map = {0, 0, 1, 1, 1,  //
                                  0, 0, 1, 0, 1};
  const DepthCoverage coverage = ComputeCoverage(map, truth, 5);
  EXPECT_NEAR(coverage.covered_percent, 100 * 4.0 / 9, 1e-12);
  EXPECT_NEAR(coverage.invented_percent, 10, 1e-12);
  EXPECT_NEAR(coverage.holes_per_megapixel, 1e6 / 9, 1e-6);
  EXPECT_NEAR(ComputeCoverage(map, {}, 5).covered_percent, 50, 1e-12);
}

TEST(SurfaceScore, IsTheHarmonicMean) {
  const std::vector<float> to = {0, 0.01F, 0.02F, 1}, from = {0, 1};
  const SurfaceScore score = ComputeSurfaceScore(to, from, 0.05);
  EXPECT_EQ(score.accuracy_percent, 75);
  EXPECT_EQ(score.completeness_percent, 50);
  EXPECT_NEAR(score.f_percent, 60, 1e-12);
  EXPECT_EQ(ComputeSurfaceScore({}, {}, 0.05).f_percent, 0);
}

}  // namespace
}  // namespace raylift
