#include "raylift/lifting/depth_confidence.h"

#include <cmath>
#include <functional>

#include "base/constants.h"
#include "lifting/alignment_text.h"
#include "lifting/room.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "raylift/io/depth_file.h"
#include "raylift/lifting/lifter.h"

namespace raylift {
namespace {

constexpr double kBestSigma = 0.02;

// A room's maps whose right halves are five times as noisy as their left ones.
class NoisyMaps {
 public:
  // Says what confidence there is of a deviation.
  NoisyMaps(const Room& room, const std::function<double(double sigma)>& confidence_of, Rng& rng,
            double best_sigma = kBestSigma, double worst_sigma = 5 * kBestSigma,
            DepthInterpolation interpolation = DepthInterpolation::kNearest)
      : room_(room), folder_(TestFolder()) {
    for (const PosedImage& reference : room.references) {
      const Camera& camera = reference.camera;
      std::vector<Eigen::Vector2d> pixels;
      for (int y = 0; y < kHeight; ++y) {
        for (int x = 0; x < kWidth; ++x) pixels.emplace_back(10 * x + 5, 10 * y + 5);
      }
      const auto points = room.walls->Lift(reference, pixels);
      DepthMap depth{kWidth, kHeight, {}}, confidence = depth;
      for (size_t i = 0; i < pixels.size(); ++i) {
        const double sigma = pixels[i].x() < camera.width_px() / 2 ? best_sigma : worst_sigma;
        depth.z.push_back(static_cast<float>(points[i]->depth_z * std::exp(sigma * rng.Normal())));
        confidence.z.push_back(static_cast<float>(confidence_of(sigma)));
      }
      WriteDepthFile(folder_ / (reference.name + ".npy"), depth);
      WriteDepthFile(folder_ / "confidence" / (reference.name + ".npy"), confidence);
    }
    maps_ = std::make_shared<const DepthFolder>(
        folder_,
        DepthConvention{.patterns = {"{stem}.npy"},
                        .confidence_pattern = "confidence/{stem}.npy",
                        .confidence_threshold = std::nullopt},
        room.references);
    source_ = std::make_shared<const DepthSource>(
        "noisy", maps_, DepthSamplingOptions{.interpolation = interpolation});
  }

  ConfidenceWorth Learn(int threads, Rng& rng) const {
    return LearnConfidence(*source_, *maps_, {}, room_.references, room_.MatchAll(150, 0.5, rng),
                           threads);
  }

  const std::shared_ptr<const DepthFolder>& maps() const { return maps_; }
  const std::shared_ptr<const GeometrySource>& source() const { return source_; }

 private:
  static constexpr int kWidth = 64, kHeight = 48;
  const Room& room_;
  std::filesystem::path folder_;
  std::shared_ptr<const DepthFolder> maps_;
  std::shared_ptr<const GeometrySource> source_;
};

TEST(LearnConfidence, FindsTheDeviationsWhetherConfidenceFallsOrRisesWithThem) {
  Rng rng = TestRng();
  const Room room(8, rng);
  const std::function<double(double)> kinds[] = {[](double sigma) { return 1 + 0.1 / sigma; },
                                                 [](double sigma) { return sigma; }};
  for (const auto& confidence_of : kinds) {
    const ConfidenceWorth worth = NoisyMaps(room, confidence_of, rng).Learn(1, rng);
    ASSERT_TRUE(worth.tells());
    // Of pixels between two samples; sigmas are compared a fifth apart.
    EXPECT_NEAR(worth.SigmaAt(confidence_of(kBestSigma)), kBestSigma, 0.3 * kBestSigma);
    EXPECT_NEAR(worth.SigmaAt(confidence_of(5 * kBestSigma)), 5 * kBestSigma, 1.5 * kBestSigma);
    EXPECT_NEAR(worth.SigmaAt(std::nan("")), worth.SigmaAt(confidence_of(5 * kBestSigma)), 1e-6);
    EXPECT_THAT(Describe(worth), testing::HasSubstr("tell how noisy the depth is"));
  }
}

TEST(LearnConfidence, DropsWhatTellsNothing) {
  Rng rng = TestRng();
  const Room room(8, rng);
  const ConfidenceWorth worth = NoisyMaps(
                                    room, [&rng](double) { return rng.Uniform(1, 2); }, rng)
                                    .Learn(1, rng);
  EXPECT_FALSE(worth.tells());
  EXPECT_GT(worth.common_sigma, kBestSigma);
  EXPECT_LT(worth.common_sigma, 5 * kBestSigma);
  EXPECT_THAT(Describe(worth), testing::HasSubstr("tell nothing"));
}

TEST(LearnConfidence, IsTheSameForAnyNumberOfThreads) {
  Rng rng = TestRng();
  const Room room(5, rng);
  const NoisyMaps maps(
      room, [](double sigma) { return 1 / sigma; }, rng);
  Rng once = rng, again = rng;
  const ConfidenceWorth one = maps.Learn(1, once), four = maps.Learn(4, again);
  EXPECT_EQ(one.gain, four.gain);
  EXPECT_EQ(one.common_sigma, four.common_sigma);
}

TEST(LearnConfidence, OfFewMapsTellsNothing) {
  Rng rng = TestRng();
  const Room room(7, rng);
  const ConfidenceWorth worth = NoisyMaps(
                                    room, [](double sigma) { return sigma; }, rng)
                                    .Learn(1, rng);
  EXPECT_GT(worth.gain, 2 * worth.gain_sigma);
  EXPECT_FALSE(worth.tells());
}

TEST(LearnConfidence, ClaimsNoSmallerDeviationThanKeypointsTell) {
  Rng rng = TestRng();
  const Room room(8, rng);
  const ConfidenceWorth worth =
      NoisyMaps(
          room, [](double sigma) { return sigma; }, rng, 1e-6, 0.05, DepthInterpolation::kEdgeAware)
          .Learn(1, rng);
  ASSERT_TRUE(worth.tells());
  // A pixel of noise at some hundred pixels per unit of log depth, by some hundred matches a bin.
  EXPECT_GT(worth.knots.front().sigma, 2e-4);
  EXPECT_LT(worth.knots.front().sigma, 0.01);
}

TEST(ConfidenceWorth, IsConstantBeyondItsKnots) {
  const ConfidenceWorth worth = {.knots = {{1, 0.3}, {2, 0.01}}};
  EXPECT_EQ(worth.SigmaAt(kInfinity), 0.01);
  EXPECT_EQ(worth.SigmaAt(-kInfinity), 0.3);
  EXPECT_EQ(worth.SigmaAt(std::nan("")), 0.3);
}

TEST(WeighedSource, GivesPointsTheDeviationsOfTheirConfidences) {
  Rng rng = TestRng();
  const Room room(3, rng);
  const NoisyMaps maps(
      room, [](double sigma) { return sigma; }, rng);
  const ConfidenceWorth worth = {.knots = {{kBestSigma, 0.01}, {5 * kBestSigma, 0.3}}};
  const WeighedSource weighed(maps.source(), maps.maps(), worth);
  const PosedImage& reference = room.references[0];
  const std::vector<Eigen::Vector2d> pixels = {{105, 105}, {505, 105}};
  const auto points = weighed.Lift(reference, pixels);
  EXPECT_NEAR(points[0]->log_depth_sigma.value(), 0.01, 1e-6);
  EXPECT_NEAR(points[1]->log_depth_sigma.value(), 0.3, 1e-5);
  EXPECT_EQ(points[0]->point_sigma, std::nullopt);
  const Match2D2D matches[] = {{0, {10, 20}, pixels[0]}, {0, {30, 40}, pixels[1]}};
  const auto lifted = Matches2D3D(LiftMatches(weighed, room.references, matches));
  for (size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(lifted.at(i).log_depth_sigma, points[i]->log_depth_sigma);
  }
}

}  // namespace
}  // namespace raylift
