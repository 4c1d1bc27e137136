#include "lifting/sfm_source.h"

#include <algorithm>
#include <map>
#include <unordered_map>
#include <utility>

#include "base/statistics.h"
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

// Text models and hloc's files round keypoints; no two features of different places are this close.
constexpr double kCoincidePx = 0.01;

struct Keypoint {
  Eigen::Vector2d pixel;
  std::optional<size_t> point;
};

struct Point {
  Eigen::Vector3d position_in_world;
  SurfacePoint::Track track;
};

// The keypoints of one image, by x.
class Keypoints {
 public:
  explicit Keypoints(std::vector<Keypoint> keypoints) : sorted_(std::move(keypoints)) {
    std::stable_sort(sorted_.begin(), sorted_.end(), [](const Keypoint& a, const Keypoint& b) {
      return a.pixel.x() < b.pixel.x();
    });
  }

  std::optional<size_t> FindPoint(const Eigen::Vector2d& pixel, double radius_px,
                                  const std::vector<Point>& points) const {
    const double reach_px = std::max(radius_px, kCoincidePx);
    std::optional<size_t> own, nearest;
    bool coincides = false;
    double nearest_px2 = radius_px * radius_px;
    for (auto k = std::lower_bound(sorted_.begin(), sorted_.end(), pixel.x() - reach_px, IsLeftOf);
         k != sorted_.end() && k->pixel.x() <= pixel.x() + reach_px; ++k) {
      const double distance_px2 = (k->pixel - pixel).squaredNorm();
      if (distance_px2 <= kCoincidePx * kCoincidePx) {
        coincides = true;
        if (k->point && (!own || points[*k->point].track.length > points[*own].track.length)) {
          own = k->point;
        }
      }
      if (k->point && distance_px2 <= nearest_px2) {
        nearest = k->point;
        nearest_px2 = distance_px2;
      }
    }
    return coincides ? own : nearest;
  }

 private:
  static bool IsLeftOf(const Keypoint& keypoint, double x) { return keypoint.pixel.x() < x; }

  std::vector<Keypoint> sorted_;
};

SurfacePoint::Track TrackOf(const ColmapPoint3D& point) {
  SurfacePoint::Track track{.length = point.track.size(), .error_px = std::nullopt};
  if (point.error_px >= 0) track.error_px = point.error_px;
  return track;
}

// Returns how far the model's points project from its keypoints by the references' poses.
std::vector<double> DistancesPx(const ColmapModel& model, const ColmapImage& image,
                                const PosedImage& reference) {
  std::vector<double> distances;
  for (const ColmapImage::Point2D& keypoint : image.points2d) {
    if (!keypoint.point3d_id) continue;
    const auto point = model.points3d.find(*keypoint.point3d_id);
    if (point == model.points3d.end()) continue;
    const auto projected =
        reference.camera.ImgFromCam(reference.cam_from_world * point->second.position_in_world);
    distances.push_back(projected ? (*projected - keypoint.pixel).norm()
                                  : std::numeric_limits<double>::infinity());
  }
  return distances;
}

}  // namespace

struct SfmSource::Impl {
  std::string description;
  SfmOptions options;
  std::vector<Point> points;
  std::map<std::string, Keypoints> keypoints_of_image;
};

SfmSource::SfmSource(std::string description, const ColmapModel& model, const SfmOptions& options) {
  auto impl = std::make_unique<Impl>();
  impl->description = std::move(description);
  impl->options = options;
  std::unordered_map<uint64_t, size_t> index_of_id;
  for (const auto& [id, point] : model.points3d) {
    const SurfacePoint::Track track = TrackOf(point);
    if (track.length < options.min_track_length ||
        track.error_px.value_or(0) > options.max_error_px) {
      continue;
    }
    index_of_id.emplace(id, impl->points.size());
    impl->points.push_back({point.position_in_world, track});
  }
  for (const auto& [id, image] : model.images) {
    std::vector<Keypoint> keypoints;
    keypoints.reserve(image.points2d.size());
    for (const ColmapImage::Point2D& keypoint : image.points2d) {
      keypoints.push_back({keypoint.pixel, std::nullopt});
      if (!keypoint.point3d_id) continue;
      const auto index = index_of_id.find(*keypoint.point3d_id);
      if (index != index_of_id.end()) keypoints.back().point = index->second;
    }
    impl->keypoints_of_image.emplace(image.name, std::move(keypoints));
  }
  impl_ = std::move(impl);
}

SfmSource::~SfmSource() = default;

std::string SfmSource::Description() const { return impl_->description; }

std::vector<std::optional<SurfacePoint>> SfmSource::Lift(
    const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const {
  std::vector<std::optional<SurfacePoint>> lifted(pixels.size());
  const auto keypoints = impl_->keypoints_of_image.find(reference.name);
  if (keypoints == impl_->keypoints_of_image.end()) return lifted;
  const Eigen::Vector3d center_in_world = reference.cam_from_world.OriginInSource();
  for (size_t i = 0; i < pixels.size(); ++i) {
    const auto index =
        keypoints->second.FindPoint(pixels[i], impl_->options.radius_px, impl_->points);
    if (!index) continue;
    const Point& point = impl_->points[*index];
    const double depth_z =
        reference.camera.DepthOf(reference.cam_from_world * point.position_in_world);
    if (!(depth_z > 0)) continue;
    const SurfacePoint surface{
        .point_in_world = point.position_in_world,
        .normal_in_world = (center_in_world - point.position_in_world).normalized(),
        .depth_z = depth_z,
        .incidence_deg = 0,
        .back_face = false,
        .depth_jump = std::nullopt,
        .track = point.track};
    if (impl_->options.limits.Keep(surface)) lifted[i] = surface;
  }
  return lifted;
}

SfmFit CheckSfmModel(const ColmapModel& model, std::span<const PosedImage> references) {
  std::unordered_map<std::string_view, const ColmapImage*> image_of_name;
  for (const auto& [id, image] : model.images) image_of_name.emplace(image.name, &image);
  size_t num_known = 0;
  std::vector<double> distances_px;
  for (const PosedImage& reference : references) {
    const auto image = image_of_name.find(reference.name);
    if (image == image_of_name.end()) continue;
    ++num_known;
    const auto of_image = DistancesPx(model, *image->second, reference);
    distances_px.insert(distances_px.end(), of_image.begin(), of_image.end());
  }
  std::vector<double> lengths;
  for (const auto& [id, point] : model.points3d) {
    lengths.push_back(static_cast<double>(point.track.size()));
  }

  SfmFit fit;
  fit.interpretation = fmt::format("{} points, tracks of {:.0f} images (median)",
                                   model.points3d.size(), UpperMedianOr(std::move(lengths), 0));
  if (num_known < references.size()) {
    fit.warnings.push_back(fmt::format("{} of {} references are not in the model",
                                       references.size() - num_known, references.size()));
  }
  if (distances_px.empty()) {
    fit.warnings.emplace_back("no keypoint of a reference has a 3D point");
    return fit;
  }
  const double median_px = UpperMedianOr(std::move(distances_px), 0);
  fit.interpretation +=
      fmt::format(", {:.2f} px from the references' keypoints (median)", median_px);
  constexpr double kFarPx = 10;
  if (median_px > kFarPx) {
    fit.warnings.push_back(fmt::format(
        "its points project {:.0f} px from their keypoints (median) by the references' poses: "
        "another coordinate frame?",
        median_px));
  }
  return fit;
}

}  // namespace raylift
