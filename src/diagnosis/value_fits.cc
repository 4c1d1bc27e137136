// Causes that change the values of depth: factor, offset, lines, other functions, clamps, steps.

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <utility>

#include "base/statistics.h"
#include "diagnosis/cause_fits.h"
#include "diagnosis/value_models.h"

namespace raylift {
namespace {

constexpr double kLeastScale = 0.02;  // of the depth, as of the finding "scale"
// Values in steps of 0.4 % of the depth, as of the finding "quantization", are wrong by a quarter
// of a step on average.
constexpr double kLeastQuantizationError = 0.001;
constexpr double kLeastClampedShare = 0.01;

// This is the general form of all functions of the depth, as it is a curve through any points.
constexpr DepthFault kGeneral = DepthFault::kCurve;

// Returns the value at `x` of the line through points whose `at` rises; as at the nearest end
// outside.
double Interpolated(std::span<const double> at, std::span<const double> values, double x) {
  const auto above = std::upper_bound(at.begin(), at.end(), x);
  if (above == at.begin()) return values.front();
  if (above == at.end()) return values.back();
  const auto i = static_cast<size_t>(above - at.begin());
  const double t = (x - at[i - 1]) / (at[i] - at[i - 1]);
  return (1 - t) * values[i - 1] + t * values[i];
}

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
    return CauseFit{
        DepthFault::kScale,
        {},
        1,
        [logs](const CauseSample& s) -> std::optional<double> {
          return std::log(s.estimated / s.truth) - logs[s.view];
        },
        {DepthFault::kAffine, DepthFault::kInverseOffset, DepthFault::kPowerLaw, kGeneral}};
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
        {DepthFault::kAffine, kGeneral}};
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
    return CauseFit{DepthFault::kQuantization,
                    {MidpointMedianInPlace(std::span(widths)),
                     MidpointMedianInPlace(std::span(bits)), (*first)->of_inverse ? 1.0 : 0.0},
                    ErrorAsItIs(training_) / kLeastQuantizationError,
                    [steps](const CauseSample& s) -> std::optional<double> {
                      if (!steps[s.view]) return std::nullopt;
                      return LogRatio(s.estimated, steps[s.view]->Nearest(s.truth));
                    }};
  }

  // Returns the fit of values that are a / depth + b, or of depth that is taken for such values.
  std::optional<CauseFit> Disparity() const {
    auto fit = Lines(
        DepthFault::kDisparity, [](const CauseSample& s) { return 1 / s.truth; },
        [](const CauseSample& s) { return s.estimated; },
        [](const ValueLine& line, double t) { return line(1 / t); });
    if (fit) fit->special_case_of.push_back(DepthFault::kPowerLaw);
    return fit;
  }

  std::optional<CauseFit> PowerLaw() const {
    auto fit = Lines(
        DepthFault::kPowerLaw, [](const CauseSample& s) { return std::log(s.truth); },
        [](const CauseSample& s) { return std::log(s.estimated); },
        [](const ValueLine& line, double t) { return std::exp(line(std::log(t))); });
    if (fit) fit->size[1] = std::exp(fit->size[1]);
    return fit;
  }

  // Returns the fit of lengths of rays read as z (power 1), or of z read as lengths (-1).
  std::optional<CauseFit> RayLength(double power) const {
    return CauseFit{DepthFault::kRayLength,
                    {power},
                    ErrorAsItIs(training_) / kLeastScale,
                    [power](const CauseSample& s) {
                      return LogRatio(s.estimated, s.truth * std::pow(s.ray.norm(), power));
                    }};
  }

  // Returns the fit of any function of the depth, where ln(estimated / true) is linear in ln(true)
  // between the medians of parts of the samples.
  std::optional<CauseFit> Curve() const {
    constexpr size_t kParts = 48;
    std::vector<std::pair<double, double>> samples;
    for (const CauseSample& s : training_) {
      samples.emplace_back(std::log(s.truth), std::log(s.estimated / s.truth));
    }
    std::sort(samples.begin(), samples.end());
    std::vector<double> at, ratios;
    for (size_t part = 0; part < kParts; ++part) {
      std::vector<double> x, y;
      for (size_t i = part * samples.size() / kParts; i < (part + 1) * samples.size() / kParts;
           ++i) {
        x.push_back(samples[i].first);
        y.push_back(samples[i].second);
      }
      if (x.empty()) return std::nullopt;
      at.push_back(MidpointMedianInPlace(std::span(x)));
      ratios.push_back(MidpointMedianInPlace(std::span(y)));
    }
    std::vector<double> size;
    for (const size_t part : {size_t{0}, kParts / 2, kParts - 1}) {
      size.push_back(std::exp(at[part]));
      size.push_back(std::expm1(ratios[part]));
    }
    return CauseFit{DepthFault::kCurve, std::move(size), ErrorAsItIs(training_) / kLeastScale,
                    [at, ratios](const CauseSample& s) -> std::optional<double> {
                      return std::log(s.estimated / s.truth) -
                             Interpolated(at, ratios, std::log(s.truth));
                    }};
  }

 private:
  // Returns the values of the training samples of a view, or of all views for nullopt.
  template <typename Function>
  std::vector<double> Collect(std::optional<size_t> view, Function value) const {
    std::vector<double> values;
    for (const CauseSample& sample : training_) {
      if (!view || sample.view == *view) values.push_back(value(sample));
    }
    return values;
  }

  // Returns the fit of a line from a to b in each view.
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
    return CauseFit{
        cause,
        {MidpointMedianInPlace(std::span(scales)), MidpointMedianInPlace(std::span(shifts))},
        ErrorAsItIs(training_) / kLeastScale,
        residual,
        {kGeneral}};
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
        [predict](const CauseSample& s) { return LogRatio(s.estimated, predict(s.truth)); },
        {kGeneral}};
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
          [fitter] { return fitter->Quantization(); }, [fitter] { return fitter->Disparity(); },
          [fitter] { return fitter->PowerLaw(); },     [fitter] { return fitter->RayLength(1); },
          [fitter] { return fitter->RayLength(-1); },  [fitter] { return fitter->Curve(); }};
}

}  // namespace raylift
