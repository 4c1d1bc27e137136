#include "diagnosis/depth_explanation.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <utility>

#include "base/statistics.h"
#include "diagnosis/cause_fits.h"
#include "lifting/source_view.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"
#include "raylift/lifting/mesh_source.h"

namespace raylift {
namespace {

using Eigen::Vector2d;

// Pixels of one block see the same surface; blocks count as independent.
constexpr int kBlockPx = 16;
constexpr size_t kMinBlocks = 20;
constexpr size_t kMaxSamples = 20000;  // of all views; bounds the time
// Three standard errors are exceeded by chance once in 700 times.
constexpr double kSure = 3;
constexpr double kMinExplained = 0.5;  // most of it
// A cause must lead over every other one by a tenth of what is left, so that nothing hangs on what
// neither models.
constexpr double kMinLeadOfRest = 0.1;
constexpr double kLeastFlyingPercent = 8;
constexpr double kLeastError = 0.008;  // as of the finding "noise"
// Equal maps differ by no more as floats.
constexpr double kRoundingOfFloats = 1e-6;

// A mean over samples and its standard error over blocks.
struct Estimate {
  double mean = 0, sigma = 0;
  bool IsSurelyAbove(double least) const { return mean - least > kSure * sigma; }
};
Estimate MeanOverBlocks(std::span<const CauseSample> samples, std::span<const double> values) {
  const auto n = static_cast<double>(samples.size());
  Estimate estimate;
  for (const double value : values) estimate.mean += value / n;
  double square = 0, sum = 0;
  for (size_t i = 0; i < samples.size(); ++i) {
    sum += values[i] - estimate.mean;
    if (i + 1 < samples.size() && samples[i + 1].block == samples[i].block) continue;
    square += sum * sum;
    sum = 0;
  }
  estimate.sigma = std::sqrt(square) / n;
  return estimate;
}

struct Halves {
  std::vector<CauseSample> training, judging;
  size_t judging_blocks = 0;
};

// Splits the blocks of pixels into two halves, like the fields of a chessboard.
Halves Split(std::span<const ExplainedView> views) {
  size_t pixels = 0;
  for (const ExplainedView& view : views) pixels += view.truth.z.size();
  const auto stride = static_cast<int>(1 + pixels / kMaxSamples);
  Halves halves;
  size_t block = 0;
  for (size_t v = 0; v < views.size(); ++v) {
    const ExplainedView& view = views[v];
    const int width = view.truth.width_px, height = view.truth.height_px;
    for (int top = 0; top < height; top += kBlockPx) {
      for (int left = 0; left < width; left += kBlockPx, ++block) {
        const bool is_judging = (top + left) / kBlockPx % 2 == 1;
        std::vector<CauseSample>& half = is_judging ? halves.judging : halves.training;
        const size_t before = half.size();
        for (int y = top; y < std::min(height, top + kBlockPx); ++y) {
          for (int x = left; x < std::min(width, left + kBlockPx); ++x) {
            // A step that shares no factor with the block's side visits all of its columns.
            if ((y * 7 + x) % stride != 0) continue;
            const float estimated = view.estimated.At(x, y), truth = view.truth.At(x, y);
            if (!(estimated > 0) || !(truth > 0)) continue;
            const Vector2d pixel(x + 0.5, y + 0.5);
            const auto ray = view.camera.RayInCam(pixel);
            if (!ray || !(ray->z() > 0)) continue;
            half.push_back({v, pixel, *ray / ray->z(), static_cast<double>(estimated),
                            static_cast<double>(truth), block});
          }
        }
        halves.judging_blocks += is_judging && half.size() > before;
      }
    }
  }
  return halves;
}

std::string Describe(const CauseFit& fitted) {
  const std::vector<double>& size = fitted.size;
  using enum DepthFault;
  switch (fitted.cause) {
    case kShift:
      return fmt::format("shift: maps lie {:.1f}, {:.1f} px off", size[0], size[1]);
    case kZoom:
      return fmt::format("zoom: the focal length is {:.1f} % too {}", 100 * std::abs(size[0] - 1),
                         size[0] > 1 ? "long" : "short");
    case kLens:
      return fmt::format("lens: a radial distortion of {:.3f} is left or missing", size[0]);
    case kRotation:
      return fmt::format("rotation: maps are turned by {:.2f}, {:.2f}, {:.2f} deg about x, y, z",
                         size[0], size[1], size[2]);
    case kDisplacement:
      return fmt::format("displacement: maps are seen from {:.3g}, {:.3g}, {:.3g} units off",
                         size[0], size[1], size[2]);
    case kTimeOffset:
      return fmt::format("time offset: maps are {:.1f} frames {}", std::abs(size[0]),
                         size[0] > 0 ? "ahead" : "behind");
    case kOffset:
      return fmt::format("offset: depth is {:.3g} units too {}", std::abs(size[0]),
                         size[0] > 0 ? "large" : "small");
    case kAffine:
      return fmt::format("affine: depth is {:.3f} times the true one {:+.3g} units", size[0],
                         size[1]);
    case kInverseOffset:
      return fmt::format("inverse offset: 1 / depth is {:.3f} times the true one {:+.3g}", size[0],
                         size[1]);
    case kClamp:
      return fmt::format("clamp: {:.1f} % of the depths are {:.3g} instead of their own", size[1],
                         size[0]);
    case kQuantization:
      return fmt::format("quantization: {}depth in steps of {:.3g}, {:.1f} bits",
                         size[2] > 0 ? "1 / " : "", size[0], size[1]);
    case kSmoothing:
      return fmt::format("smoothing: by {:.1f} px", size[0]);
    case kFlipped:
      return fmt::format("flipped: maps are {}", size[0] == 0   ? "upside down"
                                                 : size[1] == 0 ? "mirrored, left for right"
                                                                : "turned by 180 degrees");
    case kRayLength:
      return size[0] > 0 ? "ray length: lengths of rays are read as depth z (kind=ray)"
                         : "ray length: depth z is read as lengths of rays (kind=z)";
    case kDisparity:
      return fmt::format(
          "disparity: depth is {:.4g} / the true one{}: inverse depth is read as depth, or the "
          "reverse (kind=)",
          size[0], std::abs(size[1]) < 1e-4 * size[0] ? "" : fmt::format(" {:+.3g}", size[1]));
    case kPowerLaw:
      return fmt::format("power law: depth is {:.3g} times the true one to the power of {:.3f}",
                         size[1], size[0]);
    case kCurve:
      return fmt::format(
          "depth curve: errors go by the depth alone: {:+.1f} % at {:.3g}, {:+.1f} % "
          "at {:.3g}, {:+.1f} % at {:.3g} units",
          100 * size[1], size[0], 100 * size[3], size[2], 100 * size[5], size[4]);
    case kMedian:
      return fmt::format("median: maps look like after a median of {:.0f} x {:.0f} px", size[0],
                         size[0]);
    case kFattening:
      return fmt::format("fattened foreground: what is in front reaches {:.0f} px too {}",
                         std::abs(size[0]), size[0] > 0 ? "far" : "short");
    default:
      return {};
  }
}

// Returns the image and pixel in the middle of the block with the largest mean error.
std::string WorstPlace(std::span<const ExplainedView> views, std::span<const CauseSample> samples) {
  double worst = -1;
  std::string place;
  for (size_t begin = 0; begin < samples.size();) {
    size_t end = begin;
    double sum = 0;
    while (end < samples.size() && samples[end].block == samples[begin].block) {
      sum += IdentityError(samples[end++]);
    }
    const double mean = sum / static_cast<double>(end - begin);
    if (mean > worst) {
      worst = mean;
      const ExplainedView& view = views[samples[begin].view];
      const Vector2d px = samples[(begin + end) / 2].pixel * view.image_px;
      place = fmt::format("{} at {:.0f}, {:.0f}", view.name, px.x(), px.y());
    }
    begin = end;
  }
  return place;
}

bool Contains(std::span<const DepthFault> faults, DepthFault fault) {
  return std::find(faults.begin(), faults.end(), fault) != faults.end();
}

// Causes fitted to the training half of the samples, and what each explains of the errors of the
// judging half.
class TriedCauses {
 public:
  TriedCauses(const std::vector<CauseFitter>& fitters, std::span<const CauseSample> judging,
              std::span<const double> errors, int threads)
      : judging_(judging),
        mean_error_(MeanOverBlocks(judging, errors).mean),
        causes_(fitters.size()),
        gains_(fitters.size()),
        predicted_(fitters.size()) {
    ParallelFor(fitters.size(), threads, [&](size_t i) {
      causes_[i] = fitters[i]();
      if (!causes_[i]) return;
      for (size_t k = 0; k < judging.size(); ++k) {
        const auto rest = causes_[i]->residual(judging[k]);
        predicted_[i].push_back(rest.has_value());
        gains_[i].push_back(rest ? errors[k] - std::abs(*rest) : 0);
      }
    });
  }

  size_t size() const { return causes_.size(); }
  const std::optional<CauseFit>& fit(size_t i) const { return causes_[i]; }
  // Returns the mean error that a cause explains.
  Estimate Gain(size_t i) const { return MeanOverBlocks(judging_, gains_[i]); }

  // Returns whether a cause of visible size explains more than this.
  bool Explains(size_t i, double error) const {
    if (!causes_[i] || causes_[i]->severity < 1) return false;
    const Estimate gain = Gain(i);
    return gain.IsSurelyAbove(0) && gain.IsSurelyAbove(error);
  }

  // Whether another cause explains the errors better, or one does as well.
  enum class Standing { kBeaten, kOneOfSeveral, kBest };
  Standing StandingOf(size_t i) const {
    auto standing = Standing::kBest;
    for (size_t other = 0; other < size(); ++other) {
      if (other == i || !causes_[other]) continue;
      // A general form that is no better than a special one says no more.
      const bool is_no_better =
          Contains(causes_[other]->special_case_of, causes_[i]->cause) && !Beats(i, other);
      if (is_no_better || Beats(other, i)) return Standing::kBeaten;
      const bool is_excused = Contains(causes_[i]->special_case_of, causes_[other]->cause);
      if (!is_excused && !Beats(i, other)) standing = Standing::kOneOfSeveral;
    }
    return standing;
  }

 private:
  bool Beats(size_t a, size_t b) const {
    std::vector<double> differences(judging_.size());
    for (size_t k = 0; k < judging_.size(); ++k) {
      // A map that lies off shows at its border what the truth does not have.
      if (predicted_[a][k] && predicted_[b][k]) differences[k] = gains_[a][k] - gains_[b][k];
    }
    const Estimate lead = MeanOverBlocks(judging_, differences);
    const double rest = mean_error_ - Gain(a).mean;
    return lead.IsSurelyAbove(0) && lead.mean > std::max(kMinLeadOfRest * rest, kRoundingOfFloats);
  }

  std::span<const CauseSample> judging_;
  double mean_error_;
  std::vector<std::optional<CauseFit>> causes_;
  std::vector<std::vector<double>> gains_;  // of each cause and sample
  std::vector<std::vector<bool>> predicted_;
};

std::vector<CauseFitter> AllFitters(std::span<const ExplainedView> views,
                                    std::span<const CauseSample> training) {
  std::vector<CauseFitter> fitters = MotionFitters(views, training);
  for (auto& fitter : ValueFitters(views, training)) fitters.push_back(std::move(fitter));
  for (auto& fitter : FilterFitters(views, training)) fitters.push_back(std::move(fitter));
  return fitters;
}

// Names the cause that explains the errors best, or those that do alike. `beyond` is the mean error
// beyond noise.
void NameCause(const TriedCauses& tried, double beyond, DepthExplanation& result) {
  std::string alike;
  for (size_t i = 0; i < tried.size(); ++i) {
    if (!tried.Explains(i, kMinExplained * beyond)) continue;
    const CauseFit& fit = *tried.fit(i);
    switch (tried.StandingOf(i)) {
      case TriedCauses::Standing::kBeaten:
        break;
      case TriedCauses::Standing::kOneOfSeveral: {
        if (Contains(result.alike, fit.cause)) break;
        result.alike.push_back(fit.cause);
        const std::string words = Describe(fit);
        alike += (alike.empty() ? "" : " or ") +
                 (words.empty() ? std::string(ToString(fit.cause)) : words);
        break;
      }
      case TriedCauses::Standing::kBest:
        result.cause = fit.cause;
        result.size = fit.size;
        result.severity = fit.severity;
        result.explained_percent =
            beyond > 0 ? 100 * std::min(1.0, tried.Gain(i).mean / beyond) : 100;
        result.text = Describe(fit);
        break;
    }
  }
  if (result.cause) result.alike.clear();
  if (!result.alike.empty()) result.text = alike + " would do alike";
}

}  // namespace

std::optional<DepthExplanation> ExplainDepthErrors(std::span<const ExplainedView> views,
                                                   double noise_sigma, int threads) {
  for (const ExplainedView& view : views) {
    if (view.camera.is_panorama()) return std::nullopt;
    RAYLIFT_CHECK_EQ(view.estimated.z.size(), view.truth.z.size());
  }
  const Halves halves = Split(views);
  if (halves.training.empty() || halves.judging_blocks < kMinBlocks) return std::nullopt;
  const std::span<const CauseSample> judging = halves.judging;
  std::vector<double> errors;
  for (const CauseSample& sample : judging) errors.push_back(IdentityError(sample));
  const Estimate error = MeanOverBlocks(judging, errors);
  DepthExplanation result;
  result.error = error.mean;
  // The mean of |x| of a normal distribution.
  result.noise = noise_sigma * std::sqrt(2 / std::numbers::pi);
  result.is_beyond_noise = error.IsSurelyAbove(result.noise);
  if (result.error < kRoundingOfFloats) return result;
  result.flying_percent = FlyingPercent(views, judging);
  result.worst_place = WorstPlace(views, judging);
  const std::vector<CauseFitter> fitters = AllFitters(views, halves.training);
  NameCause(TriedCauses(fitters, judging, errors, threads),
            std::max(0.0, result.error - result.noise), result);
  return result;
}

void AddExplanation(const DepthExplanation& explanation, std::vector<Finding>& findings) {
  using enum DepthFault;
  constexpr std::array kTraces = {kScale,         kPerImageScale,       kWarp,  kNoise,
                                  kAdditiveNoise, kMultiplicativeNoise, kEdges, kFloaters,
                                  kBubbles,       kQuantization};
  const bool is_told = explanation.cause && *explanation.cause != kScale;
  // The size of a scale is told by its own finding.
  const bool may_be_scale = Contains(explanation.alike, kScale);
  if (is_told || !explanation.alike.empty()) {
    std::erase_if(findings, [&](const Finding& finding) {
      const bool is_scale = finding.fault == kScale || finding.fault == kPerImageScale;
      return Contains(kTraces, finding.fault) && !(may_be_scale && is_scale);
    });
  }
  if (is_told) {
    findings.insert(findings.begin(), {*explanation.cause, explanation.size.front(),
                                       explanation.severity, explanation.text});
    return;
  }
  if (explanation.flying_percent >= kLeastFlyingPercent) {
    const double severity = explanation.flying_percent / kLeastFlyingPercent;
    const auto less = std::find_if(findings.begin(), findings.end(),
                                   [&](const Finding& f) { return f.severity < severity; });
    findings.insert(less, {kFlying, explanation.flying_percent, severity,
                           fmt::format("flying pixels: {:.0f} % of the pixels at depth edges lie "
                                       "between the two surfaces",
                                       explanation.flying_percent)});
  }
  if (!explanation.alike.empty()) {
    findings.insert(findings.begin(), {kUnexplained, 0, 1, "not explained: " + explanation.text});
  } else if (findings.empty() && explanation.is_beyond_noise && explanation.error >= kLeastError) {
    findings.push_back({kUnexplained, explanation.error, explanation.error / kLeastError,
                        fmt::format("not explained: errors of {:.1f} % that no one cause makes, "
                                    "the largest in {}",
                                    100 * explanation.error, explanation.worst_place)});
  }
}

namespace {

// A misalignment is the same for all images: a few tell it as well as all.
constexpr size_t kMaxViews = 8;
// This is larger than for other comparisons: steps of values show at a map's own pixels alone, not
// between.
constexpr int kMaxSidePx = 1024;

}  // namespace

std::vector<ExplainedView> ViewsToExplain(const GeometrySource& source, const GeometrySource& truth,
                                          std::span<const PosedImage> images, int threads) {
  std::vector<size_t> by_name(images.size());
  std::iota(by_name.begin(), by_name.end(), size_t{0});
  std::stable_sort(by_name.begin(), by_name.end(),
                   [&](size_t a, size_t b) { return images[a].name < images[b].name; });
  const size_t count = std::min(kMaxViews, images.size());
  std::vector<ExplainedView> views(count);
  const bool is_seen_from_anywhere = dynamic_cast<const MeshSource*>(&truth) != nullptr;
  ParallelFor(count, threads, [&](size_t k) {
    // The middles of equal parts.
    const size_t place = (2 * k + 1) * images.size() / (2 * count);
    const PosedImage& original = images[by_name[place]];
    const PosedImage image = ShrunkTo(original, kMaxSidePx);
    ExplainedView& view = views[k];
    view.name = image.name;
    view.camera = image.camera;
    view.image_px = static_cast<double>(original.camera.width_px()) / image.camera.width_px();
    view.estimated = LookThrough(source, image).depth;
    view.truth = LookThrough(truth, image).depth;
    if (is_seen_from_anywhere) {
      view.truth_from = [&truth, image](const Rigid3& cam_from_map_camera, const Vector2d& pixel) {
        const PosedImage moved = {image.name, image.camera,
                                  cam_from_map_camera.Inverse() * image.cam_from_world};
        const auto point = truth.Lift(moved, std::span(&pixel, 1)).front();
        return point ? point->depth_z : 0;
      };
    }
    for (int offset = -kMaxFrames; offset <= kMaxFrames; ++offset) {
      const auto other = static_cast<std::ptrdiff_t>(place) + offset;
      if (other < 0 || other >= static_cast<std::ptrdiff_t>(images.size())) continue;
      const PosedImage& frame = images[by_name[static_cast<size_t>(other)]];
      const int frame_place = offset + kMaxFrames;
      view.frames_from_cam[static_cast<size_t>(frame_place)] =
          frame.cam_from_world * image.cam_from_world.Inverse();
    }
  });
  return views;
}

}  // namespace raylift
