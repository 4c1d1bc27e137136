#include "estimation/support.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <set>
#include <span>

#include "base/statistics.h"
#include "estimation/image_parts.h"
#include "estimation/rival_search.h"

#include "raylift/estimation/pose_estimator.h"

namespace raylift {
namespace {

// Keypoints in one of 16 x 16 parts of the image are neighbors.
constexpr int kPlacesPerSide = 16;

// 2D-2D matches of a sample of E5+1.
constexpr double kPairsOfSample = 6;

// Wrong matches are counted between so many thresholds, where even inaccurate right ones are rare.
constexpr double kInnerRing = 5;
constexpr double kOuterRing = 15;

// One kind of matches, by keypoint.
struct Kind {
  std::vector<int> matches;  // of each keypoint
  std::vector<bool> inlier;
  double chance = 0;  // that a wrong match is an inlier

  explicit Kind(size_t keypoints) : matches(keypoints, 0), inlier(keypoints, false) {}

  // That none of a keypoint's matches is an inlier, if all are wrong.
  double ChanceOfNone(size_t keypoint) const { return std::pow(1 - chance, matches[keypoint]); }
};

// The number of wrong residuals grows with their limit's `dimensions`th power.
template <typename PreparedMatch>
Kind Count(std::span<const double> squared, const std::vector<PreparedMatch>& matches,
           size_t keypoints, double uniform_chance, int dimensions) {
  Kind kind(keypoints);
  int in_ring = 0;
  for (size_t i = 0; i < squared.size(); ++i) {
    ++kind.matches[matches[i].keypoint];
    if (squared[i] < 1) kind.inlier[matches[i].keypoint] = true;
    in_ring += squared[i] > kInnerRing * kInnerRing && squared[i] < kOuterRing * kOuterRing ? 1 : 0;
  }
  const double ring = std::pow(kOuterRing, dimensions) - std::pow(kInnerRing, dimensions);
  const double observed =
      squared.empty() ? 0 : in_ring / ring / static_cast<double>(squared.size());
  kind.chance = std::clamp(std::max(uniform_chance, observed), 1e-9, 1.0);
  return kind;
}

// The expected number of false alarms by one kind, as a logarithm: of `trials` keypoints beyond
// those of the sample, so many are inliers.
struct Trials {
  double trials = 0, inliers = 0, chance_sum = 0;

  void Add(const Kind& kind, size_t keypoint) {
    if (kind.matches[keypoint] == 0) return;
    trials += 1;
    inliers += kind.inlier[keypoint] ? 1 : 0;
    chance_sum += 1 - kind.ChanceOfNone(keypoint);
  }

  // Hoeffding's bound of the binomial tail. `sample` keypoints fit by construction.
  double LogTail(double sample, double clustering) const {
    const double n = (trials - sample) / clustering;
    const double k = (inliers - sample) / clustering;
    if (!(n > 0) || !(k > 0)) return 0;
    const double p = chance_sum / trials;
    const double share = std::min(k / n, 1.0);
    if (share <= p) return 0;
    const double miss = share < 1 ? (1 - share) * std::log((1 - share) / (1 - p)) : 0;
    return -n * (share * std::log(share / p) + miss);
  }
};

}  // namespace

SupportAssessor::SupportAssessor(const PoseProblem& original, const PreparedProblem& problem,
                                 ResidualKinds kinds, double num_poses_tried, int points_of_sample)
    : problem_(problem),
      kinds_(kinds),
      num_poses_tried_(num_poses_tried),
      points_of_sample_(points_of_sample),
      area_px2_(QueryAreaPx2(original)) {
  place_.assign(problem.num_keypoints, 0);
  const auto place = [&](const auto& match) {
    return PartOfImages(original, match, kPlacesPerSide);
  };
  for (const PreparedPoint& point : problem.points) {
    place_[point.keypoint] = place(original.matches_2d3d[static_cast<size_t>(point.match)]);
  }
  for (const PreparedPair& pair : problem.pairs) {
    place_[pair.keypoint] = place(original.matches_2d2d[static_cast<size_t>(pair.match)]);
  }
}

double SupportAssessor::PointWidening(const SolverPose& pose) const {
  double sum = 0;
  for (const PreparedPoint& point : problem_.points) {
    const double depth = point.image_from_ray.row(2).dot(
        pose.rotation * point.point + problem_.PoseOfCamera(pose, point.camera).translation);
    sum += 1 + (depth > 0 ? point.spread / (depth * depth) : 0);
  }
  return problem_.points.empty() ? 1 : sum / static_cast<double>(problem_.points.size());
}

double SupportAssessor::PairWidening() const {
  double sum = 0;
  for (const PreparedPair& pair : problem_.pairs) {
    sum += SpreadOfReference(pair.reference_sigma_px, problem_.sampson_threshold_px);
  }
  return problem_.pairs.empty() ? 1 : sum / static_cast<double>(problem_.pairs.size());
}

Support SupportAssessor::Of(const SolverPose& pose) const {
  const Residuals residuals = ComputeResiduals(problem_, pose);
  const double point_threshold = problem_.reprojection_threshold_px;
  // The Sampson error is the distance from the epipolar line over the square root of two.
  const double pair_threshold = std::numbers::sqrt2 * problem_.sampson_threshold_px;
  const double inlier_area = std::numbers::pi * point_threshold * point_threshold;
  const Kind points = Count(residuals.points, problem_.points, problem_.num_keypoints,
                            PointWidening(pose) * inlier_area / area_px2_, 2);
  const Kind pairs = Count(residuals.pairs, problem_.pairs, problem_.num_keypoints,
                           PairWidening() * 2 * pair_threshold / std::sqrt(area_px2_), 1);

  Support support;
  support.inlier.assign(problem_.num_keypoints, false);
  std::set<int> places;
  for (size_t k = 0; k < problem_.num_keypoints; ++k) {
    const bool matched =
        (kinds_.points && points.matches[k] > 0) || (kinds_.pairs && pairs.matches[k] > 0);
    if (!matched) continue;
    ++support.keypoints;
    const double miss =
        (kinds_.points ? points.ChanceOfNone(k) : 1) * (kinds_.pairs ? pairs.ChanceOfNone(k) : 1);
    support.chance += 1 - miss;
    support.inlier[k] = (kinds_.points && points.inlier[k]) || (kinds_.pairs && pairs.inlier[k]);
    if (!support.inlier[k]) continue;
    ++support.inlier_keypoints;
    places.insert(place_[k]);
  }
  support.chance /= std::max(1, support.keypoints);
  if (!places.empty()) {
    support.clustering =
        static_cast<double>(support.inlier_keypoints) / static_cast<double>(places.size());
  }

  // A keypoint's point is lifted from its pair, so it may speak for one kind only: for points where
  // it has one, or for pairs where it has one; the stronger of the two counts.
  Trials by_points, rest_of_points, by_pairs, rest_of_pairs;
  for (size_t k = 0; k < problem_.num_keypoints; ++k) {
    by_points.Add(points, k);
    by_pairs.Add(pairs, k);
    if (points.matches[k] == 0) rest_of_points.Add(pairs, k);
    if (pairs.matches[k] == 0) rest_of_pairs.Add(points, k);
  }
  double tail = 0;
  if (kinds_.points) {
    const double rest = kinds_.pairs ? rest_of_points.LogTail(0, support.clustering) : 0;
    tail = std::min(tail, by_points.LogTail(points_of_sample_, support.clustering) + rest);
  }
  if (kinds_.pairs) {
    const double rest = kinds_.points ? rest_of_pairs.LogTail(0, support.clustering) : 0;
    tail = std::min(tail, by_pairs.LogTail(kPairsOfSample, support.clustering) + rest);
  }
  support.log_false_alarms = std::log(2 * std::max(1.0, num_poses_tried_)) + tail;
  return support;
}

bool ExplainTheSame(const Support& a, const Support& b) {
  int shared = 0;
  for (size_t k = 0; k < a.inlier.size(); ++k) shared += a.inlier[k] && b.inlier[k] ? 1 : 0;
  return 2 * shared > std::min(a.inlier_keypoints, b.inlier_keypoints);
}

namespace {

// The keypoints that one of two answers alone explains.
struct Opinions {
  double only_first = 0, only_second = 0;

  Opinions(const std::vector<bool>& first, const std::vector<bool>& second) {
    for (size_t k = 0; k < first.size(); ++k) {
      only_first += first[k] && !second[k] ? 1 : 0;
      only_second += second[k] && !first[k] ? 1 : 0;
    }
  }

  // That the first is right if one of them is, where each keypoint speaks for itself; none where
  // there is none.
  std::optional<double> ProbabilityOfFirst(double clustering) const {
    const double all = (only_first + only_second) / clustering;
    if (!(all > 0)) return std::nullopt;
    const double z = (only_first - only_second) / clustering / std::sqrt(all);
    return 0.5 * std::erfc(-z / std::numbers::sqrt2);
  }
};

}  // namespace

bool SupportAssessor::IsBeyondChance(const Support& best, const Support& rival) const {
  const Opinions opinions(best.inlier, rival.inlier);
  const double left = best.keypoints - best.inlier_keypoints;
  const Trials trials = {
      .trials = left, .inliers = opinions.only_second, .chance_sum = rival.chance * left};
  const double sample = kinds_.points ? points_of_sample_ : kPairsOfSample;
  const double tried = std::max(num_poses_tried_, 2.0 * kRivalSamples);
  return std::log(tried) + trials.LogTail(sample, rival.clustering) <
         std::log(1 - kLocalizedConfidence);
}

namespace {

// Of two sets of keypoints beyond chance, the first is what is right.
double ProbabilityOfLarger(double first, double second) {
  return first * first / (first * first + second * second);
}

}  // namespace

bool Support::LeavesRoomForARival() const {
  return inlier_keypoints > 0 &&
         ProbabilityOfLarger(inlier_keypoints, keypoints - inlier_keypoints) < kLocalizedConfidence;
}

double ProbabilityOverRival(const Support& best, const Support& rival, bool beyond_chance,
                            double log_odds) {
  const Opinions opinions(best.inlier, rival.inlier);
  auto probability = opinions.ProbabilityOfFirst(std::max(best.clustering, rival.clustering));
  if (!probability) return 1;  // they explain the same
  if (beyond_chance) {
    probability =
        std::min(*probability, ProbabilityOfLarger(opinions.only_first, opinions.only_second));
  }
  const double against = 1 - *probability;
  return *probability / (*probability + against * std::exp(-log_odds));
}

std::vector<PreparedPair> SupportAssessor::InlierPairs(const SolverPose& pose) const {
  const Residuals residuals = ComputeResiduals(problem_, pose, {.points = false, .pairs = true});
  std::vector<PreparedPair> inliers;
  for (size_t i = 0; i < problem_.pairs.size(); ++i) {
    if (residuals.pairs[i] < 1) inliers.push_back(problem_.pairs[i]);
  }
  return inliers;
}

double SupportAssessor::ProbabilityOfDistance(const SolverPose& pose,
                                              const Support& support) const {
  // Local units are the references' spread.
  constexpr double kLeastMove = 0.25;
  if (problem_.centers.empty()) return 1;
  const std::vector<PreparedPair> inliers = InlierPairs(pose);
  std::vector<int> counts(problem_.num_views(), 0);
  for (const PreparedPair& pair : inliers) ++counts[static_cast<size_t>(pair.view)];
  const auto most =
      static_cast<int>(std::max_element(counts.begin(), counts.end()) - counts.begin());
  const auto explained_by_others = [&](const std::vector<PreparedPair>& pairs) {
    std::vector<bool> explained(problem_.num_keypoints, false);
    for (const PreparedPair& pair : pairs) {
      if (pair.view != most) explained[pair.keypoint] = true;
    }
    return explained;
  };
  const size_t reference = static_cast<size_t>(most) % problem_.centers.size();
  const Eigen::Vector3d& from = problem_.centers[reference];
  const Eigen::Vector3d& camera_center =
      problem_.camera_centers[static_cast<size_t>(problem_.CameraOf(most))];
  const Eigen::Vector3d offset =
      pose.rotation.transpose() * (camera_center - pose.translation) - from;
  const std::vector<bool> explained = explained_by_others(inliers);
  double probability = 1;
  for (const double factor : {0.25, 0.5, 2.0, 4.0}) {
    if (std::abs(factor - 1) * offset.norm() < kLeastMove) continue;
    SolverPose moved = pose;
    moved.translation = camera_center - pose.rotation * (from + factor * offset);
    // Where both explain the same there is nothing to choose by.
    probability = std::min(probability, Opinions(explained, explained_by_others(InlierPairs(moved)))
                                            .ProbabilityOfFirst(support.clustering)
                                            .value_or(0.5));
  }
  return probability;
}

double SupportAssessor::ProbabilityOfPosition(const SolverPose& pose, double position_sigma) const {
  if (!(position_sigma > 0)) return 1;
  const Eigen::Vector3d center = -pose.rotation.transpose() * pose.translation;
  const Residuals residuals = ComputeResiduals(problem_, pose, {.points = true, .pairs = false});
  std::vector<double> distances;
  for (size_t i = 0; i < problem_.points.size(); ++i) {
    if (residuals.points[i] < 1) distances.push_back((problem_.points[i].point - center).norm());
  }
  // Local coordinates are centered on the references, their unit is the references' spread.
  const double reach = std::max({1.0, center.norm(), UpperMedianOr(std::move(distances), 0)});
  return std::erf(reach / (position_sigma * std::numbers::sqrt2));
}

}  // namespace raylift
