#include <cmath>
#include <numbers>

#include "base/rng.h"
#include "evaluation/fields.h"

#include "raylift/evaluation/perturbation.h"

namespace raylift {
namespace {

using Eigen::Vector3d;

Vector3d Normal3(Rng& rng, double sigma) {
  Vector3d vector;
  for (double& x : vector) x = sigma * rng.Normal();
  return vector;
}

// Returns where lost odometry begins anew: a turn of about a radian, and a few steps away.
Rigid3 Restart(Rng& rng, double step_length) {
  constexpr double kSteps = 5;
  return {RotationFromVector(Normal3(rng, 1)), Normal3(rng, kSteps * step_length)};
}

}  // namespace

std::vector<Field> FieldsOf(OdometryPerturbation& values) {
  return {
      {"drift", values.drift_sigma,
       "Standard deviation of the position after a scene unit of way, per axis;\n"
       "it grows with the root of the way",
       kNotNegative},
      {"turn_drift_deg", values.turn_sigma_deg, "The same of the orientation", kNotNegative},
      {"unit", values.unit, "Scene units per unit of the odometry", kPositive},
      {"lost", values.lost_share, "Share of the steps in which it begins anew elsewhere", kShare},
      {"dropout", values.dropout_share, "Share of the poses that are missing", kShare}};
}

void OdometryPerturbation::Validate() const { CheckRanges(ConstFieldsOf(*this)); }

std::vector<OdometryPose> PerturbOdometry(std::span<const Rigid3> cam_from_world,
                                          const OdometryPerturbation& perturbation, uint64_t seed) {
  Rng drift(StreamSeed(seed, "odometry", "drift"));
  Rng lost(StreamSeed(seed, "odometry", "lost"));
  Rng dropout(StreamSeed(seed, "odometry", "dropout"));
  const double turn_sigma = perturbation.turn_sigma_deg * std::numbers::pi / 180;
  std::vector<OdometryPose> poses;
  Rigid3 pose;
  for (size_t i = 0; i < cam_from_world.size(); ++i) {
    if (i > 0) {
      Rigid3 step = cam_from_world[i] * cam_from_world[i - 1].Inverse();
      const double length = step.translation.norm();
      const double root = std::sqrt(length);
      const Rigid3 error{RotationFromVector(Normal3(drift, root * turn_sigma)),
                         Normal3(drift, root * perturbation.drift_sigma)};
      pose = error * step * pose;
      const Rigid3 restart = Restart(lost, length);
      if (lost.Uniform() < perturbation.lost_share) pose = restart * pose;
    }
    if (dropout.Uniform() < perturbation.dropout_share) continue;
    Rigid3& given = poses.emplace_back(OdometryPose{i, pose}).cam_from_odometry;
    given.translation /= perturbation.unit;
  }
  return poses;
}

}  // namespace raylift
