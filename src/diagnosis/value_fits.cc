// Causes that change the values of depth: factor, offset, lines, clamps, steps, smoothing.

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <utility>

#include "base/statistics.h"
#include "diagnosis/cause_fits.h"
#include "diagnosis/value_models.h"

#include "raylift/evaluation/depth_perturbation.h"

namespace raylift {
namespace {

// A map of half the size, interpolated, is smoothed by about this.
constexpr double kLeastSmoothingPx = 0.5;
constexpr double kLeastScale = 0.02;  // of the depth, as of the finding "scale"
// Values in steps of 0.4 % of the depth, as of the finding "quantization", are wrong by a quarter
// of a step on average.
constexpr double kLeastQuantizationError = 0.001;
constexpr double kLeastClampedShare = 0.01;

class ValueFitter {
 public:
  ValueFitter(std::span<const ExplainedView> views, std::span<const CauseSample> training)
      : views_(views), training_(training), median_depth_(MedianTrueDepth(training)) {}

  std::optional<CauseFit> Factor() const {
    std::vector<double> logs(views_.size(), 0.0);
    for (size_t view = 0; view < views_.size(); ++view) {
      auto values =
          Collect(view, [](const CauseSample& s) { return std::log(s.estimated / s.truth); });
      if (!values.empty()) logs[view] = MidpointMedianInPlace(std::span(values));
    }
    // Other measures name it.
    return CauseFit{DepthFault::kScale,
                    {},
                    1,
                    [logs](const CauseSample& s) -> std::optional<double> {
                      return std::log(s.estimated / s.truth) - logs[s.view];
                    },
                    {DepthFault::kAffine, DepthFault::kInverseOffset}};
  }

  std::optional<CauseFit> Offset() const {
    auto differences =
        Collect(std::nullopt, [](const CauseSample& s) { return s.estimated - s.truth; });
    const double offset = MidpointMedianInPlace(std::span(differences));
    return CauseFit{
        DepthFault::kOffset,
        {offset},
        std::abs(offset) / median_depth_ / kLeastScale,
        [offset](const CauseSample& s) { return LogRatio(s.estimated, s.truth + offset); },
        {DepthFault::kAffine}};
  }

  std::optional<CauseFit> Affine() const {
    return Lines(
        DepthFault::kAffine, [](const CauseSample& s) { return s.truth; },
        [](const CauseSample& s) { return s.estimated; },
        [](const ValueLine& line, double t) { return line(t); });
  }

  std::optional<CauseFit> InverseAffine() const {
    return Lines(
        DepthFault::kInverseOffset, [](const CauseSample& s) { return 1 / s.truth; },
        [](const CauseSample& s) { return 1 / s.estimated; },
        [](const ValueLine& line, double t) { return 1 / (line.factor / t + line.shift); });
  }

  std::optional<CauseFit> FarClamp() const {
    double limit = 0;
    for (const CauseSample& sample : training_) limit = std::max(limit, sample.estimated);
    return Clamped(limit, [limit](double t) { return std::min(t, limit); });
  }
  std::optional<CauseFit> NearClamp() const {
    double limit = std::numeric_limits<double>::infinity();
    for (const CauseSample& sample : training_) limit = std::min(limit, sample.estimated);
    return Clamped(limit, [limit](double t) { return std::max(t, limit); });
  }
  std::optional<CauseFit> Quantization() const {
    std::vector<std::optional<ValueSteps>> steps;
    std::vector<double> widths, bits;
    for (const ExplainedView& view : views_) {
      steps.push_back(FindValueSteps(view.estimated));
      if (!steps.back()) continue;
      widths.push_back(steps.back()->step);
      bits.push_back(steps.back()->Bits());
    }
    if (widths.empty()) return std::nullopt;
    const auto first = std::find_if(steps.begin(), steps.end(), [](const auto& s) { return !!s; });
    const double error = MeanError([](const CauseSample&) { return std::nullopt; }, training_);
    return CauseFit{DepthFault::kQuantization,
                    {MidpointMedianInPlace(std::span(widths)),
                     MidpointMedianInPlace(std::span(bits)), (*first)->of_inverse ? 1.0 : 0.0},
                    error / kLeastQuantizationError,
                    [steps](const CauseSample& s) -> std::optional<double> {
                      if (!steps[s.view]) return std::nullopt;
                      return LogRatio(s.estimated, steps[s.view]->Nearest(s.truth));
                    }};
  }

  std::optional<CauseFit> Smoothing() const {
    const auto smoothed = [this](double sigma_px) {
      std::vector<DepthMap> maps;
      for (const ExplainedView& view : views_) maps.push_back(SmoothDepth(view.truth, sigma_px));
      return maps;
    };
    const auto model = [](std::vector<DepthMap> maps) -> Residual {
      return [maps = std::move(maps)](const CauseSample& s) {
        return LogRatio(s.estimated,
                        static_cast<double>(maps[s.view].At(static_cast<int>(s.pixel.x()),
                                                            static_cast<int>(s.pixel.y()))));
      };
    };
    std::vector<Parameters> starts;  // log2 of the width
    for (double log_sigma = -1; log_sigma <= 3; log_sigma += 0.5) starts.push_back({log_sigma});
    const Parameters found = FindLeast(starts, 0.25, 0.06, [&](const Parameters& parameters) {
      return MeanError(model(smoothed(std::exp2(parameters[0]))), training_);
    });
    const double sigma_px = std::exp2(found[0]);
    return CauseFit{DepthFault::kSmoothing,
                    {sigma_px * views_.front().image_px},
                    sigma_px / kLeastSmoothingPx,
                    model(smoothed(sigma_px))};
  }

 private:
  // Values of the training samples of a view.
  template <typename Function>
  std::vector<double> Collect(std::optional<size_t> view, Function value) const {
    std::vector<double> values;
    for (const CauseSample& sample : training_) {
      if (!view || sample.view == *view) values.push_back(value(sample));
    }
    return values;
  }

  // A line from a to b in each view.
  template <typename From, typename To, typename Predict>
  std::optional<CauseFit> Lines(DepthFault cause, From from, To to, Predict predict) const {
    std::vector<ValueLine> lines;
    std::vector<double> scales, shifts;
    for (size_t view = 0; view < views_.size(); ++view) {
      const auto a = Collect(view, from), b = Collect(view, to);
      const auto fit = FitLine(a, b);
      ValueLine& line = lines.emplace_back(fit.value_or(ValueLine{}));
      if (!fit) continue;
      scales.push_back(line.factor);
      shifts.push_back(line.shift);
    }
    if (scales.empty()) return std::nullopt;
    const Residual residual = [lines, predict](const CauseSample& s) {
      return LogRatio(s.estimated, predict(lines[s.view], s.truth));
    };
    const double error = MeanError([](const CauseSample&) { return std::nullopt; }, training_);
    return CauseFit{
        cause,
        {MidpointMedianInPlace(std::span(scales)), MidpointMedianInPlace(std::span(shifts))},
        error / kLeastScale,
        residual};
  }

  template <typename Predict>
  std::optional<CauseFit> Clamped(double limit, Predict predict) const {
    constexpr double kSame = 1e-5;  // what interpolation of equal values leaves
    const size_t held = CountAt(
        Collect(std::nullopt, [](const CauseSample& s) { return s.estimated; }), limit, kSame);
    const double share = static_cast<double>(held) / static_cast<double>(training_.size());
    return CauseFit{
        DepthFault::kClamp,
        {limit, 100 * share},
        share / kLeastClampedShare,
        [predict](const CauseSample& s) { return LogRatio(s.estimated, predict(s.truth)); }};
  }

  std::span<const ExplainedView> views_;
  std::span<const CauseSample> training_;
  double median_depth_;
};

}  // namespace

std::vector<CauseFitter> ValueFitters(std::span<const ExplainedView> views,
                                      std::span<const CauseSample> training) {
  const auto fitter = std::make_shared<const ValueFitter>(views, training);
  return {[fitter] { return fitter->Factor(); },       [fitter] { return fitter->Offset(); },
          [fitter] { return fitter->Affine(); },       [fitter] { return fitter->InverseAffine(); },
          [fitter] { return fitter->FarClamp(); },     [fitter] { return fitter->NearClamp(); },
          [fitter] { return fitter->Quantization(); }, [fitter] { return fitter->Smoothing(); }};
}

}  // namespace raylift
