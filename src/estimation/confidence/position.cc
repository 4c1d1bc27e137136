// Whether the matches tell where the camera is, beside where it looks.

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "base/statistics.h"
#include "estimation/confidence/confidence.h"
#include <Eigen/Geometry>

namespace raylift {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

// Where a match is an inlier, as the camera moves along a line.
struct Interval {
  double begin, end;
  size_t keypoint;

  bool Contains(double x) const { return begin < x && x < end; }
};

// Returns where a x^2 + 2 b x + c < 0, if that is one bounded interval.
std::optional<Interval> WhereNegative(double a, double b, double c, size_t keypoint) {
  const double discriminant = b * b - a * c;
  if (!(a > 0) || !(discriminant > 0)) return std::nullopt;
  const double root = std::sqrt(discriminant);
  return Interval{(-b - root) / a, (-b + root) / a, keypoint};
}

// The camera moves by x along `direction` (local axes), its axes unchanged. Squared residuals are
// ratios of two squares of linear functions of x, so that the bounds of an interval are roots of a
// quadratic.
class CameraOnLine {
 public:
  CameraOnLine(const NormalizedProblem& problem, const CamFromLocal& pose,
               const Vector3d& direction)
      : problem_(problem), pose_(pose), direction_(direction) {}

  // The squared reprojection error |n.xy|^2 / (n.z^2 + v), with n = m - x k.
  std::optional<Interval> InlierInterval(const NormalizedMatch2D3D& match) const {
    const CamFromLocal camera = problem_.PoseOfCamera(pose_, match.camera);
    const Vector3d m = match.image_from_ray * (camera.rotation * match.point + camera.translation);
    const Vector3d k = match.image_from_ray * (camera.rotation * direction_);
    const auto dot = [](const Vector3d& p, const Vector3d& q) {
      return p.head<2>().dot(q.head<2>()) - p.z() * q.z();
    };
    const auto interval = WhereNegative(dot(k, k), -dot(m, k),
                                        dot(m, m) - match.variance_at_unit_depth, match.keypoint);
    const bool in_front = interval && m.z() - 0.5 * (interval->begin + interval->end) * k.z() > 0;
    return in_front ? interval : std::nullopt;
  }

  // The squared Sampson error (q . (b x r))^2 / (|Gq' (b x r)|^2 + |Gr' (q x b)|^2), with the
  // baseline b = b0 - x direction.
  std::optional<Interval> InlierInterval(const NormalizedMatch2D2D& match) const {
    const Matrix3d local_from_cam = pose_.rotation.transpose();
    const Vector3d query_ray = local_from_cam * match.query_ray;
    const Vector3d baseline =
        problem_.centers[static_cast<size_t>(match.reference)] -
        local_from_cam *
            (problem_.camera_centers[static_cast<size_t>(match.camera)] - pose_.translation);
    struct Terms {
      double numerator;
      Vector2d by_query, by_reference;
    };
    const auto at = [&](const Vector3d& b) {
      const Vector3d normal = b.cross(match.reference_ray);
      return Terms{query_ray.dot(normal),
                   match.query_gradient.transpose() * (pose_.rotation * normal),
                   match.reference_gradient.transpose() * query_ray.cross(b)};
    };
    const Terms m = at(baseline), k = at(direction_);
    const auto dot = [](const Terms& p, const Terms& q) {
      return p.numerator * q.numerator - p.by_query.dot(q.by_query) -
             p.by_reference.dot(q.by_reference);
    };
    const auto interval = WhereNegative(dot(k, k), -dot(m, k), dot(m, m), match.keypoint);
    if (!interval) return std::nullopt;
    const Vector3d middle = baseline - 0.5 * (interval->begin + interval->end) * direction_;
    // The rays may meet behind a camera by what a pixel's error moves the angle between them.
    const double cosine = query_ray.dot(match.reference_ray);
    const double slack = match.parallax * middle.norm();
    const double from_query = middle.dot(query_ray - cosine * match.reference_ray);
    const double from_reference = middle.dot(cosine * query_ray - match.reference_ray);
    return from_query + slack > 0 && from_reference + slack > 0 ? interval : std::nullopt;
  }

 private:
  const NormalizedProblem& problem_;
  const CamFromLocal& pose_;
  Vector3d direction_;
};

Vector3d CenterOfCamera(const NormalizedProblem& problem, const CamFromLocal& pose, int camera) {
  return pose.rotation.transpose() *
         (problem.camera_centers[static_cast<size_t>(camera)] - pose.translation);
}

// Returns the distance from the camera at which a match's rays meet.
double TriangulatedDistance(const NormalizedProblem& problem, const CamFromLocal& pose,
                            const NormalizedMatch2D2D& match) {
  const Vector3d query_ray = pose.rotation.transpose() * match.query_ray;
  const Vector3d baseline = problem.centers[static_cast<size_t>(match.reference)] -
                            CenterOfCamera(problem, pose, match.camera);
  return baseline.cross(match.reference_ray).norm() / query_ray.cross(match.reference_ray).norm();
}

// Returns the camera and reference that explain most 2D-2D matches; nullopt where there are none.
std::optional<int> DominantReference(const NormalizedProblem& problem, const Residuals& residuals) {
  std::vector<int> counts(problem.num_camera_references(), 0);
  for (size_t i = 0; i < problem.matches_2d2d.size(); ++i) {
    counts[static_cast<size_t>(problem.matches_2d2d[i].camera_reference)] +=
        residuals.of_2d2d[i] < 1 ? 1 : 0;
  }
  const auto most = std::max_element(counts.begin(), counts.end());
  if (most == counts.end() || *most == 0) return std::nullopt;
  return static_cast<int>(most - counts.begin());
}

// What the matches say at a place of the line, beside what they say at 0.
class PlacesOnLine {
 public:
  PlacesOnLine(const std::vector<Interval>& intervals, size_t num_keypoints)
      : intervals_(intervals), at_zero_(num_keypoints, 0), here_(num_keypoints, 0) {
    for (const Interval& interval : intervals) {
      if (!interval.Contains(0)) continue;
      ++at_zero_[interval.keypoint];
      ++matches_at_zero_;
    }
    exclusive_.only_first = static_cast<double>(
        std::count_if(at_zero_.begin(), at_zero_.end(), [](int count) { return count > 0; }));
  }

  // The probability that 0 is the right place, if one is, by the place elsewhere that most
  // keypoints speak for: one that shares at most a quarter of the matches that speak for 0.
  double ProbabilityOfZero(double clustering) {
    // RANSAC's sample has chosen the place by one of the matches, which says nothing.
    if (!(exclusive_.only_first > 1)) return 0.5;
    struct Bound {
      double x;
      bool is_begin;
      size_t interval;
    };
    std::vector<Bound> bounds;
    for (size_t i = 0; i < intervals_.size(); ++i) {
      bounds.push_back({intervals_[i].begin, true, i});
      bounds.push_back({intervals_[i].end, false, i});
    }
    std::sort(bounds.begin(), bounds.end(),
              [](const Bound& a, const Bound& b) { return a.x < b.x; });
    double probability = 1;
    for (const Bound& bound : bounds) {
      Move(intervals_[bound.interval], bound.is_begin ? 1 : -1);
      if (4 * shared_ > matches_at_zero_) continue;
      const ExclusiveInliers beyond_sample{exclusive_.only_first - 1, exclusive_.only_second};
      probability =
          std::min(probability, beyond_sample.ProbabilityOfFirst(clustering).value_or(0.5));
    }
    return probability;
  }

 private:
  // Enters an interval (1) or leaves it (-1).
  void Move(const Interval& interval, int change) {
    if (interval.Contains(0)) shared_ += change;
    const int zero = at_zero_[interval.keypoint];
    int& here = here_[interval.keypoint];
    exclusive_.only_first -= zero > here ? 1 : 0;
    exclusive_.only_second -= here > zero ? 1 : 0;
    here += change;
    exclusive_.only_first += zero > here ? 1 : 0;
    exclusive_.only_second += here > zero ? 1 : 0;
  }

  const std::vector<Interval>& intervals_;
  std::vector<int> at_zero_, here_;  // matches of each keypoint
  int matches_at_zero_ = 0, shared_ = 0;
  ExclusiveInliers exclusive_;  // of 0 and of here
};

// Whether each 2D-3D match is a depth of an explained 2D-2D match of the dominant reference: then its
// point lies on that match's ray.
std::vector<bool> OwnDepths(const NormalizedProblem& problem, const Residuals& residuals,
                            int dominant, const Vector3d& center) {
  std::vector<std::vector<Vector3d>> rays(problem.num_keypoints);
  for (size_t i = 0; i < problem.matches_2d2d.size(); ++i) {
    const NormalizedMatch2D2D& match = problem.matches_2d2d[i];
    const bool is_explained = match.camera_reference == dominant && residuals.of_2d2d[i] < 1;
    if (is_explained) rays[match.keypoint].push_back(match.reference_ray);
  }
  std::vector<bool> own;
  for (const NormalizedMatch2D3D& match : problem.matches_2d3d) {
    const Vector3d to_point = (match.point - center).normalized();
    constexpr double kOnRay = 1e-5;  // radians, well below a pixel
    const std::vector<Vector3d>& of_keypoint = rays[match.keypoint];
    own.push_back(std::any_of(of_keypoint.begin(), of_keypoint.end(), [&](const Vector3d& ray) {
      return to_point.cross(ray).norm() < kOnRay;
    }));
  }
  return own;
}

// The probability that both are right if they are independent witnesses, and agree.
double OddsOfBoth(double a, double b) {
  constexpr double kLeast = 1e-12;
  const auto odds = [&](double p) {
    p = std::clamp(p, kLeast, 1 - kLeast);
    return p / (1 - p);
  };
  const double both = odds(a) * odds(b);
  return both / (1 + both);
}

}  // namespace

double SceneDistance(const NormalizedProblem& problem, const CamFromLocal& pose, MatchSets sets) {
  const Residuals residuals = ComputeResiduals(problem, pose, sets);
  std::vector<double> distances;
  for (size_t i = 0; i < residuals.of_2d3d.size(); ++i) {
    if (!(residuals.of_2d3d[i] < 1)) continue;
    const NormalizedMatch2D3D& match = problem.matches_2d3d[i];
    distances.push_back((match.point - CenterOfCamera(problem, pose, match.camera)).norm());
  }
  for (size_t i = 0; i < residuals.of_2d2d.size(); ++i) {
    if (!(residuals.of_2d2d[i] < 1)) continue;
    const double distance = TriangulatedDistance(problem, pose, problem.matches_2d2d[i]);
    if (std::isfinite(distance)) distances.push_back(distance);
  }
  return UpperMedianOr(std::move(distances), 1);
}

double ProbabilityOfDistance(const NormalizedProblem& problem, const CamFromLocal& pose,
                             MatchSets sets, double scene_distance, double depth_sigma,
                             double clustering) {
  const Residuals residuals = ComputeResiduals(problem, pose);
  const std::optional<int> dominant = DominantReference(problem, residuals);
  if (!dominant) return 1;
  const Vector3d& reference =
      problem.centers[static_cast<size_t>(*dominant) % problem.centers.size()];
  const Vector3d offset = CenterOfCamera(problem, pose, problem.CameraOf(*dominant)) - reference;
  const double length = offset.norm();
  if (!(length > 0)) return 1;

  const CameraOnLine camera(problem, pose, offset / length);
  // What a match tells of the distance is worth something if it is within a factor of two of the
  // distance, or of a fourth of the way to the scene.
  const double longest = std::max(length, 0.5 * scene_distance);
  std::vector<Interval> by_others, by_own_depths;
  const auto add = [&](const auto& match, std::vector<Interval>& to) {
    const std::optional<Interval> interval = camera.InlierInterval(match);
    if (interval && interval->end - interval->begin < longest) to.push_back(*interval);
  };
  for (const NormalizedMatch2D2D& match : problem.matches_2d2d) {
    if (match.camera_reference != *dominant) add(match, by_others);
  }
  double num_own_depths = 0, agreeing = 0;  // of explained 2D-2D matches
  if (Has2D3D(sets)) {
    const std::vector<bool> own = OwnDepths(problem, residuals, *dominant, reference);
    for (size_t i = 0; i < own.size(); ++i) {
      num_own_depths += own[i] ? 1 : 0;
      agreeing += own[i] && residuals.of_2d3d[i] < 1 ? 1 : 0;
      add(problem.matches_2d3d[i], own[i] ? by_own_depths : by_others);
    }
  }
  const auto probability = [&](const std::vector<Interval>& intervals) {
    return PlacesOnLine(intervals, problem.num_keypoints).ProbabilityOfZero(clustering);
  };
  // The scale of one reference's depths is as uncertain as one error of a depth tells: by Cauchy's
  // distribution, which is Student's t with one degree of freedom. Depths that agree with the place
  // and those that do not are two witnesses of it. So they are no surer for the place than their
  // scale is, and where it is off they say nothing.
  const double scale_holds = std::min(
      2 / std::numbers::pi * std::atan2(kRightPosition * scene_distance, depth_sigma * length),
      num_own_depths > 0 ? ProbabilityOfLarger(agreeing, num_own_depths - agreeing) : 1);
  const double by_depths = probability(by_own_depths);
  const double own = by_depths > 0.5 ? std::min(by_depths, std::max(0.5, scale_holds))
                                     : 0.5 + scale_holds * (by_depths - 0.5);
  return OddsOfBoth(probability(by_others), own);
}

double ProbabilityOfPosition(double position_sigma, double scene_distance) {
  if (!(position_sigma > 0)) return 0;
  return std::erf(kRightPosition * scene_distance / (position_sigma * std::numbers::sqrt2));
}

}  // namespace raylift
