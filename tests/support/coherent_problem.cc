#include "support/coherent_problem.h"

#include <array>
#include <cmath>
#include <numbers>

namespace raylift {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

const Camera kCamera(CameraModel::kPinhole, 1600, 1200,
                     std::array<double, 4>{1500, 1500, 800, 600});
constexpr double kPeriod = 2.4;
constexpr double kDistance = 20;

// The facade: a wall with bays, and what stands before it.
double DepthAt(double x, double y) {
  const double wall =
      kDistance + 1.5 * std::sin(x / 11) + 0.5 * std::copysign(1, std::sin(x / 3.1));
  return wall - 6 * std::exp(-((x - 5) * (x - 5) + (y - 3) * (y - 3)) / 6) -
         4 * std::exp(-((x + 6) * (x + 6) + (y - 4) * (y - 4)) / 4);
}

Vector3d OnFacade(double x, double y) { return {x, y, DepthAt(x, y)}; }

Vector3d Direction(Rng& rng) {
  return Vector3d(rng.Normal(), rng.Normal(), rng.Normal()).normalized();
}

Vector2d Noisy(const Vector2d& px, const CoherentOptions& options, Rng& rng) {
  double chi_squared = 0;
  for (int i = 0; i < options.tail_degrees; ++i) {
    const double e = rng.Normal();
    chi_squared += e * e;
  }
  const double scale =
      options.tail_degrees == 0 ? 1 : std::sqrt(options.tail_degrees / chi_squared);
  return px + scale * options.sigma_px * Vector2d(rng.Normal(), rng.Normal());
}

bool IsInside(const Vector2d& px) {
  return px.x() > 0 && px.y() > 0 && px.x() < kCamera.width_px() && px.y() < kCamera.height_px();
}

// At `center`, looking at `target`, its x axis level.
Rigid3 LookAt(const Vector3d& center, const Vector3d& target) {
  const Vector3d z = (target - center).normalized();
  const Vector3d x = Vector3d::UnitY().cross(z).normalized();
  Eigen::Matrix3d rotation;
  rotation << x.transpose(), z.cross(x).transpose(), z.transpose();
  return {Eigen::Quaterniond(rotation), -(rotation * center)};
}

// Another camera of the rig: elsewhere, and turned about all axes, as rigs are.
RigCamera OtherCamera(int index, double extent, Rng& rng) {
  const Vector3d center = extent * rng.Uniform(0.5, 1) * Direction(rng);
  const Vector3d target(rng.Uniform(-5, 5), rng.Uniform(-3, 3), kDistance);
  const Rigid3 rolled{RotationFromVector(rng.Uniform(-1, 1) * Vector3d::UnitZ()), Vector3d::Zero()};
  return {"camera " + std::to_string(index), kCamera, rolled * LookAt(center, target)};
}

}  // namespace

CoherentProblem MakeCoherentProblem(const std::string& name, const CoherentOptions& options,
                                    Rng& rng) {
  CoherentProblem made;
  made.problem.name = name;
  made.problem.query_camera = kCamera;
  // The world is turned and moved, so that nothing is at its origin.
  const Rigid3 query_from_world{RotationFromVector(rng.Uniform(0, 3) * Direction(rng)),
                                20 * Direction(rng)};
  made.query_from_world = query_from_world;

  for (int c = 1; c < options.num_cameras; ++c) {
    made.problem.other_cameras.push_back(OtherCamera(c, options.rig_extent, rng));
  }

  // The keypoints of the cameras, one camera's after the other's.
  std::vector<Vector3d> points;
  std::vector<Vector2d> pixels;
  std::vector<bool> repeated;
  std::vector<double> surface_error;
  const auto camera_of = [&](size_t keypoint) {
    return static_cast<int>(keypoint) / options.num_keypoints;
  };
  while (static_cast<int>(points.size()) < options.num_keypoints * options.num_cameras) {
    const Vector3d point = OnFacade(rng.Uniform(-11, 11), rng.Uniform(-8, 8));
    const int camera = camera_of(points.size());
    const auto px = kCamera.ImgFromCam(
        camera == 0
            ? point
            : made.problem.other_cameras[static_cast<size_t>(camera - 1)].cam_from_query * point);
    if (!px || !IsInside(*px)) continue;
    points.push_back(point);
    pixels.push_back(Noisy(*px, options, rng));
    repeated.push_back(rng.Uniform() < options.repeated);
    surface_error.push_back(options.surface * rng.Normal());
  }

  for (int r = 0; r < options.num_references; ++r) {
    Vector3d center(rng.Uniform(-1, 1), options.vertical * rng.Uniform(-1, 1),
                    rng.Uniform(-0.4, 0.4));
    center *= options.baseline;
    center.x() += std::copysign(0.1 * options.baseline, center.x());
    const Rigid3 ref_from_query =
        LookAt(center, Vector3d(rng.Normal(), rng.Normal(), kDistance + rng.Normal()));
    const double turn = options.reference_deg * std::numbers::pi / 180 * rng.Normal();
    const double shift = options.reference_position * rng.Normal();
    const Rigid3 error{RotationFromVector(turn * Direction(rng)), shift * Direction(rng)};
    const Rigid3 known_from_world = error * ref_from_query * query_from_world;
    const double factor = options.reference_factor * rng.Normal();
    made.problem.references.push_back(
        {"reference " + std::to_string(r), kCamera, known_from_world});

    for (size_t k = 0; k < points.size(); ++k) {
      Vector3d seen = points[k];
      if (repeated[k] && rng.Uniform() < 0.6) {
        seen = OnFacade(seen.x() + std::copysign(kPeriod, rng.Uniform(-1, 1)), seen.y());
      }
      if (rng.Uniform() < options.wrong) {
        seen = points[rng.UniformIndex(static_cast<uint32_t>(points.size()))];
      }
      const Vector3d in_reference = ref_from_query * seen;
      const auto projected = kCamera.ImgFromCam(in_reference);
      if (rng.Uniform() >= options.seen || !projected || !IsInside(*projected)) continue;
      const Vector2d px = Noisy(*projected, options, rng);
      const double depth = in_reference.z() * std::exp(factor + surface_error[k]);
      const Vector3d ray = *kCamera.RayInCam(px);
      const auto keypoint = static_cast<int>(k) % options.num_keypoints;
      made.problem.matches_2d3d.push_back(
          {.query_px = pixels[k],
           .point_in_world = known_from_world.Inverse() * (ray * (depth / ray.z())),
           .reference = r,
           .query_keypoint = keypoint,
           .match_2d2d = made.problem.matches_2d2d.size(),
           .camera = camera_of(k)});
      made.problem.matches_2d2d.push_back({.reference = r,
                                           .query_px = pixels[k],
                                           .reference_px = px,
                                           .query_keypoint = keypoint,
                                           .camera = camera_of(k)});
    }
  }
  return made;
}

}  // namespace raylift
