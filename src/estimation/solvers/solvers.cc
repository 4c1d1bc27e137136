#include "raylift/estimation/solvers.h"

#include <array>
#include <optional>

#include "estimation/solvers/minimal_solvers.h"
#include <Eigen/Geometry>

namespace raylift {
namespace {

using Eigen::Vector3d;

template <size_t kCount>
std::array<Vector3d, kCount> Normalized(std::span<const Vector3d, kCount> rays) {
  std::array<Vector3d, kCount> unit;
  for (size_t i = 0; i < kCount; ++i) unit[i] = rays[i].normalized();
  return unit;
}

template <size_t kCount>
std::array<Vector3d, kCount> Copied(std::span<const Vector3d, kCount> vectors) {
  std::array<Vector3d, kCount> copy;
  for (size_t i = 0; i < kCount; ++i) copy[i] = vectors[i];
  return copy;
}

Rigid3 ToRigid3(const CamFromLocal& pose) {
  return {Eigen::Quaterniond(pose.rotation).normalized(), pose.translation};
}

std::vector<Rigid3> ToRigid3s(std::span<const CamFromLocal> poses) {
  std::vector<Rigid3> result;
  for (const CamFromLocal& pose : poses) result.push_back(ToRigid3(pose));
  return result;
}

// Completes poses relative to a reference (in world axes) by the length of the translation, which a
// match with another reference gives.
std::vector<Rigid3> WithLength(std::span<const RelativePose> poses, const Vector3d& center,
                               const RayPair& match, const Vector3d& match_center) {
  std::vector<Rigid3> result;
  for (const RelativePose& pose : poses) {
    if (const auto length = TranslationLength(pose, center, match, match_center)) {
      result.push_back(ToRigid3(QueryPose(pose, center, *length)));
    }
  }
  return result;
}

}  // namespace

std::vector<Rigid3> SolveP3p(std::span<const Vector3d, 3> rays_in_cam,
                             std::span<const Vector3d, 3> points_in_world) {
  std::array<CamFromLocal, 4> poses;
  const int count = SolveP3p(Normalized(rays_in_cam), Copied(points_in_world), poses);
  return ToRigid3s(std::span(poses).first(static_cast<size_t>(count)));
}

std::vector<Rigid3> SolveGeneralizedP3p(std::span<const Vector3d, 3> centers_in_rig,
                                        std::span<const Vector3d, 3> rays_in_rig,
                                        std::span<const Vector3d, 3> points_in_world) {
  std::array<CamFromLocal, kMaxGeneralizedP3pSolutions> poses;
  const int count = SolveGeneralizedP3p(Copied(centers_in_rig), Normalized(rays_in_rig),
                                        Copied(points_in_world), poses);
  return ToRigid3s(std::span(poses).first(static_cast<size_t>(count)));
}

std::vector<Rigid3> SolveE5p1(std::span<const Vector3d, 6> rays_in_cam,
                              std::span<const Vector3d, 6> rays_in_reference,
                              const Rigid3& reference_from_world,
                              const Rigid3& sixth_reference_from_world) {
  const auto query_rays = Normalized(rays_in_cam.first<5>());
  auto reference_rays = Normalized(rays_in_reference.first<5>());
  for (Vector3d& ray : reference_rays) ray = reference_from_world.rotation.conjugate() * ray;
  std::array<RelativePose, kMaxFivePointSolutions> poses;
  const int count = SolveRelativePose(query_rays, reference_rays, poses);
  const RayPair sixth = {
      rays_in_cam[5].normalized(),
      sixth_reference_from_world.rotation.conjugate() * rays_in_reference[5].normalized()};
  return WithLength(std::span(poses).first(static_cast<size_t>(count)),
                    reference_from_world.OriginInSource(), sixth,
                    sixth_reference_from_world.OriginInSource());
}

std::vector<Rigid3> SolveD3p1(std::span<const Vector3d, 4> rays_in_cam,
                              std::span<const Vector3d, 3> points_in_reference,
                              const Vector3d& ray_in_fourth_reference,
                              const Rigid3& reference_from_world,
                              const Rigid3& fourth_reference_from_world) {
  auto points_from_center = Copied(points_in_reference);
  for (Vector3d& point : points_from_center) {
    point = reference_from_world.rotation.conjugate() * point;
  }
  std::array<RelativePose, 4> poses;
  const int count =
      SolveRelativePoseByDepth(Normalized(rays_in_cam.first<3>()), points_from_center, poses);
  const RayPair fourth = {
      rays_in_cam[3].normalized(),
      fourth_reference_from_world.rotation.conjugate() * ray_in_fourth_reference.normalized()};
  return WithLength(std::span(poses).first(static_cast<size_t>(count)),
                    reference_from_world.OriginInSource(), fourth,
                    fourth_reference_from_world.OriginInSource());
}

std::vector<Rigid3> SolveUp2p(std::span<const Vector3d, 2> rays_in_cam,
                              std::span<const Vector3d, 2> points_in_world,
                              const Vector3d& down_in_cam, const Vector3d& down_in_world) {
  const std::array<Vector3d, 2> centers = {Vector3d::Zero(), Vector3d::Zero()};
  std::array<CamFromLocal, 2> poses;
  const int count = SolveUprightPose(centers, Normalized(rays_in_cam), Copied(points_in_world),
                                     down_in_cam.normalized(), down_in_world.normalized(), poses);
  return ToRigid3s(std::span(poses).first(static_cast<size_t>(count)));
}

std::vector<Rigid3> SolveKnownCenter(std::span<const Vector3d, 2> rays_in_cam,
                                     std::span<const Vector3d, 2> points_in_world,
                                     const Vector3d& center_in_world) {
  const auto pose =
      SolvePoseAtCenter(Normalized(rays_in_cam), Copied(points_in_world), center_in_world);
  if (!pose) return {};
  return {ToRigid3(*pose)};
}

}  // namespace raylift
