#include "raylift/diagnosis/depth_faults.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "base/statistics.h"
#include <Eigen/Core>
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/evaluation/depth_errors.h"

namespace raylift {
namespace {

constexpr size_t kMinPixels = 100;
constexpr int kBlockColumns = 10;
constexpr int kBlockRows = 8;
constexpr size_t kMinBlockPixels = 50;
constexpr float kAtEdgePx = 3;
constexpr float kInteriorPx = 8;
constexpr double kOutlier = 0.05;
constexpr size_t kNoiseLevels = 5;
constexpr double kMinDepthRatio = 1.5;
// An exponent this near to that of a kind of noise makes the noise that kind.
constexpr double kSameExponent = 0.4;
constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();

// Computes ln(estimated / true), NaN where one of them is not known.
class LogRatios {
 public:
  LogRatios(const DepthMap& estimated, const DepthMap& truth)
      : width_(static_cast<size_t>(truth.width_px)), height_(static_cast<size_t>(truth.height_px)) {
    ratios_.resize(truth.z.size(), kUnknown);
    for (size_t i = 0; i < ratios_.size(); ++i) {
      if (estimated.z[i] > 0 && truth.z[i] > 0) {
        ratios_[i] = std::log(estimated.z[i] / truth.z[i]);
        known_.push_back(ratios_[i]);
      }
    }
  }

  size_t count() const { return known_.size(); }
  float At(size_t i) const { return ratios_[i]; }
  double Median() const {
    std::vector<float> values = known_;
    return MidpointMedianInPlace(std::span(values));
  }

  // Returns the median of each block that has enough pixels.
  std::vector<double> BlockMedians() const {
    std::vector<double> medians;
    std::vector<float> values;
    for (size_t row = 0; row < kBlockRows; ++row) {
      for (size_t column = 0; column < kBlockColumns; ++column) {
        values.clear();
        for (size_t y = row * height_ / kBlockRows; y < (row + 1) * height_ / kBlockRows; ++y) {
          for (size_t x = column * width_ / kBlockColumns;
               x < (column + 1) * width_ / kBlockColumns; ++x) {
            const float ratio = ratios_[y * width_ + x];
            if (!std::isnan(ratio)) values.push_back(ratio);
          }
        }
        if (values.size() >= kMinBlockPixels) {
          medians.push_back(MidpointMedianInPlace(std::span(values)));
        }
      }
    }
    return medians;
  }

  // Noise is told by the second differences along rows, which a smooth error hardly has.
  double NoiseSigma() const {
    const auto differences = SecondDifferences();
    return differences.empty() ? 0 : SigmaOf(differences);
  }

  // Returns the noise of the pixels of similar depth, from near to far.
  std::vector<NoiseLevel> NoiseLevels(const DepthMap& truth) const {
    auto differences = SecondDifferences();
    std::sort(differences.begin(), differences.end(), [&](const auto& a, const auto& b) {
      return std::pair(truth.z[a.pixel], a.pixel) < std::pair(truth.z[b.pixel], b.pixel);
    });
    std::vector<NoiseLevel> levels;
    const size_t size = differences.size() / kNoiseLevels;
    for (size_t level = 0; level < kNoiseLevels && size >= kMinPixels; ++level) {
      const auto part = std::span(differences).subspan(level * size, size);
      levels.push_back({static_cast<double>(truth.z[part[size / 2].pixel]), SigmaOf(part)});
    }
    return levels;
  }

 private:
  struct SecondDifference {
    size_t pixel;
    float absolute;
  };

  std::vector<SecondDifference> SecondDifferences() const {
    std::vector<SecondDifference> differences;
    for (size_t y = 0; y < height_; ++y) {
      for (size_t x = 1; x + 1 < width_; ++x) {
        const size_t pixel = y * width_ + x;
        const float* r = &ratios_[pixel];
        const float difference = std::abs(r[-1] - 2 * r[0] + r[1]);
        if (!std::isnan(difference)) differences.push_back({pixel, difference});
      }
    }
    return differences;
  }

  // Returns the standard deviation of independent noise with these second differences, whose
  // variance is six times its own.
  static double SigmaOf(std::span<const SecondDifference> differences) {
    std::vector<float> absolute;
    absolute.reserve(differences.size());
    for (const SecondDifference& difference : differences) absolute.push_back(difference.absolute);
    return kSigmaPerMad * MidpointMedianInPlace(std::span(absolute)) / std::sqrt(6.0);
  }

  size_t width_, height_;
  std::vector<float> ratios_;
  std::vector<float> known_;
};

// A kind of error, its size, and the least size that is large enough to be reported.
struct Rule {
  DepthFault fault;
  std::optional<double> value;
  double least;
};

std::string Describe(DepthFault fault, double value) {
  switch (fault) {
    case DepthFault::kScale:
      if (std::abs(value) > std::numbers::ln2) {
        return fmt::format("scale: depth is {:.4g} times the true one", std::exp(value));
      }
      return fmt::format("scale: depth is {:.1f} % too {}", 100 * std::abs(std::expm1(value)),
                         value > 0 ? "large" : "small");
    case DepthFault::kPerImageScale:
      return fmt::format("per-image scale: factors differ by {:.1f} % between images", 100 * value);
    case DepthFault::kWarp:
      return fmt::format("warp: smooth errors of {:.1f} % within images", 100 * value);
    case DepthFault::kNoise:
      return fmt::format("noise: {:.1f} % from pixel to pixel", 100 * value);
    case DepthFault::kAdditiveNoise:
      return fmt::format("additive noise: {:.1f} % from pixel to pixel, the less the farther",
                         100 * value);
    case DepthFault::kMultiplicativeNoise:
      return fmt::format("multiplicative noise: {:.1f} % from pixel to pixel at every depth",
                         100 * value);
    case DepthFault::kEdges:
      return fmt::format("edges: {:.0f} % more outliers at depth edges than elsewhere", value);
    case DepthFault::kFloaters:
      return fmt::format("floaters: {:.1f} % of the interior has something before it", value);
    case DepthFault::kBubbles:
      return fmt::format("bubbles: {:.1f} % of the interior bulges forward", value);
    case DepthFault::kQuantization:
      return fmt::format("quantization: steps of {:.2f} % of the depth", 100 * value);
    case DepthFault::kHoles:
      return fmt::format("holes: {:.1f} % of the scene is missing", value);
    default:
      break;  // an explanation has its own words
  }
  return {};
}

DepthFault KindOfNoise(std::optional<double> exponent) {
  if (exponent && std::abs(*exponent + 1) <= kSameExponent) return DepthFault::kAdditiveNoise;
  if (exponent && std::abs(*exponent) <= kSameExponent) return DepthFault::kMultiplicativeNoise;
  return DepthFault::kNoise;
}

}  // namespace

double RobustSigma(std::vector<double> values) {
  if (values.empty()) return 0;
  const double median = MidpointMedianInPlace(std::span(values));
  for (double& value : values) value = std::abs(value - median);
  return kSigmaPerMad * MidpointMedianInPlace(std::span(values));
}

std::optional<DepthDeviation> MeasureDeviation(const DepthMap& estimated, const DepthMap& truth,
                                               std::span<const float> to_true_edge_px) {
  RAYLIFT_CHECK_EQ(estimated.z.size(), truth.z.size());
  RAYLIFT_CHECK_EQ(to_true_edge_px.size(), truth.z.size());
  const LogRatios ratios(estimated, truth);
  if (ratios.count() < kMinPixels) return std::nullopt;
  DepthDeviation deviation;
  deviation.count = ratios.count();
  deviation.log_scale = ratios.Median();
  deviation.warp_sigma = RobustSigma(ratios.BlockMedians());
  deviation.noise_sigma = ratios.NoiseSigma();
  deviation.noise_levels = ratios.NoiseLevels(truth);

  const double outlier = std::max(kOutlier, 4 * (deviation.noise_sigma + deviation.warp_sigma));
  const auto spurious = FindDepthEdges(estimated, std::max(0.05, 8 * deviation.noise_sigma));
  std::array<size_t, 2> pixels = {0, 0}, outliers = {0, 0};  // at edges, in the interior
  size_t in_front = 0, spurious_edges = 0;
  for (size_t i = 0; i < truth.z.size(); ++i) {
    if (std::isnan(ratios.At(i))) continue;
    const double error = static_cast<double>(ratios.At(i)) - deviation.log_scale;
    if (to_true_edge_px[i] <= kAtEdgePx) {
      ++pixels[0];
      outliers[0] += std::abs(error) > outlier;
    } else if (to_true_edge_px[i] > kInteriorPx) {
      ++pixels[1];
      outliers[1] += std::abs(error) > outlier;
      in_front += error < -outlier;
      spurious_edges += spurious[i];
    }
  }
  deviation.edge_outliers_percent = Percent(outliers[0], pixels[0]);
  deviation.interior_outliers_percent = Percent(outliers[1], pixels[1]);
  deviation.in_front_percent = Percent(in_front, pixels[1]);
  if (in_front > 0) {
    deviation.edges_per_pixel_in_front =
        static_cast<double>(spurious_edges) / static_cast<double>(in_front);
  }
  return deviation;
}

// Returns the slope of a line through the logarithms.
std::optional<double> NoiseExponent(std::span<const NoiseLevel> levels) {
  std::vector<Eigen::Vector2d> logs;
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  double least = std::numeric_limits<double>::infinity(), largest = 0;
  for (const NoiseLevel& level : levels) {
    if (!(level.depth > 0) || !(level.sigma > 0)) continue;
    logs.emplace_back(std::log(level.depth), std::log(level.sigma));
    mean += logs.back();
    least = std::min(least, level.depth);
    largest = std::max(largest, level.depth);
  }
  if (!(largest > kMinDepthRatio * least)) return std::nullopt;
  mean /= static_cast<double>(logs.size());
  double covariance = 0, variance = 0;
  for (const Eigen::Vector2d& log : logs) {
    covariance += (log - mean).x() * (log - mean).y();
    variance += (log - mean).x() * (log - mean).x();
  }
  return covariance / variance;
}

std::vector<Finding> FindFaults(const SourceTraits& traits) {
  const DepthFault noise = KindOfNoise(traits.noise_exponent);
  const DepthFault front = traits.front_is_smooth ? DepthFault::kBubbles : DepthFault::kFloaters;
  const std::array<Rule, 8> rules = {{
      {DepthFault::kScale, traits.log_scale, 0.02},
      {DepthFault::kPerImageScale, traits.log_scale_sigma, 0.02},
      {DepthFault::kWarp, traits.warp_sigma, 0.012},
      {noise, traits.noise_sigma, 0.008},
      {DepthFault::kEdges, traits.edge_outliers_percent, 15},
      {front, traits.in_front_percent, 1},
      {DepthFault::kQuantization, traits.relative_quantization, 0.004},
      {DepthFault::kHoles, traits.missing_percent, 5},
  }};
  std::vector<Finding> findings;
  for (const Rule& rule : rules) {
    if (!rule.value || std::abs(*rule.value) < rule.least) continue;
    findings.push_back({rule.fault, *rule.value, std::abs(*rule.value) / rule.least,
                        Describe(rule.fault, *rule.value)});
    if (rule.fault == DepthFault::kAdditiveNoise && traits.noise_length) {
      findings.back().text = fmt::format(
          "additive noise: {:.2g} units from pixel to pixel at "
          "every depth",
          *traits.noise_length);
    }
  }
  std::stable_sort(findings.begin(), findings.end(),
                   [](const Finding& a, const Finding& b) { return a.severity > b.severity; });
  return findings;
}

}  // namespace raylift
