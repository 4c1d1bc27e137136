// Computes the probability that the matches determine the camera's position, not its orientation
// alone.

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "base/statistics.h"
#include "estimation/confidence/camera_on_line.h"
#include "estimation/confidence/confidence.h"
#include <Eigen/Geometry>

namespace raylift {
namespace {

using Eigen::Vector3d;

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

// The a-contrario model of a place on the line: each of the keypoints that have matches agrees with
// it by chance with the probability `chance`.
struct ByChance {
  double keypoints = 0;
  double chance = 1;

  // Returns log NFA, the logarithm of the expected number of places with which `agreeing` of `of`
  // keypoints agree by chance, one of which has chosen the place.
  double LogFalseAlarms(double agreeing, double of, double clustering) const {
    return std::log(std::max(keypoints, 1.0)) +
           LogBinomialTail((of - 1) / clustering, (agreeing - 1) / clustering, chance);
  }
};

// Compares the place 0 of the line, the pose's, with all others by the keypoints that agree with
// each.
class PlacesOnLine {
 public:
  // `by_chance` is given where wrong matches fall anywhere, and nullopt where they may agree by
  // what they have in common.
  PlacesOnLine(const std::vector<InlierRange>& intervals, size_t num_keypoints,
               const std::optional<ByChance>& by_chance)
      : intervals_(intervals),
        by_chance_(by_chance),
        at_zero_(num_keypoints, 0),
        here_(num_keypoints, 0) {
    for (const InlierRange& interval : intervals) {
      if (!interval.Contains(0)) continue;
      ++at_zero_[interval.keypoint];
      ++matches_at_zero_;
    }
    exclusive_.only_first = static_cast<double>(
        std::count_if(at_zero_.begin(), at_zero_.end(), [](int count) { return count > 0; }));
    speak_for_zero_ = exclusive_.only_first;
  }

  // Returns the probability that 0 is the right place, if one is: the least over all places that
  // share at most a quarter of the matches that speak for 0.
  double ProbabilityOfZero(double clustering) {
    // RANSAC's sample has chosen the place by one of the matches, which says nothing.
    if (!(exclusive_.only_first > 1)) return 0.5;
    double probability = AtLeastEven(OverChance(0, clustering));
    // The more keypoints speak for a place alone, and the fewer for 0 alone, the less probable is
    // 0.
    ExclusiveInliers worst{.only_first = std::numeric_limits<double>::infinity()};
    ForEachPlace([&](double) {
      if (4 * shared_ > matches_at_zero_) return;
      if (exclusive_.only_second <= worst.only_second &&
          exclusive_.only_first >= worst.only_first) {
        return;
      }
      const double over_place = OverPlace(exclusive_, clustering);
      if (over_place < probability && exclusive_.only_first > 1) worst = exclusive_;
      probability = std::min(probability, over_place);
    });
    return probability;
  }

  // Returns the same over all places farther off than a right one may be that are better with 95 %
  // probability, however many matches they share with 0; 1 where there is none.
  double ProbabilityOverBetter(double clustering, double right_within) {
    double probability = 1;
    ForEachPlace([&](double x) {
      if (!(std::abs(x) > right_within)) return;
      const double over_x = exclusive_.ProbabilityOfFirst(clustering).value_or(1);
      if (over_x < 1 - kLocalizedConfidence) probability = std::min(probability, over_x);
    });
    return probability;
  }

  // Returns 1 / (1 + NFA_0 (1 + 1 / NFA_x)), the probability of 0 against chance and another place;
  // 0 where no other keypoint has matches, 1 without `by_chance`.
  double OverChance(double only_second, double clustering) const {
    if (!by_chance_) return 1;
    if (by_chance_->keypoints <= 1) return 0;
    const double of_zero =
        by_chance_->LogFalseAlarms(speak_for_zero_, by_chance_->keypoints, clustering);
    const double of_other = LogFalseAlarmsOfOther(only_second, clustering);
    const double odds = std::exp(-std::max(of_zero, -700.0)) / (1 + std::exp(-of_other));
    return odds / (1 + odds);
  }

 private:
  // No witness says less than none would.
  static double AtLeastEven(double probability) { return std::max(0.5, probability); }
  double LogFalseAlarmsOfOther(double only_second, double clustering) const {
    return std::max(by_chance_->LogFalseAlarms(only_second, by_chance_->keypoints - speak_for_zero_,
                                               clustering),
                    -700.0);
  }
  // Returns the probability of 0 against another place. If the other one is beyond chance, each
  // keypoint that agrees with one of the two alone is a vote for it.
  double OverPlace(const ExclusiveInliers& exclusive, double clustering) const {
    const double over_chance = AtLeastEven(OverChance(exclusive.only_second, clustering));
    const bool may_be_chance =
        by_chance_ && LogFalseAlarmsOfOther(exclusive.only_second, clustering) >
                          std::log(1 - kLocalizedConfidence);
    if (may_be_chance) return over_chance;
    const ExclusiveInliers beyond_sample{exclusive.only_first - 1, exclusive.only_second};
    return std::min(over_chance, beyond_sample.ProbabilityOfFirst(clustering).value_or(0.5));
  }

  // Goes along the line, and calls use(x) after each bound of an interval.
  template <typename Use>
  void ForEachPlace(const Use& use) {
    if (bounds_.empty()) SortBounds();
    for (const Bound& bound : bounds_) {
      Move(intervals_[bound.interval], bound.is_begin ? 1 : -1);
      use(bound.x);
    }
  }
  void SortBounds() {
    bounds_.reserve(2 * intervals_.size());
    for (size_t i = 0; i < intervals_.size(); ++i) {
      bounds_.push_back({intervals_[i].begin, true, i});
      bounds_.push_back({intervals_[i].end, false, i});
    }
    std::sort(bounds_.begin(), bounds_.end(),
              [](const Bound& a, const Bound& b) { return a.x < b.x; });
  }
  // Enters an interval (1) or leaves it (-1).
  void Move(const InlierRange& interval, int change) {
    if (interval.Contains(0)) shared_ += change;
    const int zero = at_zero_[interval.keypoint];
    int& here = here_[interval.keypoint];
    exclusive_.only_first -= zero > here ? 1 : 0;
    exclusive_.only_second -= here > zero ? 1 : 0;
    here += change;
    exclusive_.only_first += zero > here ? 1 : 0;
    exclusive_.only_second += here > zero ? 1 : 0;
  }

  struct Bound {
    double x;
    bool is_begin;
    size_t interval;
  };

  const std::vector<InlierRange>& intervals_;
  std::vector<Bound> bounds_;  // along the line
  std::optional<ByChance> by_chance_;
  double speak_for_zero_ = 0;        // keypoints
  std::vector<int> at_zero_, here_;  // matches of each keypoint
  int matches_at_zero_ = 0, shared_ = 0;
  ExclusiveInliers exclusive_;  // of 0 and of here
};

// Counts the keypoints that have matches, and estimates the number of wrong inliers from the
// matches in the ring (IsInRing).
class WrongMatches {
 public:
  explicit WrongMatches(size_t num_keypoints) : has_match_(num_keypoints, false) {}

  void Add(size_t keypoint, double squared, int dimensions) {
    has_match_[keypoint] = true;
    if (IsInRing(squared)) expected_ += 1 / RingPerInlier(dimensions);
  }
  ByChance Chance(double least) const {
    const auto count = static_cast<double>(std::count(has_match_.begin(), has_match_.end(), true));
    return {count, std::clamp(std::max(least, expected_ / std::max(count, 1.0)), 1e-9, 1.0)};
  }

 private:
  std::vector<bool> has_match_;
  double expected_ = 0;  // wrong inliers
};

// The line from the dominant reference through the camera.
struct LineFromReference {
  int dominant;  // problem.CameraOf's
  Vector3d reference;
  Vector3d offset, direction;  // from the reference to the camera
  double length, longest, right_within;

  LineFromReference(const NormalizedProblem& problem, const CamFromLocal& pose, int dominant_pair,
                    double scene_distance)
      : dominant(dominant_pair),
        reference(problem.centers[static_cast<size_t>(dominant) % problem.centers.size()]),
        offset(CenterOfCamera(problem, pose, problem.CameraOf(dominant)) - reference),
        direction(offset / offset.norm()),
        length(offset.norm()),
        // Intervals longer than both the distance and half of that to the scene tell nothing of the
        // distance.
        longest(std::max(length, 0.5 * scene_distance)),
        right_within(kRightPosition * scene_distance) {}

  // Returns whether a match is with a reference at the dominant one's place, as in a burst: like
  // the dominant's own, such matches fit wherever the camera is on the line, and depths of one view
  // are wrong alike. If the camera is at that place, too, only the very same center counts.
  bool IsFromPlace(const NormalizedProblem& problem, const NormalizedMatch2D2D& match) const {
    const double extent = length > right_within ? right_within : 0;
    const Vector3d& center = problem.centers[static_cast<size_t>(match.reference)];
    return match.camera == problem.CameraOf(dominant) && (center - reference).norm() <= extent;
  }

  // Returns whether a match fits with the camera at its reference: all of its pairs do there, wrong
  // ones, too, as there is no parallax.
  bool FitsAtReference(const Vector3d& center, const InlierRange& interval) const {
    const Vector3d to_center = center - reference;
    const double along = to_center.dot(offset) / length;
    return (to_center - along * offset / length).norm() < right_within &&
           interval.begin < along - length + right_within &&
           interval.end > along - length - right_within;
  }
};

// Returns the intervals of the keypoints that both the dominant reference and another one show. By
// the query's pixel and the dominant's, a keypoint's point is C + z r, whose distance z is
// proportional to the camera's from C, so that the other reference sees it at its pixel in one
// interval alone. This tells the distance where all centers are on one line, and pairs of pixels do
// not.
std::vector<InlierRange> ByThreeViews(const NormalizedProblem& problem, const Residuals& residuals,
                                      const LineFromReference& line, const CameraOnLine& camera) {
  std::vector<std::vector<const NormalizedMatch2D2D*>> explained(problem.num_keypoints);
  for (size_t i = 0; i < problem.matches_2d2d.size(); ++i) {
    const NormalizedMatch2D2D& match = problem.matches_2d2d[i];
    if (match.camera_reference == line.dominant && residuals.of_2d2d[i] < 1) {
      explained[match.keypoint].push_back(&match);
    }
  }
  std::vector<InlierRange> intervals;
  for (const NormalizedMatch2D2D& match : problem.matches_2d2d) {
    if (line.IsFromPlace(problem, match)) continue;
    for (const NormalizedMatch2D2D* of_dominant : explained[match.keypoint]) {
      if (const auto interval = camera.InlierInterval(*of_dominant, match)) {
        intervals.push_back(*interval);
      }
    }
  }
  return intervals;
}

// Returns for each 2D-3D match whether it is the depth of an explained 2D-2D match from the line's
// place: whether its point lies on that match's ray.
std::vector<bool> OwnDepths(const NormalizedProblem& problem, const Residuals& residuals,
                            const LineFromReference& line) {
  struct Ray {
    Vector3d center, direction;
  };
  std::vector<std::vector<Ray>> rays(problem.num_keypoints);
  for (size_t i = 0; i < problem.matches_2d2d.size(); ++i) {
    const NormalizedMatch2D2D& match = problem.matches_2d2d[i];
    if (!line.IsFromPlace(problem, match) || !(residuals.of_2d2d[i] < 1)) continue;
    const Vector3d& center = problem.centers[static_cast<size_t>(match.reference)];
    rays[match.keypoint].push_back({center, match.reference_ray});
  }
  std::vector<bool> own;
  for (const NormalizedMatch2D3D& match : problem.matches_2d3d) {
    constexpr double kOnRay = 1e-5;  // radians, well below a pixel
    const std::vector<Ray>& of_keypoint = rays[match.keypoint];
    own.push_back(std::any_of(of_keypoint.begin(), of_keypoint.end(), [&](const Ray& ray) {
      return (match.point - ray.center).normalized().cross(ray.direction).norm() < kOnRay;
    }));
  }
  return own;
}

// The intervals of the line in which the matches fit, without the matches that fit everywhere.
struct EvidenceOnLine {
  std::vector<InlierRange> by_others, by_parallax, by_own_depths;
  WrongMatches others;
  double own_depths = 0, agreeing = 0;  // depths of explained 2D-2D matches; those that fit

  EvidenceOnLine(const NormalizedProblem& problem, const Residuals& residuals,
                 const LineFromReference& line, const CameraOnLine& camera)
      : others(problem.num_keypoints),
        problem_(problem),
        residuals_(residuals),
        line_(line),
        camera_(camera) {}

  void AddPairs() {
    for (size_t i = 0; i < problem_.matches_2d2d.size(); ++i) {
      const NormalizedMatch2D2D& match = problem_.matches_2d2d[i];
      if (line_.IsFromPlace(problem_, match)) continue;
      const std::optional<InlierRange> interval = camera_.InlierInterval(match);
      Add(interval, by_others);
      const Vector3d& center = problem_.centers[static_cast<size_t>(match.reference)];
      if (interval && !line_.FitsAtReference(center, *interval)) Add(interval, by_parallax);
      others.Add(match.keypoint, residuals_.of_2d2d[i], 1);
    }
    for (const InlierRange& interval : ByThreeViews(problem_, residuals_, line_, camera_)) {
      Add(interval, by_others);
      Add(interval, by_parallax);
    }
  }

  void AddDepths() {
    const std::vector<bool> own = OwnDepths(problem_, residuals_, line_);
    for (size_t i = 0; i < own.size(); ++i) {
      own_depths += own[i] ? 1 : 0;
      agreeing += own[i] && residuals_.of_2d3d[i] < 1 ? 1 : 0;
      const NormalizedMatch2D3D& match = problem_.matches_2d3d[i];
      Add(camera_.InlierInterval(match), own[i] ? by_own_depths : by_others);
      if (!own[i]) others.Add(match.keypoint, residuals_.of_2d3d[i], 2);
    }
  }

  double ShareOfDepths() const {
    return own_depths > 0 ? ProbabilityOfLarger(agreeing, own_depths - agreeing) : 0;
  }

 private:
  void Add(const std::optional<InlierRange>& interval, std::vector<InlierRange>& to) const {
    if (interval && interval->end - interval->begin < line_.longest) to.push_back(*interval);
  }

  const NormalizedProblem& problem_;
  const Residuals& residuals_;
  const LineFromReference& line_;
  const CameraOnLine& camera_;
};

// Returns how many of the intervals most hold one place.
int MostAtOnePlace(std::span<const InlierRange> intervals) {
  std::vector<std::pair<double, int>> bounds;
  for (const InlierRange& interval : intervals) {
    bounds.emplace_back(interval.begin, 1);
    bounds.emplace_back(interval.end, -1);
  }
  std::sort(bounds.begin(), bounds.end());
  int here = 0, most = 0;
  for (const auto& [x, change] : bounds) most = std::max(most, here += change);
  return most;
}

// Returns the probability of the place by the dominant reference's depths: no more than that their
// scale holds, and 1/2 as far as it does not. If they are alone, depths that err alike over a part
// of the image turn the camera about the scene, by as large a share of its distance as they err by.
double OfOwnDepths(double by_depths, double scale_holds, const DepthScale& scale, bool alone) {
  const double probability = by_depths > 0.5 ? std::min(by_depths, std::max(0.5, scale_holds))
                                             : 0.5 + scale_holds * (by_depths - 0.5);
  if (!alone || scale.known_sigma || !(scale.depth_sigma > 0)) return probability;
  const double one_depth = std::erf(kRightPosition / (scale.depth_sigma * std::numbers::sqrt2));
  return std::min(probability, std::max(0.5, one_depth));
}

// Returns the probability by two independent witnesses that agree: the product of their odds.
double ProbabilityOfBoth(double a, double b) {
  constexpr double kLeast = 1e-12;
  const auto odds = [&](double p) {
    p = std::clamp(p, kLeast, 1 - kLeast);
    return p / (1 - p);
  };
  const double both = odds(a) * odds(b);
  return both / (1 + both);
}

}  // namespace

double DepthScale::ProbabilityWithin(double share) const {
  if (known_sigma) {
    return *known_sigma > 0 ? std::erf(share / (*known_sigma * std::numbers::sqrt2)) : 1;
  }
  return 2 / std::numbers::pi * std::atan2(share, depth_sigma);
}

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
                             MatchSets sets, double scene_distance, const DepthScale& scale,
                             const InlierEvidence& evidence) {
  const Residuals residuals = ComputeResiduals(problem, pose);
  const std::optional<int> dominant = DominantReference(problem, residuals);
  if (!dominant) return 1;
  const LineFromReference line(problem, pose, *dominant, scene_distance);
  if (!(line.length > 0)) return 1;

  const CameraOnLine camera(problem, pose, line.direction);
  EvidenceOnLine found(problem, residuals, line, camera);
  found.AddPairs();
  if (Has2D3D(sets)) found.AddDepths();
  const auto places = [&](const std::vector<InlierRange>& intervals,
                          const std::optional<ByChance>& by_chance) {
    return PlacesOnLine(intervals, problem.num_keypoints, by_chance);
  };
  const double clustering = evidence.clustering;
  // Depths, of all references, may be wrong alike; pairs of pixels are not.
  const double by_pairs =
      places(found.by_parallax, std::nullopt).ProbabilityOverBetter(clustering, line.right_within);
  PlacesOnLine of_others = places(found.by_others, found.others.Chance(evidence.chance));
  const double others = std::min(by_pairs, of_others.ProbabilityOfZero(clustering));
  const double by_depths = places(found.by_own_depths, std::nullopt).ProbabilityOfZero(clustering);
  // Depths that agree with the place and those that do not are two witnesses of their scale.
  const double scale_holds =
      std::min(scale.ProbabilityWithin(line.right_within / line.length), found.ShareOfDepths());
  // The distance is right by luck if neither tells it.
  const double neither = (1 - of_others.OverChance(0, clustering)) * (1 - scale_holds);
  return std::min(1 - neither, ProbabilityOfBoth(others, OfOwnDepths(by_depths, scale_holds, scale,
                                                                     others == 0.5)));
}

bool DepthsAgreeUpToFactor(const NormalizedProblem& problem, const CamFromLocal& pose,
                           double scene_distance, const InlierEvidence& evidence) {
  const Residuals residuals = ComputeResiduals(problem, pose);
  const std::optional<int> dominant = DominantReference(problem, residuals);
  if (!dominant) return false;
  const LineFromReference line(problem, pose, *dominant, scene_distance);
  if (!(line.length > 0)) return false;
  const CameraOnLine camera(problem, pose, line.direction);
  EvidenceOnLine found(problem, residuals, line, camera);
  found.AddDepths();
  // Depths times s let the camera see the same from length / s; s is 1/2 to 2.
  const double range = 1.5 * line.length;
  double chance = 0;
  for (const InlierRange& interval : found.by_own_depths) {
    chance += std::min(1.0, (interval.end - interval.begin) / range) / found.own_depths;
  }
  const ByChance by_chance{found.own_depths, chance};
  return by_chance.LogFalseAlarms(MostAtOnePlace(found.by_own_depths), found.own_depths,
                                  evidence.clustering) < std::log(1 - kLocalizedConfidence);
}

double ProbabilityOfPosition(double position_sigma, double scene_distance) {
  if (!(position_sigma > 0)) return 0.5;
  return std::erf(kRightPosition * scene_distance / (position_sigma * std::numbers::sqrt2));
}

}  // namespace raylift
