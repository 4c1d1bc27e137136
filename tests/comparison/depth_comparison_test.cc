#include "raylift/comparison/depth_comparison.h"

#include <atomic>
#include <cmath>

#include "base/rng.h"
#include "comparison/compared_room.h"
#include "comparison/comparison_tables.h"
#include "support/enum_names.h"
#include "support/test_data.h"
#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

namespace raylift {
namespace {

using ::testing::IsEmpty;
using ::testing::SizeIs;

std::vector<DepthFault> Named(const SourceComparison& source) {
  std::vector<DepthFault> named;
  for (const Finding& finding : source.findings) named.push_back(finding.fault);
  return named;
}

struct Planted {
  std::string name;
  DepthPerturbation perturbation;
  DepthFault expected;
};

std::vector<Planted> EveryDistortion() {
  return {{"scale", {.scale = 1.1}, DepthFault::kScale},
          {"scales", {.scale_sigma = 0.1}, DepthFault::kPerImageScale},
          {"warp", {.warp_sigma = 0.06}, DepthFault::kWarp},
          {"noise", {.relative_noise_sigma = 0.02}, DepthFault::kMultiplicativeNoise},
          {"flying pixels", {.flying_share = 0.8}, DepthFault::kFlying},
          {"floaters", {.floaters = 25}, DepthFault::kFloaters},
          {"bubbles", {.bubbles = 4}, DepthFault::kBubbles},
          {"steps", {.quantization_step = 0.2}, DepthFault::kQuantization},
          {"holes", {.hole_share = 0.2}, DepthFault::kHoles},
          {"additive noise", {.noise_sigma = 0.08}, DepthFault::kAdditiveNoise}};
}

class Sources {
 public:
  explicit Sources(const ComparedRoom& room) {
    compared_.push_back({"mesh", "", "", room.SharedTruth(), room.mesh});
    for (const Planted& planted : EveryDistortion()) {
      compared_.push_back({planted.name, "", "", room.Shared(planted.perturbation)});
    }
  }
  std::span<const ComparedSource> compared() const { return compared_; }

 private:
  std::vector<ComparedSource> compared_;
};

DepthComparison CompareWithMesh(const ComparedRoom& room, const Sources& sources, int threads) {
  DepthComparisonOptions options;
  options.truth = 0;
  options.max_overlaps = 2;
  options.threads = threads;
  return CompareDepth(sources.compared(), room.images, {}, options);
}

TEST(CompareDepth, NamesWhatWasPlanted) {
  const ComparedRoom room(4);
  const Sources sources(room);
  const DepthComparison comparison = CompareWithMesh(room, sources, 0);
  EXPECT_THAT(comparison.sources[0].findings, IsEmpty());
  EXPECT_TRUE(comparison.sources[0].is_truth);
  const auto planted = EveryDistortion();
  for (size_t i = 0; i < planted.size(); ++i) {
    const SourceComparison& source = comparison.sources[i + 1];
    ASSERT_THAT(source.findings, SizeIs(::testing::Ge(1u))) << planted[i].name << "\n"
                                                            << FormatComparisonText(comparison);
    EXPECT_EQ(source.findings.front().fault, planted[i].expected)
        << planted[i].name << "\n"
        << FormatComparisonText(comparison);
  }
  EXPECT_NEAR(comparison.sources[1].findings.front().amount, std::log(1.1), 1e-3);

  // And measures as much of it as was planted.
  const auto mean = [&](size_t source, std::string_view key) {
    for (const DepthMetric& metric : DepthMetrics()) {
      if (metric.key == key) return *MeanOverImages(comparison.sources[source], metric.value);
    }
    throw std::logic_error("no such metric");
  };
  EXPECT_NEAR(mean(1, "abs_rel"), 0.1, 1e-3);
  EXPECT_NEAR(mean(1, "median_abs_rel"), 0, 1e-3);
  EXPECT_NEAR(mean(1, "delta1_percent"), 100, 1e-9);
  EXPECT_NEAR(mean(4, "noise_percent"), 2, 0.2);
  EXPECT_NEAR(*comparison.sources[4].traits.noise_exponent, 0, 0.1);
  EXPECT_NEAR(*comparison.sources[10].traits.noise_exponent, -1, 0.15);
  EXPECT_NEAR(*comparison.sources[10].traits.noise_length, 0.08, 0.008);
  EXPECT_NEAR(mean(9, "coverage_percent"), 80, 0.5);
  EXPECT_NEAR(mean(0, "coverage_percent"), 100, 1e-9);
  // A scale of 1.1 moves surfaces by a tenth of their depth: F-scores at 1, 2 and 5 % are low, and
  // those of the map with holes are not.
  ASSERT_THAT(comparison.sources[1].surface, SizeIs(3));
  EXPECT_LT(comparison.sources[1].surface[0].f_percent, 35);
  EXPECT_GT(comparison.sources[9].surface[2].f_percent, 95);
}

TEST(NoiseExponent, IsThePowerOfDepth) {
  for (const double exponent : {-1.0, 0.0, 1.0}) {
    std::vector<NoiseLevel> levels = {{0, 1}, {3, 0}};  // say nothing
    for (const double depth : {1.0, 1.3, 2.0, 5.0}) {
      levels.push_back({depth, 0.02 * std::pow(depth, exponent)});
    }
    EXPECT_NEAR(*NoiseExponent(levels), exponent, 1e-12);
  }
  EXPECT_FALSE(NoiseExponent(std::vector<NoiseLevel>{{2, 0.1}, {2.9, 0.2}}));
  EXPECT_FALSE(NoiseExponent({}));
}

TEST(Diagnose, NamesNoiseByHowItGrows) {
  const auto named = [](std::optional<double> exponent) {
    SourceTraits traits;
    traits.noise_sigma = 0.02;
    traits.noise_exponent = exponent;
    return FindFaults(traits).at(0).fault;
  };
  EXPECT_EQ(named(-1.1), DepthFault::kAdditiveNoise);
  EXPECT_EQ(named(0.2), DepthFault::kMultiplicativeNoise);
  EXPECT_EQ(named(-0.5), DepthFault::kNoise);  // a mixture
  EXPECT_EQ(named(1), DepthFault::kNoise);
  EXPECT_EQ(named(std::nullopt), DepthFault::kNoise);
}

TEST(CompareDepth, WithoutATruthViewsTellScales) {
  const ComparedRoom room;
  const std::vector<ComparedSource> sources = {
      {"good", "", "", room.Shared({})},
      {"scaled", "", "", room.Scaled(1.1)},
      {"uneven", "", "", room.Shared({.scale_sigma = 0.08})}};
  const DepthComparison comparison = CompareDepth(sources, room.images, {}, {});
  EXPECT_THAT(Named(comparison.sources[0]), IsEmpty()) << FormatComparisonText(comparison);
  EXPECT_THAT(Named(comparison.sources[1]), ::testing::Contains(DepthFault::kScale))
      << FormatComparisonText(comparison);
  EXPECT_THAT(Named(comparison.sources[2]), ::testing::Contains(DepthFault::kPerImageScale))
      << FormatComparisonText(comparison);
}

TEST(CompareDepth, MatchesTellScalesWithoutATruth) {
  const ComparedRoom room;
  Rng rng(StreamSeed(0, "CompareDepth.Matches", ""));
  std::vector<ReferenceMatch> matches;
  for (int a = 0; a < 6; ++a) {
    for (int b = a + 1; b < 6; ++b) {
      for (int k = 0; k < 60; ++k) {
        const std::vector<Eigen::Vector2d> pixel = {{rng.Uniform(5, 187), rng.Uniform(5, 139)}};
        const auto points = room.truth.Lift(room.images[static_cast<size_t>(a)], pixel);
        const PosedImage& other = room.images[static_cast<size_t>(b)];
        const auto seen =
            other.camera.ImgFromCam(other.cam_from_world * points.at(0).value().point_in_world);
        if (seen && other.camera.Contains(*seen)) matches.push_back({a, b, pixel[0], *seen});
      }
    }
  }
  const std::vector<ComparedSource> sources = {{"good", "", "", room.SharedTruth()},
                                               {"scaled", "", "", room.Scaled(1.1)}};
  const DepthComparison comparison = CompareDepth(sources, room.images, matches, {});
  ASSERT_TRUE(comparison.sources[0].matches.has_value());
  // What the match sees may be hidden in the other image, but its reprojection is right.
  EXPECT_LT(comparison.sources[0].matches->median_px, 0.01);
  EXPECT_GT(comparison.sources[1].matches->median_px, 1);
  EXPECT_THAT(Named(comparison.sources[0]), IsEmpty());
  ASSERT_THAT(comparison.sources[1].findings, SizeIs(::testing::Ge(1u)));
  EXPECT_EQ(comparison.sources[1].findings.front().fault, DepthFault::kScale);
  EXPECT_NEAR(std::exp(comparison.sources[1].findings.front().amount), 1.1, 0.01);

  // Off the epipolar lines they say nothing of depth.
  std::vector<ReferenceMatch> with_wrong = matches;
  for (size_t i = 0; i < matches.size(); i += 4) {
    with_wrong.push_back(matches[i]);
    with_wrong.back().b_px += Eigen::Vector2d(25, i % 8 == 0 ? 25 : -25);
  }
  const DepthComparison again = CompareDepth(sources, room.images, with_wrong, {});
  const auto count = [](const DepthComparison& c) {
    return static_cast<double>(c.sources[0].matches.value().count);
  };
  // 35 px in any direction are within 3 px of a line by a chance of 5 %.
  EXPECT_LT(count(again), count(comparison) + 0.1 * static_cast<double>(matches.size() / 4));
}

// One image with a few wrong matches does not weigh as much as one with thousands.
TEST(ComparisonTables, MatchErrorsAreOfAllMatchesTogether) {
  SourceComparison source;
  source.images.resize(3);
  source.images[0].matches = MatchErrors{.count = 1000, .median_px = 1.5};
  source.images[1].matches = MatchErrors{.count = 4, .median_px = 90};
  source.images[2].matches = MatchErrors{.count = 0, .missing = 7};  // has no median
  source.matches = MatchErrors{.count = 1004, .missing = 7, .median_px = 1.5};
  const auto of = [&](std::string_view key) -> std::optional<double> {
    for (const DepthMetric& metric : DepthMetrics()) {
      if (metric.key == key) return ValueOfSource(source, metric);
    }
    throw std::logic_error("no such metric");
  };
  EXPECT_EQ(of("match_median_px"), 1.5);
  EXPECT_EQ(of("match_count"), 1004);
  source.matches->count = 0;
  EXPECT_EQ(of("match_median_px"), std::nullopt);
}

TEST(CompareDepth, TheSameForAnyNumberOfThreads) {
  const ComparedRoom room(2);
  const Sources sources(room);
  EXPECT_EQ(FormatComparisonJson(CompareWithMesh(room, sources, 1)),
            FormatComparisonJson(CompareWithMesh(room, sources, 4)));
}

TEST(ComparisonTables, HoldTheSameNumbers) {
  const ComparedRoom room(3);
  const std::vector<ComparedSource> sources = {{"mesh", "", "", room.SharedTruth(), room.mesh},
                                               {"scaled, twice", "", "", room.Scaled(1.1)}};
  DepthComparisonOptions options;
  options.truth = 0;
  const DepthComparison comparison = CompareDepth(sources, room.images, {}, options);
  const auto json = nlohmann::json::parse(FormatComparisonJson(comparison));
  EXPECT_EQ(json["truth"], "mesh");
  EXPECT_EQ(json["sources"][1]["images"].size(), 3u);
  EXPECT_NEAR(json["sources"][1]["means"]["abs_rel"].get<double>(), 0.1, 1e-3);
  EXPECT_TRUE(json["sources"][0]["means"]["abs_rel"].is_null());
  EXPECT_THAT(FormatSourcesCsv(comparison), ::testing::HasSubstr("\n\"scaled, twice\",false,"));
  const std::string text = FormatComparisonText(comparison);
  EXPECT_THAT(text, ::testing::HasSubstr("mesh (truth)"));
  EXPECT_THAT(text, ::testing::HasSubstr("scale: depth is 10.0 % too large"));
}

TEST(CompareDepth, SmallerImagesAddNoErrorToAnExactCopy) {
  const ComparedRoom room(3);
  const std::vector<ComparedSource> sources = {{"mesh", "", "", room.SharedTruth(), room.mesh},
                                               {"copy", "", "", room.Shared({})}};
  for (const int max_side_px : {192, 96, 70, 48}) {
    DepthComparisonOptions options;
    options.truth = 0;
    options.max_side_px = max_side_px;
    options.on_views = [&](size_t, const PosedImage& view, std::span<const SourceView> seen) {
      EXPECT_EQ(view.camera.width_px(), seen[0].depth.width_px);
      EXPECT_LE(view.camera.width_px(), max_side_px);
    };
    const DepthComparison comparison = CompareDepth(sources, room.images, {}, options);
    const auto json = nlohmann::json::parse(FormatComparisonJson(comparison));
    // Maps hold floats.
    EXPECT_LT(json["sources"][1]["means"]["abs_rel"].get<double>(), 1e-6) << max_side_px;
  }
}

TEST(CompareDepth, CallsAsItGoesOn) {
  const ComparedRoom room(3);
  const std::vector<ComparedSource> sources = {{"mesh", "", "", room.SharedTruth(), room.mesh},
                                               {"copy", "", "", room.Shared({})}};
  std::atomic<int> compared = 0;
  int judged = 0;
  DepthComparisonOptions options;
  options.truth = 0;
  options.on_progress = [&] { ++compared; };
  options.on_judged = [&] {
    EXPECT_EQ(compared, 6);
    ++judged;
  };
  CompareDepth(sources, room.images, {}, options);
  EXPECT_EQ(judged, 2);
}

TEST(ComparisonTables, TheFirstLineSaysWhichIsBestForWhat) {
  const ComparedRoom room(3);
  const std::vector<ComparedSource> sources = {
      {"mesh", "", "", room.SharedTruth(), room.mesh},
      {"scaled", "", "", room.Scaled(1.1)},
      {"holes", "", "", room.Shared({.relative_noise_sigma = 0.02, .hole_share = 0.2})}};
  DepthComparisonOptions options;
  options.truth = 0;
  const std::string text = FormatComparisonText(CompareDepth(sources, room.images, {}, options));
  const std::string advice = text.substr(0, text.find('\n'));
  EXPECT_TRUE(advice.starts_with("best: holes for depth (AbsRel 0.0")) << advice;
  EXPECT_THAT(advice, ::testing::HasSubstr("; scaled for depth up to a scale of each image"));
  EXPECT_THAT(advice, ::testing::HasSubstr("completeness (coverage % 100.0)"));
  // Without a choice there is no advice.
  const std::span<const ComparedSource> two = std::span(sources).first(2);
  EXPECT_EQ(Advice(CompareDepth(two, room.images, {}, options)), "");
}

TEST(DepthFault, EachHasAName) { EXPECT_TRUE(NamesEveryValue<DepthFault>()); }

}  // namespace
}  // namespace raylift
