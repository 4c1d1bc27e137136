#include "raylift/comparison/depth_explanation.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <utility>

#include "base/statistics.h"
#include "value_steps.h"
#include <Eigen/Core>
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"
#include "raylift/evaluation/depth_perturbation.h"

namespace raylift {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using Parameters = std::vector<double>;

constexpr double kDegPerRad = 180 / std::numbers::pi;
// Pixels of one block see the same surface: blocks are what counts as independent.
constexpr int kBlockPx = 16;
constexpr size_t kMinBlocks = 20;
constexpr size_t kMaxSamples = 20000;  // of all views; bounds the time
// Three standard errors: one in 700 by chance.
constexpr double kSure = 3;
constexpr double kMinExplained = 0.5;  // most of it
// Over another cause: a tenth of what is left, lest what neither models decides, and a hundredth of
// what there was, lest rounding does.
constexpr double kMinLeadOfRest = 0.1;
constexpr double kMinLeadOfAll = 0.01;
// Half of the half pixel by which conventions of pixel centers differ.
constexpr double kLeastMovePx = 0.25;
// A map of half the size, interpolated, is smoothed by about this.
constexpr double kLeastSmoothingPx = 0.5;
constexpr double kLeastScale = 0.02;  // of the depth, as of the finding "scale"
// Values in steps of 0.4 % of the depth, as of the finding "quantization", are wrong by a quarter
// of a step on average.
constexpr double kLeastQuantizationError = 0.001;
constexpr double kLeastClampedShare = 0.01;
constexpr double kLeastError = 0.008;  // as of the finding "noise"
constexpr double kStopPx = 1.0 / 64;

struct Sample {
  size_t view = 0;
  Vector2d pixel;
  Vector3d ray;  // z = 1
  double estimated = 0, truth = 0;
  size_t block = 0;  // over all views
};

// Linear in inverse depth on one surface, else the nearest pixel's; 0 where there is none.
double DepthAt(const DepthMap& map, const Vector2d& pixel) {
  if (!(pixel.x() >= 0 && pixel.y() >= 0 && pixel.x() < map.width_px &&
        pixel.y() < map.height_px)) {
    return 0;
  }
  constexpr double kSameSurface = 1.05;
  const auto nearest =
      static_cast<double>(map.At(static_cast<int>(pixel.x()), static_cast<int>(pixel.y())));
  const double u = pixel.x() - 0.5, v = pixel.y() - 0.5;
  const int x = static_cast<int>(std::floor(u)), y = static_cast<int>(std::floor(v));
  if (x < 0 || y < 0 || x + 1 >= map.width_px || y + 1 >= map.height_px) return nearest;
  const std::array<double, 4> z = {
      static_cast<double>(map.At(x, y)), static_cast<double>(map.At(x + 1, y)),
      static_cast<double>(map.At(x, y + 1)), static_cast<double>(map.At(x + 1, y + 1))};
  const auto [least, largest] = std::minmax_element(z.begin(), z.end());
  if (!(*least > 0) || *largest > kSameSurface * *least) return nearest;
  const double fx = u - x, fy = v - y;
  return 1 / ((1 - fy) * ((1 - fx) / z[0] + fx / z[1]) + fy * ((1 - fx) / z[2] + fx / z[3]));
}

// ln(estimated / predicted); none where the cause predicts nothing.
using Residual = std::function<std::optional<double>(const Sample&)>;

std::optional<double> LogRatio(double estimated, double predicted) {
  if (!(estimated > 0) || !(predicted > 0)) return std::nullopt;
  return std::log(estimated / predicted);
}

double IdentityError(const Sample& sample) {
  return std::abs(std::log(sample.estimated / sample.truth));
}

// Where a cause predicts nothing it explains nothing.
double ErrorOf(const Residual& residual, const Sample& sample) {
  const auto r = residual(sample);
  return r ? std::abs(*r) : IdentityError(sample);
}

double MeanError(const Residual& residual, std::span<const Sample> samples) {
  double sum = 0;
  for (const Sample& sample : samples) sum += ErrorOf(residual, sample);
  return sum / static_cast<double>(samples.size());
}

// A mean over samples and its standard error over blocks.
struct Estimate {
  double mean = 0, sigma = 0;
  bool IsSurelyAbove(double least) const { return mean - least > kSure * sigma; }
};
Estimate MeanOverBlocks(std::span<const Sample> samples, std::span<const double> values) {
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

// The least cost near the best of `starts`: along each axis by steps that halve, down to `stop`.
template <typename Cost>
Parameters Search(const std::vector<Parameters>& starts, double step, double stop, Cost cost) {
  Parameters best = starts.front();
  double least = std::numeric_limits<double>::infinity();
  const auto consider = [&](const Parameters& parameters) {
    const double value = cost(parameters);
    if (!(value < least)) return false;
    least = value;
    best = parameters;
    return true;
  };
  for (const Parameters& start : starts) consider(start);
  for (; step >= stop; step /= 2) {
    constexpr int kMaxMoves = 50;
    bool has_moved = true;
    for (int move = 0; has_moved && move < kMaxMoves; ++move) {
      has_moved = false;
      for (size_t axis = 0; axis < best.size(); ++axis) {
        for (const double sign : {-1.0, 1.0}) {
          Parameters moved = best;
          moved[axis] += sign * step;
          has_moved = consider(moved) || has_moved;
        }
      }
    }
  }
  return best;
}

// A cause with its best parameters.
struct Fitted {
  DepthFault cause;
  std::vector<double> size;
  double severity = 0;  // below 1: too little for a word
  Residual residual;
  // Causes of which this is a special case: they need not be worse.
  std::vector<DepthFault> special_case_of = {};
};

class Fitter {
 public:
  Fitter(std::span<const ExplainedView> views, std::span<const Sample> training)
      : views_(views), training_(training) {
    std::vector<double> depths;
    for (const Sample& sample : training) depths.push_back(sample.truth);
    median_depth_ = MidpointMedianInPlace(std::span(depths));
  }

  std::vector<std::function<std::optional<Fitted>()>> All() const {
    return {[this] { return Shift(); },        [this] { return Zoom(); },
            [this] { return Lens(); },         [this] { return Rotation(); },
            [this] { return Displacement(); }, [this] { return TimeOffset(); },
            [this] { return Factor(); },       [this] { return Offset(); },
            [this] { return Affine(); },       [this] { return InverseAffine(); },
            [this] { return FarClamp(); },     [this] { return NearClamp(); },
            [this] { return Quantization(); }, [this] { return Smoothing(); }};
  }

 private:
  const Camera& CameraOf(const Sample& sample) const { return views_[sample.view].camera; }
  double FocalPx() const { return views_.front().camera.MeanFocalPx(); }
  // From the principal point to a corner.
  double HalfDiagonalPx() const {
    const Camera& camera = views_.front().camera;
    return std::hypot(camera.width_px(), camera.height_px()) / 2;
  }

  // Parameters are in pixels that they move a point by, at most.
  template <typename Model>
  std::optional<Fitted> Moved(DepthFault cause, const std::vector<Parameters>& starts,
                              Model model) const {
    const Parameters found = Search(starts, 2, kStopPx, [&](const Parameters& parameters) {
      return MeanError(model(parameters), training_);
    });
    double largest_px = 0;
    for (const double px : found) largest_px = std::max(largest_px, std::abs(px));
    return Fitted{cause, found, largest_px / kLeastMovePx, model(found)};
  }

  static std::vector<Parameters> Grid(size_t dimensions) {
    std::vector<Parameters> grid;
    constexpr std::array<double, 7> kAlong = {0, -4, 4, -8, 8, -16, 16};
    for (const double x : kAlong) {
      for (const double y : kAlong) {
        Parameters parameters(dimensions, 0.0);
        parameters[0] = x;
        if (dimensions > 1) parameters[1] = y;
        if (dimensions > 1 || y == 0) grid.push_back(std::move(parameters));
      }
    }
    return grid;
  }

  Residual PixelMotion(std::function<Vector2d(const Sample&)> motion) const {
    return [this, motion = std::move(motion)](const Sample& sample) {
      return LogRatio(sample.estimated, DepthAt(views_[sample.view].truth, motion(sample)));
    };
  }

  std::optional<Fitted> Shift() const {
    auto fitted = Moved(DepthFault::kShift, Grid(2), [this](const Parameters& px) {
      return PixelMotion([by = Vector2d(px[0], px[1])](const Sample& sample) -> Vector2d {
        return sample.pixel - by;
      });
    });
    for (double& size : fitted->size) size *= views_.front().image_px;
    return fitted;
  }

  std::optional<Fitted> Zoom() const {
    auto fitted = Moved(DepthFault::kZoom, Grid(1), [this](const Parameters& px) {
      const double factor = FocalFactor(px[0]);
      return PixelMotion([this, factor](const Sample& sample) -> Vector2d {
        const Vector2d center = CameraOf(sample).principal_point_px();
        return center + (sample.pixel - center) / factor;
      });
    });
    fitted->size = {FocalFactor(fitted->size[0])};
    return fitted;
  }
  double FocalFactor(double corner_px) const { return 1 + corner_px / HalfDiagonalPx(); }

  std::optional<Fitted> Lens() const {
    const double radius = HalfDiagonalPx() / FocalPx();
    const double k_per_px = 1 / (HalfDiagonalPx() * radius * radius);
    auto fitted = Moved(DepthFault::kLens, Grid(1), [this, k_per_px](const Parameters& px) {
      return PixelMotion([this, k = px[0] * k_per_px](const Sample& sample) -> Vector2d {
        const Camera& camera = CameraOf(sample);
        const Vector2d from_center = sample.pixel - camera.principal_point_px();
        const double squared = from_center.squaredNorm() / std::pow(camera.MeanFocalPx(), 2);
        return camera.principal_point_px() + from_center * (1 + k * squared);
      });
    });
    fitted->size[0] *= k_per_px;
    return fitted;
  }

  // The estimated points, moved to where the image's camera stands, against what it sees there.
  Residual RigidMotion(std::function<std::optional<Rigid3>(size_t)> cam_from_map_camera) const {
    std::vector<std::optional<Rigid3>> motions;
    for (size_t i = 0; i < views_.size(); ++i) motions.push_back(cam_from_map_camera(i));
    return [this, motions = std::move(motions)](const Sample& sample) -> std::optional<double> {
      const auto& motion = motions[sample.view];
      if (!motion) return std::nullopt;
      const Vector3d point = *motion * Vector3d(sample.ray * sample.estimated);
      const auto pixel = CameraOf(sample).ImgFromCam(point);
      if (!pixel) return std::nullopt;
      return LogRatio(point.z(), DepthAt(views_[sample.view].truth, *pixel));
    };
  }

  std::optional<Fitted> Rotation() const {
    // A turn about the axis of the camera moves the corners.
    const Vector3d rad_per_px(1 / FocalPx(), 1 / FocalPx(), 1 / HalfDiagonalPx());
    auto fitted = Moved(DepthFault::kRotation, Grid(3), [&](const Parameters& px) {
      const Eigen::Quaterniond rotation =
          RotationFromVector(Vector3d(px[0], px[1], px[2]).cwiseProduct(rad_per_px));
      return RigidMotion([rotation](size_t) { return Rigid3{rotation, Vector3d::Zero()}; });
    });
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      fitted->size[static_cast<size_t>(axis)] *= kDegPerRad * rad_per_px[axis];
    }
    return fitted;
  }

  std::optional<Fitted> Displacement() const {
    const double units_per_px = median_depth_ / FocalPx();
    auto fitted = Moved(DepthFault::kDisplacement, Grid(3), [&](const Parameters& px) {
      const Vector3d translation = units_per_px * Vector3d(px[0], px[1], px[2]);
      return RigidMotion([translation](size_t) {
        return Rigid3{Eigen::Quaterniond::Identity(), translation};
      });
    });
    for (double& size : fitted->size) size *= units_per_px;
    return fitted;
  }

  std::optional<Fitted> TimeOffset() const {
    std::vector<Parameters> starts;
    for (int k = -2 * kMaxFrames; k <= 2 * kMaxFrames; ++k) starts.push_back({0.5 * k});
    const auto model = [this](const Parameters& frames) {
      return RigidMotion([this, offset = frames[0]](size_t view) { return AtTime(view, offset); });
    };
    const Parameters found = Search(starts, 0.25, 1.0 / 64, [&](const Parameters& parameters) {
      return MeanError(model(parameters), training_);
    });
    // How far it moves what is seen, as the others are judged.
    std::vector<double> moves_px;
    for (size_t view = 0; view < views_.size(); ++view) {
      const auto motion = AtTime(view, found[0]);
      if (!motion) continue;
      const Vector3d ahead(0, 0, median_depth_);
      const Vector3d moved = *motion * ahead;
      if (moved.z() > 0) moves_px.push_back(FocalPx() * (moved.head<2>() / moved.z()).norm());
    }
    if (moves_px.empty()) return std::nullopt;
    const double move_px = MidpointMedianInPlace(std::span(moves_px));
    return Fitted{DepthFault::kTimeOffset, found, move_px / kLeastMovePx, model(found)};
  }

  // cam_from_map_camera where the map's camera stood between two frames.
  std::optional<Rigid3> AtTime(size_t view, double frames) const {
    if (std::abs(frames) > kMaxFrames) return std::nullopt;
    const auto below = std::min(static_cast<int>(std::floor(frames)), kMaxFrames - 1);
    const auto& poses = views_[view].frames_from_cam;
    const auto& a = poses[static_cast<size_t>(below + kMaxFrames)];
    const auto& b = poses[static_cast<size_t>(below + 1 + kMaxFrames)];
    const double t = frames - below;
    if (t == 0) return a ? std::optional(a->Inverse()) : std::nullopt;
    if (!a || !b) return std::nullopt;
    const Vector3d center = (1 - t) * a->OriginInSource() + t * b->OriginInSource();
    const Eigen::Quaterniond rotation = a->rotation.slerp(t, b->rotation);
    return Rigid3{rotation.conjugate(), center};
  }

  // Values of the training samples of a view.
  template <typename Function>
  std::vector<double> Collect(std::optional<size_t> view, Function value) const {
    std::vector<double> values;
    for (const Sample& sample : training_) {
      if (!view || sample.view == *view) values.push_back(value(sample));
    }
    return values;
  }

  std::optional<Fitted> Factor() const {
    std::vector<double> logs(views_.size(), 0.0);
    for (size_t view = 0; view < views_.size(); ++view) {
      auto values = Collect(view, [](const Sample& s) { return std::log(s.estimated / s.truth); });
      if (!values.empty()) logs[view] = MidpointMedianInPlace(std::span(values));
    }
    // Other measures name it.
    return Fitted{DepthFault::kScale,
                  {},
                  1,
                  [logs](const Sample& s) -> std::optional<double> {
                    return std::log(s.estimated / s.truth) - logs[s.view];
                  },
                  {DepthFault::kAffine, DepthFault::kInverseOffset}};
  }

  std::optional<Fitted> Offset() const {
    auto differences = Collect(std::nullopt, [](const Sample& s) { return s.estimated - s.truth; });
    const double offset = MidpointMedianInPlace(std::span(differences));
    return Fitted{DepthFault::kOffset,
                  {offset},
                  std::abs(offset) / median_depth_ / kLeastScale,
                  [offset](const Sample& s) { return LogRatio(s.estimated, s.truth + offset); },
                  {DepthFault::kAffine}};
  }

  // Least squares of a * scale + shift = b in each view.
  template <typename From, typename To, typename Predict>
  std::optional<Fitted> Lines(DepthFault cause, From from, To to, Predict predict) const {
    std::vector<Vector2d> lines;
    std::vector<double> scales, shifts;
    for (size_t view = 0; view < views_.size(); ++view) {
      const auto a = Collect(view, from), b = Collect(view, to);
      const auto n = static_cast<double>(a.size());
      const Eigen::Map<const Eigen::ArrayXd> x(a.data(), static_cast<Eigen::Index>(a.size()));
      const Eigen::Map<const Eigen::ArrayXd> y(b.data(), static_cast<Eigen::Index>(b.size()));
      Vector2d& line = lines.emplace_back(1, 0);
      if (a.empty()) continue;
      const double mean_x = x.sum() / n, mean_y = y.sum() / n;
      const double variance = (x - mean_x).square().sum();
      if (!(variance > 0)) continue;
      line.x() = ((x - mean_x) * (y - mean_y)).sum() / variance;
      line.y() = mean_y - line.x() * mean_x;
      scales.push_back(line.x());
      shifts.push_back(line.y());
    }
    if (scales.empty()) return std::nullopt;
    const Residual residual = [lines, predict](const Sample& s) {
      return LogRatio(s.estimated, predict(lines[s.view], s.truth));
    };
    const double error = MeanError([](const Sample&) { return std::nullopt; }, training_);
    return Fitted{
        cause,
        {MidpointMedianInPlace(std::span(scales)), MidpointMedianInPlace(std::span(shifts))},
        error / kLeastScale,
        residual};
  }

  std::optional<Fitted> Affine() const {
    return Lines(
        DepthFault::kAffine, [](const Sample& s) { return s.truth; },
        [](const Sample& s) { return s.estimated; },
        [](const Vector2d& line, double t) { return line.x() * t + line.y(); });
  }

  std::optional<Fitted> InverseAffine() const {
    return Lines(
        DepthFault::kInverseOffset, [](const Sample& s) { return 1 / s.truth; },
        [](const Sample& s) { return 1 / s.estimated; },
        [](const Vector2d& line, double t) { return 1 / (line.x() / t + line.y()); });
  }

  std::optional<Fitted> FarClamp() const {
    double limit = 0;
    for (const Sample& sample : training_) limit = std::max(limit, sample.estimated);
    return Clamped(limit, [limit](double t) { return std::min(t, limit); });
  }
  std::optional<Fitted> NearClamp() const {
    double limit = std::numeric_limits<double>::infinity();
    for (const Sample& sample : training_) limit = std::min(limit, sample.estimated);
    return Clamped(limit, [limit](double t) { return std::max(t, limit); });
  }
  template <typename Predict>
  std::optional<Fitted> Clamped(double limit, Predict predict) const {
    constexpr double kSame = 1e-5;  // what interpolation of equal values leaves
    const auto held = std::count_if(training_.begin(), training_.end(), [&](const Sample& s) {
      return std::abs(s.estimated - limit) <= kSame * limit;
    });
    const double share = static_cast<double>(held) / static_cast<double>(training_.size());
    return Fitted{DepthFault::kClamp,
                  {limit, 100 * share},
                  share / kLeastClampedShare,
                  [predict](const Sample& s) { return LogRatio(s.estimated, predict(s.truth)); }};
  }

  std::optional<Fitted> Quantization() const {
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
    const double error = MeanError([](const Sample&) { return std::nullopt; }, training_);
    return Fitted{DepthFault::kQuantization,
                  {MidpointMedianInPlace(std::span(widths)), MidpointMedianInPlace(std::span(bits)),
                   (*first)->of_inverse ? 1.0 : 0.0},
                  error / kLeastQuantizationError,
                  [steps](const Sample& s) -> std::optional<double> {
                    if (!steps[s.view]) return std::nullopt;
                    return LogRatio(s.estimated, steps[s.view]->Nearest(s.truth));
                  }};
  }

  std::optional<Fitted> Smoothing() const {
    const auto smoothed = [this](double sigma_px) {
      std::vector<DepthMap> maps;
      for (const ExplainedView& view : views_) maps.push_back(SmoothDepth(view.truth, sigma_px));
      return maps;
    };
    const auto model = [](std::vector<DepthMap> maps) -> Residual {
      return [maps = std::move(maps)](const Sample& s) {
        return LogRatio(s.estimated,
                        static_cast<double>(maps[s.view].At(static_cast<int>(s.pixel.x()),
                                                            static_cast<int>(s.pixel.y()))));
      };
    };
    std::vector<Parameters> starts;  // log2 of the width
    for (double log_sigma = -1; log_sigma <= 3; log_sigma += 0.5) starts.push_back({log_sigma});
    const Parameters found = Search(starts, 0.25, 0.06, [&](const Parameters& parameters) {
      return MeanError(model(smoothed(std::exp2(parameters[0]))), training_);
    });
    const double sigma_px = std::exp2(found[0]);
    return Fitted{DepthFault::kSmoothing,
                  {sigma_px * views_.front().image_px},
                  sigma_px / kLeastSmoothingPx,
                  model(smoothed(sigma_px))};
  }

  std::span<const ExplainedView> views_;
  std::span<const Sample> training_;
  double median_depth_ = 1;
};

struct Halves {
  std::vector<Sample> training, judging;
  size_t judging_blocks = 0;
};

// Blocks of pixels like the fields of a chessboard.
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
        std::vector<Sample>& half = is_judging ? halves.judging : halves.training;
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

std::string Describe(const Fitted& fitted) {
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
    default:
      return {};
  }
}

bool Contains(std::span<const DepthFault> faults, DepthFault fault) {
  return std::find(faults.begin(), faults.end(), fault) != faults.end();
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
  const std::span<const Sample> judging = halves.judging;
  std::vector<double> errors;
  for (const Sample& sample : judging) errors.push_back(IdentityError(sample));
  const Estimate error = MeanOverBlocks(judging, errors);
  DepthExplanation result;
  result.error = error.mean;
  // The mean of |x| of a normal distribution.
  result.noise = noise_sigma * std::sqrt(2 / std::numbers::pi);
  result.is_beyond_noise = error.IsSurelyAbove(result.noise);
  const double beyond = std::max(0.0, result.error - result.noise);

  const Fitter fitter(views, halves.training);
  const auto tries = fitter.All();
  std::vector<std::optional<Fitted>> causes(tries.size());
  std::vector<std::vector<double>> gains(tries.size());  // of each sample
  std::vector<std::vector<bool>> predicted(tries.size());
  ParallelFor(tries.size(), threads, [&](size_t i) {
    causes[i] = tries[i]();
    if (!causes[i]) return;
    for (size_t k = 0; k < judging.size(); ++k) {
      const auto rest = causes[i]->residual(judging[k]);
      predicted[i].push_back(rest.has_value());
      gains[i].push_back(rest ? errors[k] - std::abs(*rest) : 0);
    }
  });

  const auto lead = [&](size_t a, size_t b) {
    std::vector<double> differences(judging.size());
    for (size_t k = 0; k < judging.size(); ++k) {
      // A map that lies off shows at its border what the truth does not have.
      if (predicted[a][k] && predicted[b][k]) differences[k] = gains[a][k] - gains[b][k];
    }
    return MeanOverBlocks(judging, differences);
  };
  const auto beats = [&](size_t a, size_t b) {
    const Estimate estimate = lead(a, b);
    const double rest = error.mean - MeanOverBlocks(judging, gains[a]).mean;
    return estimate.IsSurelyAbove(0) && estimate.mean > kMinLeadOfRest * rest &&
           estimate.mean > kMinLeadOfAll * beyond;
  };
  std::vector<size_t> good;
  for (size_t i = 0; i < causes.size(); ++i) {
    if (!causes[i] || causes[i]->severity < 1) continue;
    const Estimate gain = MeanOverBlocks(judging, gains[i]);
    if (gain.IsSurelyAbove(0) && gain.IsSurelyAbove(kMinExplained * beyond)) good.push_back(i);
  }
  for (const size_t i : good) {
    bool is_beaten = false, has_peer = false;
    for (size_t other = 0; other < causes.size(); ++other) {
      if (other == i || !causes[other]) continue;
      // A general form that is no better than a special one says no more.
      const bool is_no_better =
          Contains(causes[other]->special_case_of, causes[i]->cause) && !beats(i, other);
      is_beaten = is_beaten || is_no_better || beats(other, i);
      const bool is_excused = Contains(causes[i]->special_case_of, causes[other]->cause);
      has_peer = has_peer || (!is_excused && !beats(i, other));
    }
    if (is_beaten) continue;
    if (has_peer) {
      if (!Contains(result.alike, causes[i]->cause)) result.alike.push_back(causes[i]->cause);
      continue;
    }
    result.cause = causes[i]->cause;
    result.size = causes[i]->size;
    result.severity = causes[i]->severity;
    const double gain = MeanOverBlocks(judging, gains[i]).mean;
    result.explained_percent = beyond > 0 ? 100 * std::min(1.0, gain / beyond) : 100;
    result.text = Describe(*causes[i]);
  }
  if (result.cause) result.alike.clear();
  return result;
}

void AddExplanation(const DepthExplanation& explanation, std::vector<Finding>& findings) {
  using enum DepthFault;
  constexpr std::array kTraces = {kScale,         kPerImageScale,       kWarp,  kNoise,
                                  kAdditiveNoise, kMultiplicativeNoise, kEdges, kFloaters,
                                  kBubbles,       kQuantization};
  if (explanation.cause && *explanation.cause != kScale) {
    std::erase_if(findings,
                  [&](const Finding& finding) { return Contains(kTraces, finding.fault); });
    findings.insert(findings.begin(), {*explanation.cause, explanation.size.front(),
                                       explanation.severity, explanation.text});
    return;
  }
  if (!explanation.alike.empty()) {
    std::vector<std::string_view> names;
    for (const DepthFault fault : explanation.alike) names.push_back(ToString(fault));
    findings.push_back({kUnexplained, 0, 1,
                        fmt::format("not explained: {} would do alike", fmt::join(names, " or "))});
  } else if (findings.empty() && explanation.is_beyond_noise && explanation.error >= kLeastError) {
    findings.push_back({kUnexplained, explanation.error, explanation.error / kLeastError,
                        fmt::format("not explained: errors of {:.1f} % that no one cause makes",
                                    100 * explanation.error)});
  }
}

}  // namespace raylift
