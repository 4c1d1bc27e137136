// Causes that move what a map shows: pixels (shift, zoom, lens, flipped maps) or the camera
// (rotation, displacement, time offset).

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <utility>

#include "base/constants.h"
#include "base/statistics.h"
#include "diagnosis/cause_fits.h"
#include "diagnosis/depth_explanation.h"
#include "lifting/depth_sampling.h"

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/geometry/rigid3.h"

namespace raylift {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

// This is half of the half pixel by which conventions of pixel centers differ.
constexpr double kLeastMovePx = 0.25;
constexpr double kStopPx = 1.0 / 64;
// In the last steps the truth is rendered again, at some of the samples, if that may explain most.
constexpr double kPolishPx = 0.25;
constexpr size_t kPolishEvery = 4;
constexpr double kMostLeftToPolish = 0.75;

// Returns the depth, linear in inverse depth on one surface, else the nearest pixel's; 0 where
// there is none.
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

// Predictions of a motion: by the pixels of the true map, which is fast but does not know the depth
// between them or behind an edge, and by the truth rendered again (ExplainedView::truth_from).
struct MotionModel {
  Residual by_map, by_truth;
};

std::vector<Parameters> Grid(size_t dimensions) {
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

// Returns cam_from_map_camera where the map's camera stood between two frames.
std::optional<Rigid3> AtTime(const ExplainedView& view, double frames) {
  if (std::abs(frames) > kMaxFrames) return std::nullopt;
  const auto below = std::min(static_cast<int>(std::floor(frames)), kMaxFrames - 1);
  const auto& poses = view.frames_from_cam;
  const int place = below + kMaxFrames;
  const auto& a = poses[static_cast<size_t>(place)];
  const auto& b = poses[static_cast<size_t>(place) + 1];
  const double t = frames - below;
  if (t == 0) return a ? std::optional(a->Inverse()) : std::nullopt;
  if (!a || !b) return std::nullopt;
  const Vector3d center = (1 - t) * a->OriginInSource() + t * b->OriginInSource();
  const Eigen::Quaterniond rotation = a->rotation.slerp(t, b->rotation);
  return Rigid3{rotation.conjugate(), center};
}

class MotionFitter {
 public:
  MotionFitter(std::span<const ExplainedView> views, std::span<const CauseSample> training)
      : views_(views),
        training_(training),
        median_depth_(MedianTrueDepth(training)),
        is_seen_from_anywhere_(views.front().truth_from != nullptr) {
    for (size_t i = 0; i < training.size(); i += kPolishEvery) polishing_.push_back(training[i]);
  }

  std::optional<CauseFit> Shift() const {
    auto fitted = Moved(DepthFault::kShift, Grid(2), [this](const Parameters& px) {
      return PixelMotion([by = Vector2d(px[0], px[1])](const CauseSample& sample) -> Vector2d {
        return sample.pixel - by;
      });
    });
    for (double& size : fitted->size) size *= views_.front().image_px;
    return fitted;
  }

  std::optional<CauseFit> Flipped(bool in_x, bool in_y) const {
    return CauseFit{DepthFault::kFlipped,
                    {in_x ? 1.0 : 0.0, in_y ? 1.0 : 0.0},
                    2,
                    PixelMotion([this, in_x, in_y](const CauseSample& sample) -> Vector2d {
                      const DepthMap& map = views_[sample.view].truth;
                      return {in_x ? map.width_px - sample.pixel.x() : sample.pixel.x(),
                              in_y ? map.height_px - sample.pixel.y() : sample.pixel.y()};
                    }).by_map};
  }

  std::optional<CauseFit> Zoom() const {
    auto fitted = Moved(DepthFault::kZoom, Grid(1), [this](const Parameters& px) {
      const double factor = FocalFactor(px[0]);
      return PixelMotion([this, factor](const CauseSample& sample) -> Vector2d {
        const Vector2d center = CameraOf(sample).principal_point_px();
        return center + (sample.pixel - center) / factor;
      });
    });
    fitted->size = {FocalFactor(fitted->size[0])};
    return fitted;
  }

  std::optional<CauseFit> Lens() const {
    const double radius = HalfDiagonalPx() / FocalPx();
    const double k_per_px = 1 / (HalfDiagonalPx() * radius * radius);
    auto fitted = Moved(DepthFault::kLens, Grid(1), [this, k_per_px](const Parameters& px) {
      return PixelMotion([this, k = px[0] * k_per_px](const CauseSample& sample) -> Vector2d {
        const Camera& camera = CameraOf(sample);
        const Vector2d from_center = sample.pixel - camera.principal_point_px();
        const double squared = from_center.squaredNorm() / std::pow(camera.MeanFocalPx(), 2);
        return camera.principal_point_px() + from_center * (1 + k * squared);
      });
    });
    fitted->size[0] *= k_per_px;
    return fitted;
  }

  std::optional<CauseFit> Rotation() const {
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

  std::optional<CauseFit> Displacement() const {
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

  std::optional<CauseFit> TimeOffset() const {
    std::vector<Parameters> starts;
    for (int k = -2 * kMaxFrames; k <= 2 * kMaxFrames; ++k) starts.push_back({0.5 * k});
    const auto model = [this](const Parameters& frames) {
      return RigidMotion(
          [this, offset = frames[0]](size_t view) { return AtTime(views_[view], offset); });
    };
    const Parameters found = FindLeast(starts, 0.25, 1.0 / 64, [&](const Parameters& parameters) {
      return is_seen_from_anywhere_ ? MeanError(model(parameters).by_truth, polishing_)
                                    : MeanError(model(parameters).by_map, training_);
    });
    // Pixels by which it moves the image, as the other motions are judged.
    std::vector<double> moves_px;
    for (size_t view = 0; view < views_.size(); ++view) {
      const auto motion = AtTime(views_[view], found[0]);
      if (!motion) continue;
      const Vector3d ahead(0, 0, median_depth_);
      const Vector3d moved = *motion * ahead;
      if (moved.z() > 0) moves_px.push_back(FocalPx() * (moved.head<2>() / moved.z()).norm());
    }
    if (moves_px.empty()) return std::nullopt;
    const double move_px = MidpointMedianInPlace(std::span(moves_px));
    return CauseFit{DepthFault::kTimeOffset, found, move_px / kLeastMovePx, Best(model(found))};
  }

 private:
  const Camera& CameraOf(const CauseSample& sample) const { return views_[sample.view].camera; }
  double FocalPx() const { return views_.front().camera.MeanFocalPx(); }
  // Returns the distance from the principal point to a corner.
  double HalfDiagonalPx() const {
    const Camera& camera = views_.front().camera;
    return std::hypot(camera.width_px(), camera.height_px()) / 2;
  }

  // Parameters are in pixels that they move a point by, at most.
  template <typename Model>
  std::optional<CauseFit> Moved(DepthFault cause, const std::vector<Parameters>& starts,
                                Model model) const {
    Parameters found = FindLeast(starts, 2, kStopPx, [&](const Parameters& parameters) {
      return MeanError(model(parameters).by_map, training_);
    });
    if (is_seen_from_anywhere_) {
      const auto error = [&](const Parameters& parameters) {
        return MeanError(model(parameters).by_truth, polishing_);
      };
      const bool is_worth_it = error(found) < kMostLeftToPolish * ErrorAsItIs(polishing_);
      if (is_worth_it) found = FindLeast({found}, kPolishPx, kStopPx, error);
    }
    double largest_px = 0;
    for (const double px : found) largest_px = std::max(largest_px, std::abs(px));
    return CauseFit{cause, found, largest_px / kLeastMovePx, Best(model(found))};
  }

  Residual Best(const MotionModel& model) const {
    return is_seen_from_anywhere_ ? model.by_truth : model.by_map;
  }

  MotionModel PixelMotion(const std::function<Vector2d(const CauseSample&)>& motion) const {
    return {[this, motion](const CauseSample& sample) {
              return LogRatio(sample.estimated, DepthAt(views_[sample.view].truth, motion(sample)));
            },
            [this, motion](const CauseSample& sample) {
              const auto& truth_from = views_[sample.view].truth_from;
              return LogRatio(sample.estimated, truth_from({}, motion(sample)));
            }};
  }

  double FocalFactor(double corner_px) const { return 1 + corner_px / HalfDiagonalPx(); }

  // Returns the model that moves the estimated points to where the image's camera stands, and
  // compares them with what it sees there.
  MotionModel RigidMotion(
      const std::function<std::optional<Rigid3>(size_t)>& cam_from_map_camera) const {
    std::vector<std::optional<Rigid3>> motions;
    for (size_t i = 0; i < views_.size(); ++i) motions.push_back(cam_from_map_camera(i));
    return {[this, motions](const CauseSample& sample) -> std::optional<double> {
              const auto& motion = motions[sample.view];
              if (!motion) return std::nullopt;
              const Vector3d point = *motion * Vector3d(sample.ray * sample.estimated);
              const auto pixel = CameraOf(sample).ImgFromCam(point);
              if (!pixel) return std::nullopt;
              return LogRatio(point.z(), DepthAt(views_[sample.view].truth, *pixel));
            },
            [this, motions](const CauseSample& sample) -> std::optional<double> {
              const auto& motion = motions[sample.view];
              if (!motion) return std::nullopt;
              return LogRatio(sample.estimated,
                              views_[sample.view].truth_from(*motion, sample.pixel));
            }};
  }

  std::span<const ExplainedView> views_;
  std::span<const CauseSample> training_;
  double median_depth_;
  bool is_seen_from_anywhere_;
  std::vector<CauseSample> polishing_;
};

}  // namespace

double MedianTrueDepth(std::span<const CauseSample> samples) {
  std::vector<double> depths;
  for (const CauseSample& sample : samples) depths.push_back(sample.truth);
  return MidpointMedianInPlace(std::span(depths));
}

std::vector<CauseFitter> MotionFitters(std::span<const ExplainedView> views,
                                       std::span<const CauseSample> training) {
  const auto fitter = std::make_shared<const MotionFitter>(views, training);
  return {[fitter] { return fitter->Shift(); },
          [fitter] { return fitter->Zoom(); },
          [fitter] { return fitter->Lens(); },
          [fitter] { return fitter->Rotation(); },
          [fitter] { return fitter->Displacement(); },
          [fitter] { return fitter->TimeOffset(); },
          [fitter] { return fitter->Flipped(true, false); },
          [fitter] { return fitter->Flipped(false, true); },
          [fitter] { return fitter->Flipped(true, true); }};
}

void DepthMisalignment::Validate() const {
  RequirePositive("zoom", zoom);
  const auto require_finite = [](const char* name, double value) {
    if (!std::isfinite(value)) throw OptionError(name, FormatDouble(value), "must be finite");
  };
  for (const double value : shift_px) require_finite("shift", value);
  for (const double value : rotation_deg) require_finite("rotate", value);
  require_finite("lens", lens);
}

bool DepthMisalignment::IsNone() const {
  return shift_px.isZero(0) && zoom == 1 && lens == 0 && rotation_deg.isZero(0);
}

DepthMap MisalignDepth(const DepthMap& map, const Camera& camera,
                       const DepthMisalignment& misalignment) {
  if (misalignment.IsNone()) return map;
  const Camera seen = camera.Scaled(map.width_px, map.height_px);
  const Eigen::Vector2d shift_px(misalignment.shift_px.x() * map.width_px / camera.width_px(),
                                 misalignment.shift_px.y() * map.height_px / camera.height_px());
  const Eigen::Vector2d center = seen.principal_point_px();
  const Eigen::Quaterniond cam_from_map_camera =
      RotationFromVector(misalignment.rotation_deg * kRadPerDeg);
  const bool is_turned = !misalignment.rotation_deg.isZero(0);
  DepthMap result{map.width_px, map.height_px, std::vector<float>(map.z.size(), 0.0F)};
  size_t i = 0;
  for (int y = 0; y < map.height_px; ++y) {
    for (int x = 0; x < map.width_px; ++x, ++i) {
      Eigen::Vector2d pixel = Eigen::Vector2d(x + 0.5, y + 0.5) - shift_px;
      pixel = center + (pixel - center) / misalignment.zoom;
      const double squared = (pixel - center).squaredNorm() / std::pow(seen.MeanFocalPx(), 2);
      pixel = center + (pixel - center) * (1 + misalignment.lens * squared);
      double z_ratio = 1;  // of the misaligned camera's depth to the camera's
      if (is_turned) {
        const auto ray = seen.RayInCam(pixel);
        if (!ray || !(ray->z() > 0)) continue;
        const Eigen::Vector3d turned = cam_from_map_camera * *ray;
        const auto projected = seen.ImgFromCam(turned);
        if (!projected || !(turned.z() > 0)) continue;
        pixel = *projected;
        z_ratio = ray->z() / turned.z();
      }
      if (const auto sample = SampleDepth(map, pixel, {})) {
        result.z[i] = static_cast<float>(sample->z * z_ratio);
      }
    }
  }
  return result;
}

}  // namespace raylift
