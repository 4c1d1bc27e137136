#include "localization/continuous/joined_references.h"

#include <algorithm>
#include <cmath>

#include "base/statistics.h"
#include "geometry/pose_step.h"
#include "geometry/triangulation.h"
#include <Eigen/Geometry>

#include "raylift/base/error.h"
#include "raylift/scene/keypoints.h"

namespace raylift {
namespace {

// Returns the linked point as a source of geometry gives it; its surface is not known.
SurfacePoint MakeSurfacePoint(const PosedImage& reference, const Eigen::Vector3d& point_in_world) {
  const Eigen::Vector3d to_camera = reference.cam_from_world.OriginInSource() - point_in_world;
  return {.point_in_world = point_in_world,
          .normal_in_world = to_camera.normalized(),
          .depth_z = (reference.cam_from_world * point_in_world).z(),
          .incidence_deg = 0,
          .back_face = false};
}

// Returns where along the query's ray it meets the reference's; nullopt where they are nearly
// parallel or meet behind a camera.
std::optional<double> DistanceByRays(const PoseProblem& problem, const Rigid3& cam_from_world,
                                     const Match2D2D& match) {
  constexpr double kMinSine = 0.01;
  const PosedImage& reference = problem.references[static_cast<size_t>(match.reference)];
  const auto query_ray = problem.query_camera.RayInCam(match.query_px);
  const auto reference_ray = reference.camera.RayInCam(match.reference_px);
  if (!query_ray || !reference_ray) return std::nullopt;
  const auto approach =
      Approach({cam_from_world.OriginInSource(), cam_from_world.rotation.conjugate() * *query_ray},
               {reference.cam_from_world.OriginInSource(),
                reference.cam_from_world.rotation.conjugate() * *reference_ray});
  if (!approach || !(approach->sine > kMinSine)) return std::nullopt;
  if (!(approach->ray_t_a > 0 && approach->ray_t_b > 0)) return std::nullopt;
  return approach->ray_t_a;
}

}  // namespace

std::vector<PointLink> LinksOfInliers(const QueryResult& result) {
  const Rigid3& cam_from_world = *result.localized.estimate.cam_from_world;
  const auto& matches = result.problem.matches_2d3d;
  const auto& inliers = result.localized.estimate.inliers_2d3d;
  RAYLIFT_CHECK_EQ(inliers.size(), matches.size());
  const KeypointNumbers keypoints = NumberQueryKeypoints({}, matches);
  std::vector<PointLink> links;
  for (auto& indices : GroupByKeypoint(keypoints.of_2d3d, keypoints.count)) {
    std::erase_if(indices, [&](size_t i) { return !inliers[i]; });
    if (indices.empty()) continue;
    const auto depth = [&](size_t i) { return (cam_from_world * matches[i].point_in_world).z(); };
    std::sort(indices.begin(), indices.end(),
              [&](size_t a, size_t b) { return std::pair(depth(a), a) < std::pair(depth(b), b); });
    const size_t middle = indices[indices.size() / 2];
    links.push_back({matches[middle].query_px, matches[middle].point_in_world});
  }
  const auto place = [](const PointLink& link) {
    return std::pair(link.pixel.x(), link.pixel.y());
  };
  std::stable_sort(links.begin(), links.end(),
                   [&](const PointLink& a, const PointLink& b) { return place(a) < place(b); });
  return links;
}

double SceneDistance(const QueryResult& result) {
  const PoseEstimate& estimate = result.localized.estimate;
  const Eigen::Vector3d center_in_world = estimate.cam_from_world->OriginInSource();
  std::vector<double> distances;
  for (size_t i = 0; i < estimate.inliers_2d3d.size(); ++i) {
    if (!estimate.inliers_2d3d[i]) continue;
    distances.push_back((result.problem.matches_2d3d[i].point_in_world - center_in_world).norm());
  }
  if (!distances.empty()) return UpperMedianOr(std::move(distances), 0);
  for (size_t i = 0; i < estimate.inliers_2d2d.size(); ++i) {
    if (!estimate.inliers_2d2d[i]) continue;
    const auto distance =
        DistanceByRays(result.problem, *estimate.cam_from_world, result.problem.matches_2d2d[i]);
    if (distance) distances.push_back(*distance);
  }
  return UpperMedianOr(std::move(distances), 0);
}

void JoinedReferences::Add(const JoinedReference& reference) {
  Entry entry{reference, {}};
  for (size_t i = 0; i < reference.links.size(); ++i) {
    entry.link_of_pixel.FindOrAdd(reference.links[i].pixel, static_cast<int>(i));
  }
  references_.insert_or_assign(reference.image.name, std::move(entry));
}

const JoinedReferences::Entry* JoinedReferences::Find(const std::string& name) const {
  const auto found = references_.find(name);
  return found == references_.end() ? nullptr : &found->second;
}

std::optional<Eigen::Vector3d> JoinedReferences::LinkedPoint(const std::string& name,
                                                             const Eigen::Vector2d& pixel) const {
  const Entry* entry = Find(name);
  if (entry == nullptr) return std::nullopt;
  const auto link = entry->link_of_pixel.Find(pixel);
  if (!link) return std::nullopt;
  return entry->reference.links[static_cast<size_t>(*link)].point_in_world;
}

// A step (w, v) moves a point p of the camera's frame by w x p + v, and its pixel by the Jacobian
// of the projection times that.
std::optional<double> JoinedReferences::SigmaPx(const JoinedReference& reference,
                                                const Eigen::Vector3d& point_in_cam) const {
  if (!weigh_ || !reference.covariance) return std::nullopt;
  const auto projection = reference.image.camera.ImgFromCamWithJacobian(point_in_cam);
  if (!projection) return std::nullopt;
  Eigen::Matrix<double, 2, 6> jacobian;
  jacobian << -projection->jacobian * Skew(point_in_cam), projection->jacobian;
  const double sigma_px =
      std::sqrt(0.5 * (jacobian * *reference.covariance * jacobian.transpose()).trace());
  if (!std::isfinite(sigma_px)) return std::nullopt;
  return sigma_px;
}

std::optional<double> JoinedReferences::SigmaPx(const std::string& name,
                                                const Eigen::Vector2d& pixel) const {
  const Entry* entry = Find(name);
  if (entry == nullptr) return std::nullopt;
  if (const auto point_in_world = LinkedPoint(name, pixel)) return SigmaPx(name, *point_in_world);
  const auto ray = entry->reference.image.camera.RayInCam(pixel);
  if (!ray || !(entry->reference.distance > 0)) return std::nullopt;
  return SigmaPx(entry->reference, entry->reference.distance * *ray);
}

std::optional<double> JoinedReferences::SigmaPx(const std::string& name,
                                                const Eigen::Vector3d& point_in_world) const {
  const Entry* entry = Find(name);
  if (entry == nullptr) return std::nullopt;
  return SigmaPx(entry->reference, entry->reference.image.cam_from_world * point_in_world);
}

void JoinedReferences::Weigh(QueryMatches& matches) const {
  for (Match2D2D& match : matches.matches) {
    const PosedImage& reference = matches.references[static_cast<size_t>(match.reference)];
    match.reference_sigma_px = SigmaPx(reference.name, match.reference_px);
  }
}

PoseCovariance JoinedReferences::PassedOn(const QueryResult& result) const {
  const PoseProblem& problem = result.problem;
  const PoseEstimate& estimate = result.localized.estimate;
  std::vector<double> weights(problem.references.size(), 0);
  double total = static_cast<double>(estimate.score_2d3d.num_inliers);
  for (size_t i = 0; i < estimate.inliers_2d2d.size(); ++i) {
    if (!estimate.inliers_2d2d[i]) continue;
    const Match2D2D& match = problem.matches_2d2d[i];
    // A keypoint's own noise is about a pixel.
    const double sigma_px = match.reference_sigma_px.value_or(0);
    const double weight = 1 / (1 + sigma_px * sigma_px);
    weights[static_cast<size_t>(match.reference)] += weight;
    total += weight;
  }
  PoseCovariance sum = PoseCovariance::Zero();
  double joined_share = 0;
  for (size_t r = 0; r < weights.size(); ++r) {
    const Entry* entry = Find(problem.references[r].name);
    if (entry == nullptr || !entry->reference.covariance || !(total > 0)) continue;
    const PoseCovariance adjoint =
        StepAdjoint(*estimate.cam_from_world * problem.references[r].cam_from_world.Inverse());
    const double share = weights[r] / total;
    sum += share * (adjoint * *entry->reference.covariance * adjoint.transpose());
    joined_share += share;
  }
  return joined_share * sum;
}

QueryMatches WeighedMatches::Match(const Query& query) const {
  return Weighed(source_->Match(query));
}

QueryMatches WeighedMatches::MatchPhotograph(const Query& query, const Image& photograph) const {
  return Weighed(source_->MatchPhotograph(query, photograph));
}

QueryMatches WeighedMatches::MatchFeatures(const Query& query, const Features& features) const {
  return Weighed(source_->MatchFeatures(query, features));
}

QueryMatches WeighedMatches::Weighed(QueryMatches matches) const {
  joined_->Weigh(matches);
  return matches;
}

std::vector<std::optional<SurfacePoint>> JoinedGeometry::Lift(
    const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const {
  if (!joined_->Contains(reference.name)) return source_->Lift(reference, pixels);
  std::vector<std::optional<SurfacePoint>> points(pixels.size());
  std::vector<size_t> asked;
  std::vector<Eigen::Vector2d> asked_pixels;
  for (size_t i = 0; i < pixels.size(); ++i) {
    if (const auto linked = joined_->LinkedPoint(reference.name, pixels[i])) {
      if (links_ == Links::kGive) points[i] = MakeSurfacePoint(reference, *linked);
      continue;
    }
    asked.push_back(i);
    asked_pixels.push_back(pixels[i]);
  }
  auto lifted = source_->Lift(reference, asked_pixels);
  for (size_t k = 0; k < asked.size(); ++k) {
    if (!lifted[k]) continue;
    // The point is as far beside the ray as the pose may be wrong there.
    const auto sigma_px = joined_->SigmaPx(reference.name, lifted[k]->point_in_world);
    if (sigma_px) {
      lifted[k]->point_sigma = *sigma_px * lifted[k]->depth_z / reference.camera.MeanFocalPx();
    }
    points[asked[k]] = std::move(lifted[k]);
  }
  return points;
}

}  // namespace raylift
