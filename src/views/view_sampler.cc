#include "raylift/views/view_sampler.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/constants.h"
#include "base/rng.h"
#include "views/polyline.h"
#include "views/space_probe.h"
#include <Eigen/Geometry>
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

constexpr double kMinOpenShare = 0.5;  // within a solid body all is seen from behind
constexpr int kMaxFailures = 4;        // rounds that add no view
constexpr size_t kMinPlacesPerRound = 64;
constexpr int kBearings = 24;      // directions of sight that are compared at each place
constexpr double kFreeRange = 12;  // eye heights; looking farther is no better

// Returns half the angle of the picture's narrower side.
double HalfAngleOfView(const Camera& camera) {
  const double half =
      std::min(camera.width_px() / camera.focal_x_px(), camera.height_px() / camera.focal_y_px()) /
      2;
  return std::atan(half);
}

Eigen::AlignedBox3d BoundsInWorld(const TriangleMesh& mesh) {
  Eigen::AlignedBox3f box;
  for (const Eigen::Vector3f& vertex : mesh.vertices) box.extend(vertex);
  return {box.min().cast<double>() + mesh.origin_in_world,
          box.max().cast<double>() + mesh.origin_in_world};
}

// Returns two unit vectors that are level, at right angles.
std::pair<Eigen::Vector3d, Eigen::Vector3d> LevelAxes(const Eigen::Vector3d& up) {
  const Eigen::Vector3d first = up.unitOrthogonal();
  return {first, up.cross(first)};
}

// Adds a warning where views are fewer than wanted; returns nullopt where there are none.
std::optional<SampledViews> Checked(SampledViews views, int wanted) {
  const size_t found = views.cam_from_world.size();
  if (found == 0) return std::nullopt;
  if (static_cast<int>(found) < wanted) {
    views.warnings.push_back(
        fmt::format("only {} of {} views were found that are clear of surfaces", found, wanted));
  }
  return views;
}

// Throws InputError where there are none; `way_out` is a further sentence.
SampledViews Required(std::optional<SampledViews> views, std::string_view way_out = "") {
  if (!views) {
    throw InputError(
        fmt::format("no place for a camera was found: is the direction of up right, and are the "
                    "clearance and the eye height in the scene's unit?{}",
                    way_out));
  }
  return *std::move(views);
}

class InsideSampler {
 public:
  InsideSampler(const RayCaster& mesh, const ViewSamplerOptions& options,
                const InsideOptions& inside)
      : mesh_(mesh), options_(options), inside_(inside), up_(options.up_in_world.normalized()) {}

  SampledViews Run() {
    std::vector<Eigen::Vector3d> eyes;
    for (const EyePlace& place : FindEyePlaces(mesh_, options_, inside_)) {
      eyes.push_back(place.center);
    }
    SampledViews views;
    Rng rng(StreamSeed(options_.seed, "inside", "views"));
    // Several rounds, so that few places serve for many views.
    int failures = 0;
    while (!eyes.empty() && failures < kMaxFailures &&
           static_cast<int>(views.cam_from_world.size()) < options_.count) {
      const size_t before = views.cam_from_world.size();
      AddRound(eyes, rng, views);
      failures = views.cam_from_world.size() == before ? failures + 1 : 0;
    }
    return views;
  }

 private:
  // Adds views from places that are far from each other, one for each place.
  void AddRound(const std::vector<Eigen::Vector3d>& eyes, Rng& rng, SampledViews& views) const {
    const auto wanted = static_cast<size_t>(options_.count) - views.cam_from_world.size();
    for (const size_t i : FarthestFirst(eyes, std::max(4 * wanted, kMinPlacesPerRound), rng)) {
      if (static_cast<int>(views.cam_from_world.size()) == options_.count) return;
      if (const auto view = LookFrom(eyes[i], rng)) views.cam_from_world.push_back(*view);
    }
  }

  // The picture is worth more the farther it sees, up to a limit; what sees nothing is worth none.
  std::optional<Rigid3> LookFrom(const Eigen::Vector3d& eye, Rng& rng) const {
    struct Candidate {
      double score;
      Rigid3 pose;
    };
    if (ProbeSurroundings(mesh_, eye, kManyDirections).clearance < options_.clearance) {
      return std::nullopt;
    }
    const auto [ahead, aside] = LevelAxes(up_);
    const double down = inside_.look_down_deg * kRadPerDeg;
    const double first = rng.Uniform(0, 2 * std::numbers::pi);
    std::vector<Candidate> candidates;
    for (int k = 0; k < kBearings; ++k) {
      const double bearing = first + 2 * std::numbers::pi * k / kBearings;
      const Eigen::Vector3d level = std::cos(bearing) * ahead + std::sin(bearing) * aside;
      const Rigid3 pose = LookAlong(eye, std::cos(down) * level - std::sin(down) * up_, up_);
      const VisibleSurface sight = MeasureView(mesh_, options_.camera, pose);
      if (sight.coverage < inside_.min_coverage || sight.median_range < 2 * options_.clearance ||
          (!options_.any_side && sight.front_share < kMinFrontShare)) {
        continue;
      }
      candidates.push_back(
          {sight.coverage * std::min(sight.median_range, kFreeRange * inside_.eye_height), pose});
    }
    if (candidates.empty()) return std::nullopt;
    // One of the better ones, so that neighbors do not all look the same way.
    std::stable_sort(candidates.begin(), candidates.end(),
                     [](const Candidate& a, const Candidate& b) { return a.score > b.score; });
    const auto best = static_cast<uint32_t>((candidates.size() + 2) / 3);
    return candidates[rng.UniformIndex(best)].pose;
  }

  const RayCaster& mesh_;
  const ViewSamplerOptions& options_;
  const InsideOptions& inside_;
  Eigen::Vector3d up_;
};

struct LinePoint {
  Eigen::Vector3d position;
  Eigen::Vector3d direction;  // unit
};

// Returns evenly spaced points, the ends included; the direction is that of the line within a
// spacing around.
std::vector<LinePoint> SpreadOnLine(std::span<const Eigen::Vector3d> points, int count) {
  const Polyline line({points.begin(), points.end()});
  const double spacing = line.length() / std::max(count - 1, 1);
  std::vector<LinePoint> spread;
  for (int i = 0; i < count; ++i) {
    const double length = i * spacing;
    const Eigen::Vector3d tangent =
        line.At(length + 0.5 * spacing) - line.At(length - 0.5 * spacing);
    spread.push_back({line.At(length), tangent.normalized()});
  }
  return spread;
}

}  // namespace

Rigid3 LookAlong(const Eigen::Vector3d& center, const Eigen::Vector3d& forward,
                 const Eigen::Vector3d& up) {
  Eigen::Vector3d right = forward.cross(up);
  if (right.norm() < 1e-6 * forward.norm() * up.norm()) right = forward.unitOrthogonal();
  Eigen::Matrix3d rotation;
  rotation.row(0) = right.normalized();
  rotation.row(2) = forward.normalized();
  rotation.row(1) = rotation.row(2).cross(rotation.row(0));
  Rigid3 pose;
  pose.rotation = Eigen::Quaterniond(rotation).normalized();
  pose.translation = -(pose.rotation * center);
  return pose;
}

Eigen::Vector3d LevelUp(const TriangleMesh& mesh, const Eigen::Vector3d& hint) {
  Eigen::Vector3d up = hint.normalized();
  for (const double cone_deg : {30.0, 20.0, 10.0, 5.0, 5.0}) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const auto& [a, b, c] : mesh.triangles) {
      const Eigen::Vector3d normal = (mesh.vertices[b] - mesh.vertices[a])
                                         .cross(mesh.vertices[c] - mesh.vertices[a])
                                         .cast<double>();
      if (normal.dot(up) > std::cos(cone_deg * kRadPerDeg) * normal.norm()) sum += normal;
    }
    if (sum.norm() > 0) up = sum.normalized();
  }
  return up;
}

SampledViews SampleAround(const RayCaster& mesh, const ViewSamplerOptions& options,
                          const AroundOptions& around) {
  const Eigen::AlignedBox3d bounds = BoundsInWorld(mesh.mesh());
  const Eigen::Vector3d middle = bounds.center();
  const double radius = 0.5 * bounds.diagonal().norm();
  const double distance =
      around.distance.value_or(radius / std::sin(HalfAngleOfView(options.camera)));
  const Eigen::Vector3d up = options.up_in_world.normalized();
  const auto [ahead, aside] = LevelAxes(up);
  const double low = std::sin(around.min_elevation_deg * kRadPerDeg);
  const double high = std::sin(around.max_elevation_deg * kRadPerDeg);
  const bool is_ring = low == high;
  const double golden_angle = std::numbers::pi * (3 - std::sqrt(5.0));
  SampledViews views;
  for (int i = 0; i < options.count; ++i) {
    const double height = low + (high - low) * (i + 0.5) / options.count;
    const double bearing = is_ring ? 2 * std::numbers::pi * i / options.count : golden_angle * i;
    const Eigen::Vector3d from_middle =
        height * up + std::sqrt(std::max(0.0, 1 - height * height)) *
                          (std::cos(bearing) * ahead + std::sin(bearing) * aside);
    const Eigen::Vector3d center = middle + distance * from_middle;
    if (ProbeSurroundings(mesh, center, kManyDirections).clearance < options.clearance) continue;
    views.cam_from_world.push_back(LookAlong(center, -from_middle, up));
  }
  return Required(Checked(std::move(views), options.count));
}

SampledViews SampleInside(const RayCaster& mesh, const ViewSamplerOptions& options,
                          const InsideOptions& inside) {
  return Required(TrySampleInside(mesh, options, inside),
                  " The modes cover and auto need no ground.");
}

std::optional<SampledViews> TrySampleInside(const RayCaster& mesh,
                                            const ViewSamplerOptions& options,
                                            const InsideOptions& inside) {
  return Checked(InsideSampler(mesh, options, inside).Run(), options.count);
}

SampledViews SampleAlong(const RayCaster& mesh, const ViewSamplerOptions& options,
                         std::span<const Eigen::Vector3d> line) {
  if (line.size() < 2) throw InputError("a line needs at least two points");
  SampledViews views;
  for (const LinePoint& point : SpreadOnLine(line, options.count)) {
    const Surroundings around = ProbeSurroundings(mesh, point.position, kManyDirections);
    const bool is_inside_a_body = !options.any_side && around.front_share < kMinOpenShare;
    if (around.clearance < options.clearance || is_inside_a_body) continue;
    views.cam_from_world.push_back(
        LookAlong(point.position, point.direction, options.up_in_world.normalized()));
  }
  return Required(Checked(std::move(views), options.count));
}

}  // namespace raylift
