#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <set>
#include <span>

#include "base/statistics.h"
#include "estimation/confidence/confidence.h"
#include "estimation/problem/observations.h"

#include "raylift/estimation/pose_estimator.h"

namespace raylift {
namespace {

// Keypoints in one of 16 x 16 parts of the image are neighbors.
constexpr int kNeighborCellsPerSide = 16;

// A sample of E5+1 has so many 2D-2D matches.
constexpr double kSample2D2D = 6;

// Wrong matches are counted in the ring between these radii, in thresholds.
constexpr double kInnerRing = 5;
constexpr double kOuterRing = 15;

// The inliers of one match set, by keypoint.
struct SetInliers {
  std::vector<int> matches;  // of each keypoint
  std::vector<bool> inlier;
  double chance = 0;                   // that a wrong match is an inlier
  std::vector<double> chance_of_none;  // of so many wrong matches

  explicit SetInliers(size_t keypoints) : matches(keypoints, 0), inlier(keypoints, false) {}

  // Returns the probability that no match of a keypoint is an inlier, if all are wrong.
  double ChanceOfNone(size_t keypoint) const {
    return chance_of_none[static_cast<size_t>(matches[keypoint])];
  }
};

template <typename NormalizedMatch>
SetInliers Count(std::span<const double> squared, const std::vector<NormalizedMatch>& matches,
                 size_t keypoints, double uniform_chance, int dimensions) {
  SetInliers set(keypoints);
  int in_ring = 0;
  for (size_t i = 0; i < squared.size(); ++i) {
    ++set.matches[matches[i].keypoint];
    if (squared[i] < 1) set.inlier[matches[i].keypoint] = true;
    in_ring += IsInRing(squared[i]) ? 1 : 0;
  }
  const double observed =
      squared.empty() ? 0
                      : in_ring / RingPerInlier(dimensions) / static_cast<double>(squared.size());
  set.chance = std::clamp(std::max(uniform_chance, observed), 1e-9, 1.0);
  const int most = keypoints == 0 ? 0 : *std::max_element(set.matches.begin(), set.matches.end());
  for (int n = 0; n <= most; ++n) set.chance_of_none.push_back(std::pow(1 - set.chance, n));
  return set;
}

// The keypoints of one match set as trials: their number, that of the inliers among them, and the
// sum of the probabilities that a keypoint with wrong matches alone is an inlier.
struct Trials {
  double trials = 0, inliers = 0, chance_sum = 0;

  void Add(const SetInliers& set, size_t keypoint) {
    if (set.matches[keypoint] == 0) return;
    trials += 1;
    inliers += set.inlier[keypoint] ? 1 : 0;
    chance_sum += 1 - set.ChanceOfNone(keypoint);
  }

  // Returns LogBinomialTail() of the keypoints beyond the `sample` that fits by construction.
  double LogTail(double sample, double clustering) const {
    return LogBinomialTail((trials - sample) / clustering, (inliers - sample) / clustering,
                           trials > 0 ? chance_sum / trials : 0);
  }
};

}  // namespace

bool IsInRing(double squared) {
  return squared > kInnerRing * kInnerRing && squared < kOuterRing * kOuterRing;
}

double RingPerInlier(int dimensions) {
  return std::pow(kOuterRing, dimensions) - std::pow(kInnerRing, dimensions);
}

double LogBinomialTail(double trials, double successes, double chance) {
  if (!(trials > 0) || !(successes > 0)) return 0;
  const double share = std::min(successes / trials, 1.0);
  if (share <= chance) return 0;
  const double miss = share < 1 ? (1 - share) * std::log((1 - share) / (1 - chance)) : 0;
  return -trials * (share * std::log(share / chance) + miss);
}

InlierAssessor::InlierAssessor(const PoseProblem& original, const NormalizedProblem& problem,
                               MatchSets sets, double num_poses_tried, int sample_2d3d)
    : original_(original),
      problem_(problem),
      sets_(sets),
      num_poses_tried_(num_poses_tried),
      sample_2d3d_(sample_2d3d),
      area_px2_(MatchedAreaPx2(original)) {
  cell_.assign(problem.num_keypoints, 0);
  camera_.assign(problem.num_keypoints, 0);
  pixel_.assign(problem.num_keypoints, Eigen::Vector2d::Zero());
  const auto place = [&](size_t keypoint, const auto& match) {
    cell_[keypoint] = QueryImageCell(original, match, kNeighborCellsPerSide);
    camera_[keypoint] = match.camera;
    pixel_[keypoint] = match.query_px;
  };
  for (const NormalizedMatch2D3D& point : problem.matches_2d3d) {
    place(point.keypoint, original.matches_2d3d[static_cast<size_t>(point.match)]);
  }
  for (const NormalizedMatch2D2D& pair : problem.matches_2d2d) {
    place(pair.keypoint, original.matches_2d2d[static_cast<size_t>(pair.match)]);
  }
}

size_t InlierAssessor::KeypointOf(size_t match) const {
  const size_t num_2d3d = Has2D3D(sets_) ? problem_.matches_2d3d.size() : 0;
  return match < num_2d3d ? problem_.matches_2d3d[match].keypoint
                          : problem_.matches_2d2d[match - num_2d3d].keypoint;
}

double InlierAssessor::Widening2D3D(const CamFromLocal& pose) const {
  // Nothing is likelier than all of the area: not even a point beside the camera.
  const double most = std::max(
      1.0, area_px2_ / (std::numbers::pi * std::pow(problem_.reprojection_threshold_px, 2)));
  double sum = 0;
  for (const NormalizedMatch2D3D& point : problem_.matches_2d3d) {
    const double depth = point.image_from_ray.row(2).dot(
        pose.rotation * point.point + problem_.PoseOfCamera(pose, point.camera).translation);
    sum += depth > 0 ? std::min(1 + point.variance_at_unit_depth / (depth * depth), most) : 1;
  }
  return problem_.matches_2d3d.empty() ? 1
                                       : sum / static_cast<double>(problem_.matches_2d3d.size());
}

double InlierAssessor::Widening2D2D() const {
  double sum = 0;
  for (const NormalizedMatch2D2D& pair : problem_.matches_2d2d) {
    sum += ReferenceSigmaFactor(pair.reference_sigma_px, problem_.sampson_threshold_px);
  }
  return problem_.matches_2d2d.empty() ? 1
                                       : sum / static_cast<double>(problem_.matches_2d2d.size());
}

InlierEvidence InlierAssessor::Assess(const CamFromLocal& pose) const {
  const Residuals residuals = ComputeResiduals(problem_, pose);
  const double threshold_2d3d = problem_.reprojection_threshold_px;
  // The Sampson error is the distance from the epipolar line over the square root of two.
  const double threshold_2d2d = std::numbers::sqrt2 * problem_.sampson_threshold_px;
  const double inlier_area = std::numbers::pi * threshold_2d3d * threshold_2d3d;
  const SetInliers of_2d3d = Count(residuals.of_2d3d, problem_.matches_2d3d, problem_.num_keypoints,
                                   Widening2D3D(pose) * inlier_area / area_px2_, 2);
  const SetInliers of_2d2d = Count(residuals.of_2d2d, problem_.matches_2d2d, problem_.num_keypoints,
                                   Widening2D2D() * 2 * threshold_2d2d / std::sqrt(area_px2_), 1);

  InlierEvidence evidence;
  evidence.pose = pose;
  if (Has2D3D(sets_)) {
    for (const double squared : residuals.of_2d3d) evidence.inlier.push_back(squared < 1);
  }
  if (Has2D2D(sets_)) {
    for (const double squared : residuals.of_2d2d) evidence.inlier.push_back(squared < 1);
  }
  std::set<int> cells;
  for (size_t k = 0; k < problem_.num_keypoints; ++k) {
    const bool matched =
        (Has2D3D(sets_) && of_2d3d.matches[k] > 0) || (Has2D2D(sets_) && of_2d2d.matches[k] > 0);
    if (!matched) continue;
    ++evidence.keypoints;
    const double miss = (Has2D3D(sets_) ? of_2d3d.ChanceOfNone(k) : 1) *
                        (Has2D2D(sets_) ? of_2d2d.ChanceOfNone(k) : 1);
    evidence.chance += 1 - miss;
    const bool is_inlier =
        (Has2D3D(sets_) && of_2d3d.inlier[k]) || (Has2D2D(sets_) && of_2d2d.inlier[k]);
    if (!is_inlier) continue;
    ++evidence.inlier_keypoints;
    cells.insert(cell_[k]);
  }
  evidence.chance /= std::max(1, evidence.keypoints);
  double wrong_2d2d = 0;
  for (size_t k = 0; k < problem_.num_keypoints; ++k) {
    if (of_2d3d.matches[k] == 0) continue;
    wrong_2d2d += 1 - of_2d2d.ChanceOfNone(k);
    if (!of_2d2d.inlier[k]) continue;
    ++evidence.paired;
    evidence.paired_agreeing += of_2d3d.inlier[k] ? 1 : 0;
  }
  evidence.paired_right = std::max(0.0, evidence.paired - wrong_2d2d);
  evidence.line_chance =
      std::min(1.0, std::sqrt(Widening2D3D(pose)) * 2 * threshold_2d3d / std::sqrt(area_px2_));
  if (!cells.empty()) {
    evidence.clustering =
        static_cast<double>(evidence.inlier_keypoints) / static_cast<double>(cells.size());
  }

  // A keypoint's point is lifted from its 2D-2D match, so a keypoint speaks by one match set only:
  // by its 2D-3D matches where it has some, or by its 2D-2D matches; the stronger of the two
  // counts.
  Trials by_2d3d, rest_of_2d3d, by_2d2d, rest_of_2d2d;
  for (size_t k = 0; k < problem_.num_keypoints; ++k) {
    by_2d3d.Add(of_2d3d, k);
    by_2d2d.Add(of_2d2d, k);
    if (of_2d3d.matches[k] == 0) rest_of_2d3d.Add(of_2d2d, k);
    if (of_2d2d.matches[k] == 0) rest_of_2d2d.Add(of_2d3d, k);
  }
  // The sample, of one set, fits by construction. If that set has fewer inliers, the pose is not of
  // such a sample, and what fits it is no evidence beside one.
  const bool both = sets_ == MatchSets::kBoth;
  const auto tail_of = [&](const Trials& set, double sample, const Trials& rest) {
    if (set.inliers < sample) return 0.0;
    return set.LogTail(sample, evidence.clustering) +
           (both ? rest.LogTail(0, evidence.clustering) : 0);
  };
  double tail = 0;
  if (Has2D3D(sets_)) tail = std::min(tail, tail_of(by_2d3d, sample_2d3d_, rest_of_2d3d));
  if (Has2D2D(sets_)) tail = std::min(tail, tail_of(by_2d2d, kSample2D2D, rest_of_2d2d));
  evidence.log_false_alarms = std::log(2 * std::max(1.0, num_poses_tried_)) + tail;
  return evidence;
}

std::optional<ExclusiveInliers> InlierAssessor::Compare(const InlierEvidence& first,
                                                        const InlierEvidence& second) const {
  int shared = 0;
  std::vector<int> more_of_first(problem_.num_keypoints, 0);
  std::vector<bool> left(problem_.num_keypoints, false);
  for (size_t i = 0; i < first.inlier.size(); ++i) {
    shared += first.inlier[i] && second.inlier[i] ? 1 : 0;
    if (!first.inlier[i]) left[KeypointOf(i)] = true;
    more_of_first[KeypointOf(i)] += (first.inlier[i] ? 1 : 0) - (second.inlier[i] ? 1 : 0);
  }
  const auto inliers_of = [](const InlierEvidence& evidence) {
    return std::count(evidence.inlier.begin(), evidence.inlier.end(), true);
  };
  if (2 * shared > std::min(inliers_of(first), inliers_of(second))) return std::nullopt;
  ExclusiveInliers exclusive;
  if (const auto as_places = CompareAsPlaces(first, second)) {
    exclusive = *as_places;
  } else {
    for (const int more : more_of_first) {
      exclusive.only_first += more > 0 ? 1 : 0;
      exclusive.only_second += more < 0 ? 1 : 0;
    }
  }
  exclusive.left = static_cast<double>(std::count(left.begin(), left.end(), true));
  return exclusive;
}

bool InlierAssessor::IsBeyondChance(const InlierEvidence& alternative,
                                    const ExclusiveInliers& exclusive) const {
  const Trials trials = {.trials = exclusive.left,
                         .inliers = exclusive.only_second,
                         .chance_sum = alternative.chance * exclusive.left};
  const double sample = Has2D3D(sets_) ? sample_2d3d_ : kSample2D2D;
  const double tried = std::max(num_poses_tried_, 2.0 * kAlternativeSamples);
  return std::log(tried) + trials.LogTail(sample, alternative.clustering) <
         std::log(1 - kLocalizedConfidence);
}

bool InlierAssessor::PointsDisagree(const InlierEvidence& evidence) const {
  if (!Has2D3D(sets_) || evidence.paired == 0) return false;
  const double within = 1 - std::exp(-0.5 * kSigmasOfThreshold * kSigmasOfThreshold);
  const double expected = within * evidence.paired_right / evidence.paired;
  const double count = evidence.paired / evidence.clustering;
  const double agreeing = evidence.paired_agreeing / evidence.clustering;
  const double log_significance = std::log(1 - kLocalizedConfidence);
  const bool as_by_chance =
      LogBinomialTail(count, agreeing, evidence.line_chance) > log_significance;
  return as_by_chance && LogBinomialTail(count, count - agreeing, 1 - expected) < log_significance;
}

double InlierAssessor::ShareNearInliers(const InlierEvidence& evidence) const {
  std::vector<bool> matched(problem_.num_keypoints, false), inlier(problem_.num_keypoints, false);
  for (size_t i = 0; i < evidence.inlier.size(); ++i) {
    matched[KeypointOf(i)] = true;
    if (evidence.inlier[i]) inlier[KeypointOf(i)] = true;
  }
  std::vector<double> x, y;
  std::optional<int> camera;
  for (size_t k = 0; k < inlier.size(); ++k) {
    if (!inlier[k]) continue;
    if (camera && camera_[k] != *camera) return 1;  // two photographs are two places
    camera = camera_[k];
    x.push_back(pixel_[k].x());
    y.push_back(pixel_[k].y());
  }
  if (x.empty()) return 1;
  const Eigen::Vector2d middle(UpperMedianOr(std::move(x), 0), UpperMedianOr(std::move(y), 0));
  std::vector<double> distances, of_inliers;
  for (size_t k = 0; k < matched.size(); ++k) {
    if (!matched[k]) continue;
    distances.push_back(camera_[k] == *camera ? (pixel_[k] - middle).norm()
                                              : std::numeric_limits<double>::infinity());
    if (inlier[k]) of_inliers.push_back(distances.back());
  }
  constexpr double kShare = 2.0 / 3;
  const double radius = QuantileInPlace(std::span(of_inliers), kShare);
  const auto near = std::count_if(distances.begin(), distances.end(),
                                  [&](double distance) { return distance <= radius; });
  return static_cast<double>(near) / static_cast<double>(distances.size()) / kShare;
}

}  // namespace raylift
