#include "estimation/problem/observations.h"

#include <algorithm>
#include <cmath>
#include <span>
#include <utility>

#include <Eigen/LU>

namespace raylift {
namespace {

// A lifted point lies on the ray of its pixel but for rounding: within so many pixels.
constexpr double kOnRayPx = 0.02;

Eigen::Matrix3d ImageFromRay(const Eigen::Vector3d& ray,
                             const Eigen::Matrix<double, 3, 2>& gradient, double threshold_px) {
  Eigen::Matrix3d ray_from_image;
  ray_from_image << gradient / threshold_px, ray;
  return ray_from_image.inverse();
}

// Gathers the evidence, keypoint by keypoint.
class Gathering {
 public:
  Gathering(const PoseProblem& original, const NormalizedProblem& problem)
      : original_(original),
        problem_(problem),
        observation_of_match_(original.matches_2d2d.size(), -1) {
    evidence_.matched_area_px2 = MatchedAreaPx2(original);
    evidence_.num_image_cells *= original.num_cameras();
    evidence_.focal_px = original.query_camera.MeanFocalPx();
    evidence_.centers = problem.centers;
    evidence_.observations.reserve(problem.matches_2d2d.size());
  }

  // Adds a keypoint with the indices of its 2D-2D and its 2D-3D matches, which it sorts.
  void Add(std::span<const int> of_2d2d, std::span<int> of_2d3d) {
    KeypointObservations keypoint;
    keypoint.first_observation = static_cast<int>(evidence_.observations.size());
    for (const int i : of_2d2d) Observe(problem_.matches_2d2d[i], keypoint.first_observation);
    keypoint.end_observation = static_cast<int>(evidence_.observations.size());
    keypoint.first_unanchored = static_cast<int>(evidence_.unanchored.size());
    // Points are added in the order of the matches: of several on one ray the first is taken.
    std::sort(of_2d3d.begin(), of_2d3d.end(), [&](int a, int b) {
      return problem_.matches_2d3d[a].match < problem_.matches_2d3d[b].match;
    });
    for (auto i = of_2d3d.begin(); i != of_2d3d.end(); ++i) {
      const NormalizedMatch2D3D& match = problem_.matches_2d3d[*i];
      // A 3D point that several references have counts once.
      const bool is_known = std::any_of(of_2d3d.begin(), i, [&](int other) {
        return problem_.matches_2d3d[other].point == match.point;
      });
      if (!is_known) AddPoint(match, keypoint);
    }
    keypoint.end_unanchored = static_cast<int>(evidence_.unanchored.size());
    if (of_2d2d.empty()) {
      const NormalizedMatch2D3D& match = problem_.matches_2d3d[of_2d3d.front()];
      SeeInQuery(original_.matches_2d3d[static_cast<size_t>(match.match)], keypoint);
      keypoint.image_from_cam = match.image_from_ray;
      keypoint.image_from_cam.topRows<2>() *= problem_.reprojection_threshold_px;
    } else {
      const NormalizedMatch2D2D& match = problem_.matches_2d2d[of_2d2d.front()];
      SeeInQuery(original_.matches_2d2d[static_cast<size_t>(match.match)], keypoint);
      keypoint.image_from_cam =
          ImageFromRay(match.query_ray, match.query_gradient, problem_.sampson_threshold_px);
    }
    evidence_.keypoints.push_back(keypoint);
  }

  KeypointEvidence Finish() {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const UnanchoredPoint& point : evidence_.unanchored) sum += point.point;
    evidence_.centers.push_back(sum /
                                std::max(1.0, static_cast<double>(evidence_.unanchored.size())));
    return std::move(evidence_);
  }

 private:
  // Adds what a 2D-2D match shows, unless it was given before.
  void Observe(const NormalizedMatch2D2D& match, int first_of_keypoint) {
    const auto same = std::find_if(evidence_.observations.begin() + first_of_keypoint,
                                   evidence_.observations.end(), [&](const Observation& other) {
                                     return other.reference == match.reference &&
                                            other.ray == match.reference_ray;
                                   });
    observation_of_match_[static_cast<size_t>(match.match)] =
        static_cast<int>(same - evidence_.observations.begin());
    if (same != evidence_.observations.end()) return;
    evidence_.observations.push_back(
        {.image_from_ray = ImageFromRay(match.reference_ray, match.reference_gradient,
                                        std::hypot(problem_.sampson_threshold_px,
                                                   kSigmasOfThreshold * match.reference_sigma_px)),
         .center = problem_.centers[match.reference],
         .ray = match.reference_ray,
         .extra_variance_px2 = match.reference_sigma_px * match.reference_sigma_px,
         .log_distance = 0,
         .depth_variance = 0,
         .reference = match.reference,
         .has_depth = false});
  }

  // Makes a point the depth of the observation on whose ray it lies, or adds it unanchored.
  void AddPoint(const NormalizedMatch2D3D& match, const KeypointObservations& keypoint) {
    Observation* observation = FindObservation(match, keypoint);
    if (!observation) {
      evidence_.unanchored.push_back({match.point, match.sigma * match.sigma});
    } else if (!observation->has_depth) {
      observation->has_depth = true;
      const double distance = (match.point - observation->center).norm();
      const double learned = LearnedDepthSigma(original_, match);
      observation->log_distance = std::log(distance);
      observation->depth_variance =
          match.sigma * match.sigma / (distance * distance) + learned * learned;
    }
  }

  // Finds the keypoint's observation that a point was lifted from, by its pair or by any on whose
  // ray it lies; null where it lies on no observation's ray.
  Observation* FindObservation(const NormalizedMatch2D3D& match,
                               const KeypointObservations& keypoint) {
    const std::optional<size_t> pair = PairOf(original_, static_cast<size_t>(match.match));
    if (pair && observation_of_match_[*pair] >= keypoint.first_observation) {
      Observation& observation = evidence_.observations[observation_of_match_[*pair]];
      if (IsShownBy(observation, match.point, kOnRayPx)) return &observation;
    }
    for (int i = keypoint.first_observation; i < keypoint.end_observation; ++i) {
      if (IsShownBy(evidence_.observations[i], match.point, kOnRayPx))
        return &evidence_.observations[i];
    }
    return nullptr;
  }

  template <typename Match>
  void SeeInQuery(const Match& match, KeypointObservations& keypoint) const {
    keypoint.camera = match.camera;
    keypoint.camera_center = problem_.camera_centers[static_cast<size_t>(match.camera)];
    keypoint.image_cell = QueryImageCell(original_, match, kImageCellsPerSide);
    keypoint.px_by_log_focal = PxByLogFocal(original_.CameraAt(match.camera), match.query_px);
  }

  const PoseProblem& original_;
  const NormalizedProblem& problem_;
  std::vector<int> observation_of_match_;  // -1: of none
  KeypointEvidence evidence_;
};

// The indices of the matches of each keypoint, in their order.
struct ByKeypoint {
  std::vector<int> indices;
  std::vector<size_t> ends;  // of each keypoint's among them

  template <typename Match>
  ByKeypoint(const std::vector<Match>& matches, size_t num_keypoints)
      : indices(matches.size()), ends(num_keypoints + 1, 0) {
    for (const Match& match : matches) ++ends[match.keypoint + 1];
    for (size_t k = 0; k < num_keypoints; ++k) ends[k + 1] += ends[k];
    for (size_t i = 0; i < matches.size(); ++i) {
      indices[ends[matches[i].keypoint]++] = static_cast<int>(i);
    }
  }
  std::span<int> Of(size_t keypoint) {
    const size_t begin = keypoint == 0 ? 0 : ends[keypoint - 1];
    return std::span(indices).subspan(begin, ends[keypoint] - begin);
  }
};

// The covariance of pixels, as their sum and squares.
struct Scatter {
  static constexpr double kLeastSidePx = 10;  // a keypoint is no narrower

  double count = 0;
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  Eigen::Matrix2d squares = Eigen::Matrix2d::Zero();

  void Add(const Eigen::Vector2d& pixel) {
    count += 1;
    sum += pixel;
    squares += pixel * pixel.transpose();
  }
  // Returns the area of the rectangle in which uniform pixels would have this covariance: the
  // square of a side is twelve times the variance along it. No side is shorter than a keypoint is
  // wide.
  double Area() const {
    if (count < 2) return kLeastSidePx * kLeastSidePx;
    Eigen::Matrix2d covariance = (squares - sum * sum.transpose() / count) / (count - 1);
    covariance.diagonal().array() += kLeastSidePx * kLeastSidePx / 12;
    return 12 * std::sqrt(std::max(0.0, covariance.determinant()));
  }
};

}  // namespace

double LearnedDepthSigma(const PoseProblem& original, const NormalizedMatch2D3D& match) {
  const double sigma =
      original.matches_2d3d[static_cast<size_t>(match.match)].log_depth_sigma.value_or(0);
  return sigma > 0 && std::isfinite(sigma * sigma) ? sigma : 0;
}

double MatchedAreaPx2(const PoseProblem& problem) {
  std::vector<Scatter> scatter(static_cast<size_t>(problem.num_cameras()));
  const auto add = [&](const auto& match) {
    if (!problem.HasCamera(match.camera) || !match.query_px.allFinite()) return;
    const Camera& camera = problem.CameraAt(match.camera);
    const Eigen::Vector2d corner(camera.width_px(), camera.height_px());
    scatter[static_cast<size_t>(match.camera)].Add(
        match.query_px.cwiseMax(Eigen::Vector2d::Zero()).cwiseMin(corner));
  };
  for (const Match2D2D& match : problem.matches_2d2d) add(match);
  for (const Match2D3D& match : problem.matches_2d3d) add(match);
  double area = 0, count = 0;
  for (int i = 0; i < problem.num_cameras(); ++i) {
    const Camera& camera = problem.CameraAt(i);
    const double image =
        static_cast<double>(camera.width_px()) * static_cast<double>(camera.height_px());
    const Scatter& matched = scatter[static_cast<size_t>(i)];
    area += matched.count * std::min(image, matched.Area());
    count += matched.count;
  }
  area = count > 0 ? area / count : 1;
  if (!problem.search_area_px2) return area;
  constexpr double kLeast = Scatter::kLeastSidePx * Scatter::kLeastSidePx;
  return std::min(area, std::max(kLeast, *problem.search_area_px2));
}

KeypointEvidence GatherEvidence(const PoseProblem& original, const NormalizedProblem& problem) {
  ByKeypoint by_2d2d(problem.matches_2d2d, problem.num_keypoints);
  ByKeypoint by_2d3d(problem.matches_2d3d, problem.num_keypoints);
  Gathering gathering(original, problem);
  for (size_t k = 0; k < problem.num_keypoints; ++k) {
    const std::span<int> of_2d2d = by_2d2d.Of(k), of_2d3d = by_2d3d.Of(k);
    if (!of_2d2d.empty() || !of_2d3d.empty()) gathering.Add(of_2d2d, of_2d3d);
  }
  return gathering.Finish();
}

}  // namespace raylift
