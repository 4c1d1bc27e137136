#include "raylift/evaluation/depth_errors.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/constants.h"
#include "base/statistics.h"

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

// The depths that both maps know, in order.
struct Common {
  std::vector<double> estimated;
  std::vector<double> truth;
  size_t size() const { return truth.size(); }
};

bool IsKnown(float z) { return z > 0 && std::isfinite(z); }

Common Intersect(std::span<const float> estimated, std::span<const float> truth) {
  RAYLIFT_CHECK_EQ(estimated.size(), truth.size());
  Common common;
  for (size_t i = 0; i < truth.size(); ++i) {
    if (IsKnown(estimated[i]) && IsKnown(truth[i])) {
      common.estimated.push_back(static_cast<double>(estimated[i]));
      common.truth.push_back(static_cast<double>(truth[i]));
    }
  }
  return common;
}

}  // namespace

std::optional<DepthErrors> ComputeDepthErrors(std::span<const float> estimated,
                                              std::span<const float> truth) {
  const Common common = Intersect(estimated, truth);
  if (common.size() == 0) return std::nullopt;
  double abs_rel = 0, sq_rel = 0, square = 0, absolute = 0;
  double log_square = 0, log_sum = 0, log_absolute = 0;
  std::array<size_t, 3> within = {0, 0, 0};
  std::vector<double> signed_errors;
  signed_errors.reserve(common.size());
  for (size_t i = 0; i < common.size(); ++i) {
    const double e = common.estimated[i], t = common.truth[i];
    const double difference = e - t;
    const double log_ratio = std::log(e / t);
    abs_rel += std::abs(difference) / t;
    sq_rel += difference * difference / t;
    square += difference * difference;
    absolute += std::abs(difference);
    log_sum += log_ratio;
    log_square += log_ratio * log_ratio;
    log_absolute += std::abs(log_ratio);
    signed_errors.push_back(difference);
    const double ratio = std::max(e / t, t / e);
    within[0] += ratio < 1.25;
    within[1] += ratio < 1.25 * 1.25;
    within[2] += ratio < 1.25 * 1.25 * 1.25;
  }
  const auto n = static_cast<double>(common.size());
  const double log_mean = log_sum / n;
  DepthErrors errors;
  errors.count = common.size();
  errors.abs_rel = abs_rel / n;
  errors.sq_rel = sq_rel / n;
  errors.rmse = std::sqrt(square / n);
  errors.rmse_log = std::sqrt(log_square / n);
  errors.si_log = 100 * std::sqrt(std::max(0.0, log_square / n - log_mean * log_mean));
  for (size_t k = 0; k < within.size(); ++k) {
    errors.delta_percent[k] = Percent(within[k], common.size());
  }
  errors.log10 = log_absolute / n / std::numbers::ln10;
  errors.mae = absolute / n;
  errors.median_signed_error = MidpointMedianInPlace(std::span(signed_errors));
  return errors;
}

namespace {

std::optional<DepthFitKind> FitOf(DepthProtocol protocol) {
  using enum DepthProtocol;
  switch (protocol) {
    case kMetric:
      return std::nullopt;
    case kScale:
      return DepthFitKind::kMedian;
    case kAffine:
      return DepthFitKind::kAffine;
    case kScaleInverse:
      return DepthFitKind::kInverseScale;
    case kAffineInverse:
      return DepthFitKind::kInverseAffine;
  }
  return std::nullopt;
}

// Fits a * scale + shift = b by least squares; nullopt where a is the same everywhere.
std::optional<DepthFit> FitLine(std::span<const double> a, std::span<const double> b) {
  const auto n = static_cast<double>(a.size());
  double mean_a = 0, mean_b = 0;
  for (size_t i = 0; i < a.size(); ++i) {
    mean_a += a[i] / n;
    mean_b += b[i] / n;
  }
  double covariance = 0, variance = 0;
  for (size_t i = 0; i < a.size(); ++i) {
    covariance += (a[i] - mean_a) * (b[i] - mean_b);
    variance += (a[i] - mean_a) * (a[i] - mean_a);
  }
  if (!(variance > 0)) return std::nullopt;
  const double scale = covariance / variance;
  return DepthFit{scale, mean_b - scale * mean_a};
}

}  // namespace

void DepthRange::Validate() const {
  RequireAtLeast("min_depth", min, 0);
  if (!(max > min)) {
    throw OptionError("max_depth", FormatDouble(max),
                      "must be larger than the smallest, " + FormatDouble(min));
  }
}

std::optional<DepthErrors> ComputeDepthErrors(std::span<const float> estimated,
                                              std::span<const float> truth, DepthProtocol protocol,
                                              const DepthRange& range) {
  std::vector<float> counted(truth.begin(), truth.end());
  for (float& z : counted) {
    if (!range.Contains(static_cast<double>(z))) z = 0;
  }
  DepthFit fit;
  if (const auto kind = FitOf(protocol)) {
    const auto found = FitDepth(estimated, counted, *kind);
    if (!found) return std::nullopt;
    fit = *found;
  }
  return ComputeDepthErrors(ApplyFit(estimated, fit, range), counted);
}

std::optional<DepthFit> FitDepth(std::span<const float> estimated, std::span<const float> truth,
                                 DepthFitKind kind) {
  Common common = Intersect(estimated, truth);
  if (common.size() == 0) return std::nullopt;
  if (kind == DepthFitKind::kMedian) {
    return DepthFit{MidpointMedianInPlace(std::span(common.truth)) /
                        MidpointMedianInPlace(std::span(common.estimated)),
                    0};
  }
  if (kind == DepthFitKind::kAffine) return FitLine(common.estimated, common.truth);
  for (double& z : common.estimated) z = 1 / z;
  for (double& z : common.truth) z = 1 / z;
  std::optional<DepthFit> fit;
  if (kind == DepthFitKind::kInverseAffine) {
    fit = FitLine(common.estimated, common.truth);
  } else {
    double product = 0, square = 0;
    for (size_t i = 0; i < common.size(); ++i) {
      product += common.estimated[i] * common.truth[i];
      square += common.estimated[i] * common.estimated[i];
    }
    fit = DepthFit{product / square, 0};
  }
  if (fit) fit->of_inverse = true;
  return fit;
}

std::vector<float> ApplyFit(std::span<const float> estimated, const DepthFit& fit,
                            const DepthRange& range) {
  std::vector<float> fitted(estimated.size(), 0.0F);
  for (size_t i = 0; i < estimated.size(); ++i) {
    if (!IsKnown(estimated[i])) continue;
    const auto e = static_cast<double>(estimated[i]);
    double z = fit.of_inverse ? fit.scale / e + fit.shift : fit.scale * e + fit.shift;
    if (fit.of_inverse) z = z > 0 ? 1 / z : kInfinity;
    z = std::clamp(z, range.min, range.max);
    fitted[i] = z > 0 && std::isfinite(z) ? static_cast<float>(z) : 0.0F;
  }
  return fitted;
}

BinnedDepthErrors::BinnedDepthErrors(std::vector<double> edges) : edges_(std::move(edges)) {
  RAYLIFT_CHECK(edges_.size() >= 2 && std::is_sorted(edges_.begin(), edges_.end()));
  bins_.resize(edges_.size() - 1);
}

void BinnedDepthErrors::Add(std::span<const float> estimated, std::span<const float> truth,
                            std::span<const float> at) {
  RAYLIFT_CHECK_EQ(estimated.size(), truth.size());
  RAYLIFT_CHECK_EQ(estimated.size(), at.size());
  for (size_t i = 0; i < at.size(); ++i) {
    const auto x = static_cast<double>(at[i]);
    if (!IsKnown(estimated[i]) || !IsKnown(truth[i]) || x < edges_.front() || x >= edges_.back()) {
      continue;
    }
    const auto next = std::upper_bound(edges_.begin(), edges_.end(), x);
    Bin& bin = bins_[static_cast<size_t>(next - edges_.begin()) - 1];
    const auto t = static_cast<double>(truth[i]);
    const double difference = static_cast<double>(estimated[i]) - t;
    ++bin.count;
    bin.sum_abs_rel += std::abs(difference) / t;
    bin.sum_abs += std::abs(difference);
    bin.sum_signed_rel += difference / t;
  }
}

void BinnedDepthErrors::Add(const BinnedDepthErrors& other) {
  RAYLIFT_CHECK(edges_ == other.edges_);
  for (size_t i = 0; i < bins_.size(); ++i) {
    bins_[i].count += other.bins_[i].count;
    bins_[i].sum_abs_rel += other.bins_[i].sum_abs_rel;
    bins_[i].sum_abs += other.bins_[i].sum_abs;
    bins_[i].sum_signed_rel += other.bins_[i].sum_signed_rel;
  }
}

std::optional<NormalErrors> ComputeNormalErrors(std::span<const float> estimated,
                                                std::span<const float> truth) {
  RAYLIFT_CHECK_EQ(estimated.size(), truth.size());
  std::vector<double> angles_deg;
  double sum_deg = 0;
  std::array<size_t, 3> within = {0, 0, 0};
  for (size_t i = 0; i + 2 < truth.size(); i += 3) {
    double dot = 0, norm_e = 0, norm_t = 0;
    for (size_t k = i; k < i + 3; ++k) {
      const auto e = static_cast<double>(estimated[k]), t = static_cast<double>(truth[k]);
      dot += e * t;
      norm_e += e * e;
      norm_t += t * t;
    }
    if (!(norm_e > 0) || !(norm_t > 0)) continue;
    const double cosine = dot / std::sqrt(norm_e * norm_t);
    const double angle_deg = std::acos(std::clamp(cosine, -1.0, 1.0)) * kDegPerRad;
    angles_deg.push_back(angle_deg);
    sum_deg += angle_deg;
    within[0] += angle_deg < 11.25;
    within[1] += angle_deg < 22.5;
    within[2] += angle_deg < 30;
  }
  if (angles_deg.empty()) return std::nullopt;
  NormalErrors errors;
  errors.count = angles_deg.size();
  errors.mean_deg = sum_deg / static_cast<double>(angles_deg.size());
  errors.median_deg = MidpointMedianInPlace(std::span(angles_deg));
  for (size_t k = 0; k < within.size(); ++k) {
    errors.within_percent[k] = Percent(within[k], angles_deg.size());
  }
  return errors;
}

DepthCoverage ComputeCoverage(std::span<const float> estimated, std::span<const float> truth,
                              int width_px) {
  RAYLIFT_CHECK(truth.empty() || truth.size() == estimated.size());
  RAYLIFT_CHECK(width_px > 0);
  const auto width = static_cast<size_t>(width_px);
  const auto is_wanted = [&](size_t i) { return truth.empty() || IsKnown(truth[i]); };
  size_t wanted = 0, covered = 0, invented = 0, holes = 0;
  std::vector<bool> is_hole(estimated.size(), false);
  for (size_t i = 0; i < estimated.size(); ++i) {
    if (is_wanted(i)) {
      ++wanted;
      IsKnown(estimated[i]) ? ++covered : is_hole[i] = true;
    } else if (IsKnown(estimated[i])) {
      ++invented;
    }
  }
  constexpr size_t kMinPixels = 4;
  std::vector<size_t> stack;
  for (size_t start = 0; start < is_hole.size(); ++start) {
    if (!is_hole[start]) continue;
    size_t pixels = 0;
    const auto take = [&](size_t i) {
      is_hole[i] = false;
      stack.push_back(i);
      ++pixels;
    };
    take(start);
    while (!stack.empty()) {
      const size_t i = stack.back();
      stack.pop_back();
      if (i % width > 0 && is_hole[i - 1]) take(i - 1);
      if (i % width + 1 < width && is_hole[i + 1]) take(i + 1);
      if (i >= width && is_hole[i - width]) take(i - width);
      if (i + width < is_hole.size() && is_hole[i + width]) take(i + width);
    }
    holes += pixels >= kMinPixels;
  }
  DepthCoverage coverage;
  coverage.covered_percent = Percent(covered, wanted);
  coverage.invented_percent = Percent(invented, estimated.size());
  if (wanted > 0) {
    coverage.holes_per_megapixel = 1e6 * static_cast<double>(holes) / static_cast<double>(wanted);
  }
  return coverage;
}

SurfaceScore ComputeSurfaceScore(std::span<const float> to_truth, std::span<const float> from_truth,
                                 double threshold) {
  const auto share = [threshold](std::span<const float> distances) {
    const auto close = std::count_if(distances.begin(), distances.end(), [threshold](float d) {
      return static_cast<double>(d) < threshold;
    });
    return Percent(static_cast<size_t>(close), distances.size());
  };
  SurfaceScore score;
  score.threshold = threshold;
  score.accuracy_percent = share(to_truth);
  score.completeness_percent = share(from_truth);
  const double sum = score.accuracy_percent + score.completeness_percent;
  score.f_percent = sum > 0 ? 2 * score.accuracy_percent * score.completeness_percent / sum : 0;
  return score;
}

namespace {

// Computes the lower envelope of the parabolas (x - q)^2 + values[q], at every x, in place.
void TransformLine(std::span<double> values, std::vector<size_t>& apexes,
                   std::vector<double>& starts, std::vector<double>& result) {
  apexes.clear();
  starts.clear();
  const auto height = [&](size_t q) { return values[q] + static_cast<double>(q * q); };
  for (size_t q = 0; q < values.size(); ++q) {
    if (values[q] == kInfinity) continue;
    double start = -kInfinity;
    while (!apexes.empty()) {
      const size_t p = apexes.back();
      start = (height(q) - height(p)) / (2 * static_cast<double>(q - p));
      if (start > starts.back()) break;
      apexes.pop_back();
      starts.pop_back();
      start = -kInfinity;
    }
    apexes.push_back(q);
    starts.push_back(start);
  }
  if (apexes.empty()) return;
  result.resize(values.size());
  size_t k = 0;
  for (size_t x = 0; x < values.size(); ++x) {
    while (k + 1 < starts.size() && starts[k + 1] <= static_cast<double>(x)) ++k;
    const double offset = static_cast<double>(x) - static_cast<double>(apexes[k]);
    result[x] = offset * offset + values[apexes[k]];
  }
  std::copy(result.begin(), result.end(), values.begin());
}

}  // namespace

std::vector<uint8_t> FindDepthEdges(const DepthMap& map, double min_jump) {
  std::vector<uint8_t> edges(map.z.size(), 0);
  const auto jumps_to = [&](int x, int y, float z) {
    if (x < 0 || y < 0 || x >= map.width_px || y >= map.height_px) return false;
    const float other = map.At(x, y);
    return other > 0 && static_cast<double>(other - z) > min_jump * static_cast<double>(z);
  };
  for (int y = 0; y < map.height_px; ++y) {
    for (int x = 0; x < map.width_px; ++x) {
      const float z = map.At(x, y);
      if (z > 0 && (jumps_to(x - 1, y, z) || jumps_to(x + 1, y, z) || jumps_to(x, y - 1, z) ||
                    jumps_to(x, y + 1, z))) {
        edges[static_cast<size_t>(y) * static_cast<size_t>(map.width_px) + static_cast<size_t>(x)] =
            1;
      }
    }
  }
  return edges;
}

std::vector<float> DistanceToSet(std::span<const uint8_t> mask, int width_px) {
  RAYLIFT_CHECK(width_px > 0);
  const auto width = static_cast<size_t>(width_px);
  const size_t height = mask.size() / width;
  RAYLIFT_CHECK_EQ(width * height, mask.size());
  std::vector<double> squared(mask.size());
  std::vector<size_t> apexes;
  std::vector<double> starts, result, column(height);
  for (size_t x = 0; x < width; ++x) {
    for (size_t y = 0; y < height; ++y) column[y] = mask[y * width + x] != 0 ? 0 : kInfinity;
    TransformLine(column, apexes, starts, result);
    for (size_t y = 0; y < height; ++y) squared[y * width + x] = column[y];
  }
  for (size_t y = 0; y < height; ++y) {
    TransformLine(std::span(squared).subspan(y * width, width), apexes, starts, result);
  }
  std::vector<float> distances(mask.size());
  std::transform(squared.begin(), squared.end(), distances.begin(),
                 [](double d) { return static_cast<float>(std::sqrt(d)); });
  return distances;
}

EdgeErrors ComputeEdgeErrors(std::span<const uint8_t> estimated, std::span<const uint8_t> truth,
                             int width_px, double max_px) {
  RAYLIFT_CHECK_EQ(estimated.size(), truth.size());
  const auto to_truth = DistanceToSet(truth, width_px);
  const auto to_estimated = DistanceToSet(estimated, width_px);
  EdgeErrors errors;
  size_t close = 0;
  double sum_accuracy = 0, sum_completeness = 0;
  for (size_t i = 0; i < truth.size(); ++i) {
    if (estimated[i] != 0) {
      ++errors.num_estimated;
      if (static_cast<double>(to_truth[i]) < max_px) {
        ++close;
        sum_accuracy += static_cast<double>(to_truth[i]);
      }
    }
    if (truth[i] != 0) {
      ++errors.num_true;
      sum_completeness += std::min(static_cast<double>(to_estimated[i]), max_px);
    }
  }
  if (close > 0) errors.accuracy_px = sum_accuracy / static_cast<double>(close);
  if (errors.num_true > 0) {
    errors.completeness_px = sum_completeness / static_cast<double>(errors.num_true);
  }
  if (errors.num_estimated > 0) {
    errors.spurious_percent = 100.0 * static_cast<double>(errors.num_estimated - close) /
                              static_cast<double>(errors.num_estimated);
  }
  return errors;
}

}  // namespace raylift
