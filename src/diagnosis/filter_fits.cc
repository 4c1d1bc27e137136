// Causes that give a pixel the depth of its neighbors: smoothing, medians, and foreground that is
// fattened or thinned. Filters are computed at the samples alone.

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include "base/statistics.h"
#include "diagnosis/cause_fits.h"

namespace raylift {
namespace {

// A map of half the size, interpolated, is smoothed by about this.
constexpr double kLeastSmoothingPx = 0.5;
// The least mean error of a filter that is large enough to be reported: that of a few pixels.
constexpr double kLeastFilterError = 0.001;
constexpr int kMaxReachPx = 8;

// Calls f(z, dx, dy) for the known depths of the square around the sample.
template <typename Function>
void ForSquare(const DepthMap& map, const CauseSample& sample, int reach, Function f) {
  const int x = static_cast<int>(sample.pixel.x()), y = static_cast<int>(sample.pixel.y());
  for (int v = std::max(0, y - reach); v <= std::min(map.height_px - 1, y + reach); ++v) {
    for (int u = std::max(0, x - reach); u <= std::min(map.width_px - 1, x + reach); ++u) {
      if (const auto z = static_cast<double>(map.At(u, v)); z > 0) f(z, u - x, v - y);
    }
  }
}

class FilterFitter {
 public:
  FilterFitter(std::span<const ExplainedView> views, std::span<const CauseSample> training)
      : views_(views), training_(training) {}

  // Fits the filter of SmoothDepth().
  std::optional<CauseFit> Smoothing() const {
    const auto model = [this](double sigma_px) -> Residual {
      const int reach = static_cast<int>(std::ceil(3 * sigma_px));
      std::vector<double> weights;
      for (int d = 0; d <= reach; ++d)
        weights.push_back(std::exp(-0.5 * d * d / sigma_px / sigma_px));
      return [this, reach, weights](const CauseSample& s) {
        double sum = 0, total = 0;
        ForSquare(views_[s.view].truth, s, reach, [&](double z, int dx, int dy) {
          const double weight = weights[static_cast<size_t>(std::abs(dx))] *
                                weights[static_cast<size_t>(std::abs(dy))];
          sum += weight * z;
          total += weight;
        });
        return LogRatio(s.estimated, sum / total);
      };
    };
    constexpr double kLeastLog = -1, kLargestLog = 3.5;  // log2 of the width
    constexpr size_t kEvery = 3;                         // of the samples: windows are large
    std::vector<CauseSample> some;
    for (size_t i = 0; i < training_.size(); i += kEvery) some.push_back(training_[i]);
    std::vector<Parameters> starts;
    for (double log = kLeastLog; log < kLargestLog; log += 0.5) starts.push_back({log});
    const Parameters found = FindLeast(starts, 0.25, 0.06, [&](const Parameters& parameters) {
      // Errors of other kinds are the less the wider it is.
      if (parameters[0] < kLeastLog || parameters[0] > kLargestLog) {
        return std::numeric_limits<double>::infinity();
      }
      return MeanError(model(std::exp2(parameters[0])), some);
    });
    const double sigma_px = std::exp2(found[0]);
    return CauseFit{DepthFault::kSmoothing,
                    {sigma_px * views_.front().image_px},
                    sigma_px / kLeastSmoothingPx,
                    model(sigma_px)};
  }

  std::optional<CauseFit> Median() const {
    std::vector<CauseFit> fits;
    for (const int reach : {1, 2, 3, 4, 5}) {
      fits.push_back({DepthFault::kMedian,
                      {(2 * reach + 1) * views_.front().image_px},
                      0,
                      [this, reach](const CauseSample& s) {
                        std::vector<double> depths;
                        ForSquare(views_[s.view].truth, s, reach,
                                  [&](double z, int, int) { depths.push_back(z); });
                        return LogRatio(s.estimated, MidpointMedianInPlace(std::span(depths)));
                      }});
    }
    return Best(std::move(fits));
  }

  // A pixel has the nearest (fattened) or farthest (thinned) depth within reach, everywhere or
  // where depth jumps.
  std::optional<CauseFit> Fattening() const {
    constexpr double kJump = 0.1;
    std::vector<CauseFit> fits;
    for (int reach = 1; reach <= kMaxReachPx; ++reach) {
      for (const bool is_thinned : {false, true}) {
        for (const double jump : {0.0, kJump}) {
          const double px = reach * views_.front().image_px;
          fits.push_back({DepthFault::kFattening,
                          {is_thinned ? -px : px},
                          0,
                          [this, reach, is_thinned, jump](const CauseSample& s) {
                            double z = s.truth;
                            ForSquare(views_[s.view].truth, s, reach, [&](double other, int, int) {
                              z = is_thinned ? std::max(z, other) : std::min(z, other);
                            });
                            const bool is_edge = std::abs(std::log(z / s.truth)) > jump;
                            return LogRatio(s.estimated, is_edge ? z : s.truth);
                          }});
        }
      }
    }
    return Best(std::move(fits));
  }

 private:
  // Returns the fit of the least error on the training samples, the first of equals.
  std::optional<CauseFit> Best(std::vector<CauseFit> fits) const {
    std::optional<CauseFit> best;
    double least = std::numeric_limits<double>::infinity();
    for (CauseFit& fit : fits) {
      const double error = MeanError(fit.residual, training_);
      if (!(error < least)) continue;
      least = error;
      best = std::move(fit);
    }
    if (best) best->severity = ErrorAsItIs(training_) / kLeastFilterError;
    return best;
  }

  std::span<const ExplainedView> views_;
  std::span<const CauseSample> training_;
};

}  // namespace

std::vector<CauseFitter> FilterFitters(std::span<const ExplainedView> views,
                                       std::span<const CauseSample> training) {
  const auto fitter = std::make_shared<const FilterFitter>(views, training);
  return {[fitter] { return fitter->Smoothing(); }, [fitter] { return fitter->Median(); },
          [fitter] { return fitter->Fattening(); }};
}

double FlyingPercent(std::span<const ExplainedView> views, std::span<const CauseSample> samples) {
  constexpr double kLeastMargin = 0.03;
  std::vector<std::vector<double>> of_view(views.size());
  for (const CauseSample& s : samples) of_view[s.view].push_back(std::log(s.estimated / s.truth));
  std::vector<double> factors, margins;
  for (auto& logs : of_view) {
    margins.push_back(std::max(kLeastMargin, 3 * RobustSigma(logs)));
    factors.push_back(logs.empty() ? 1 : std::exp(MidpointMedianInPlace(std::span(logs))));
  }
  size_t edges = 0, flying = 0;
  for (const CauseSample& s : samples) {
    const double z = s.estimated / factors[s.view], margin = margins[s.view];
    double nearest = s.truth, farthest = s.truth, off = std::abs(std::log(z / s.truth));
    ForSquare(views[s.view].truth, s, 1, [&](double other, int, int) {
      nearest = std::min(nearest, other);
      farthest = std::max(farthest, other);
      off = std::min(off, std::abs(std::log(z / other)));
    });
    if (std::log(farthest / nearest) < 3 * margin) continue;
    ++edges;
    flying += off > margin && z > nearest && z < farthest;
  }
  return edges > 0 ? 100.0 * static_cast<double>(flying) / static_cast<double>(edges) : 0;
}

}  // namespace raylift
