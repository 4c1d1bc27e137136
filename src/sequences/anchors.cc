#include "sequences/anchors.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <optional>
#include <utility>

#include "base/statistics.h"
#include <Eigen/Cholesky>

#include "raylift/geometry/residuals.h"

namespace raylift {
namespace {

constexpr double kScaleDrift = 0.02;
// The least amount of a step: one that hardly moves is noisy, too.
constexpr double kLeastAmount = 0.05;

double Log2Pi3() { return 3 * std::log(2 * std::numbers::pi); }

// Returns error' C^-1 error + log det C, which is -2 log of the normal density but for its
// constant.
double CostOf(const Vector6d& error, const Matrix6d& covariance) {
  const Eigen::LLT<Matrix6d> factored(covariance);
  if (factored.info() != Eigen::Success) return std::numeric_limits<double>::infinity();
  const Matrix6d lower = factored.matrixL();
  return lower.triangularView<Eigen::Lower>().solve(error).squaredNorm() +
         2 * lower.diagonal().array().log().sum();
}

// Costs of both poses of two frames being right: -2 log of the density.
class TieCosts {
 public:
  TieCosts(std::span<const WalkEvidence> frames, double scale, const StepNoise& noise)
      : frames_(frames),
        scale_(scale),
        noise_(noise),
        way_(StepAmounts(frames)),
        log_anywhere_(LogDensityAnywhere(ExtentOf(frames, scale))) {
    for (size_t i = 1; i < way_.size(); ++i) way_[i] += way_[i - 1];
  }

  double log_anywhere() const { return log_anywhere_; }

  // Returns whether the odometry was rather lost between both poses, if they are right.
  bool IsLost(const Anchor& earlier, const Anchor& later) const {
    return Lost(earlier, later) < Tied(earlier, later);
  }

  // Returns the cost where the odometry was lost between them.
  double Lost(const Anchor& earlier, const Anchor& later) const {
    const double ever = 1 - std::pow(1 - kLost, static_cast<double>(later.frame - earlier.frame));
    return -2 * (std::log(ever) + log_anywhere_);
  }

  // Returns the cost where the odometry was not lost.
  double Tied(const Anchor& earlier, const Anchor& later) const {
    const WalkEvidence &before = frames_[earlier.frame], &after = frames_[later.frame];
    const SinglePose &from = before.singles[earlier.single], &to = after.singles[later.single];
    const Rigid3 step = OdometryStep(after.cam_from_odometry, before.cam_from_odometry, scale_);
    const Rigid3 seen = to.cam_from_world * from.cam_from_world.Inverse();
    const Matrix6d adjoint = StepAdjoint(seen);
    const double way = way_[later.frame] - way_[earlier.frame];
    const double turn = noise_.rotation_variance * way;
    // A turn on the way moves what comes after it, and the scale may drift.
    const double shift = noise_.position_variance * way +
                         (turn / 3 + kScaleDrift * kScaleDrift) * step.translation.squaredNorm();
    Matrix6d covariance = to.covariance + adjoint * from.covariance * adjoint.transpose();
    covariance.diagonal().head<3>().array() += turn;
    covariance.diagonal().tail<3>().array() += shift;
    return CostOf(StepBetween(step, seen), covariance);
  }

 private:
  std::span<const WalkEvidence> frames_;
  double scale_;
  StepNoise noise_;
  std::vector<double> way_;  // up to each frame
  double log_anywhere_;
};

double VarianceOf(const SinglePose& single) {
  return single.covariance.bottomRightCorner<3, 3>().trace();
}

// Returns the largest variance of position of the poses that count. A pose that tells its place
// much worse than the others, and than odometry over the window, would only let those before and
// after it forget each other.
double MostVariance(std::span<const WalkEvidence> frames, const StepNoise& noise) {
  constexpr double kTimesMedian = 10;
  std::vector<double> variances;
  for (const WalkEvidence& frame : frames) {
    for (const SinglePose& single : frame.singles) variances.push_back(VarianceOf(single));
  }
  return std::max(3 * kWindow * noise.position_variance,
                  kTimesMedian * UpperMedianOr(std::move(variances), 0));
}

class AnchorSearch {
 public:
  AnchorSearch(std::span<const WalkEvidence> frames, double scale, const StepNoise& noise)
      : frames_(frames), costs_(frames, scale, noise), most_variance_(MostVariance(frames, noise)) {
    for (size_t i = 0; i < frames.size(); ++i) AddFrame(i);
    for (size_t k = 0; k < candidates_.size(); ++k) AddContradictions(k);
  }

  // Runs the dynamic program. Its state is the last anchor so far; frames between two anchors are
  // wrong.
  std::vector<Anchor> Run() const {
    struct State {
      double cost;  // of all frames up to this one
      std::optional<size_t> before;
      bool lost = false;
    };
    std::vector<State> states;
    for (size_t k = 0; k < candidates_.size(); ++k) {
      const Candidate& candidate = candidates_[k];
      State best{all_wrong_[candidate.place] + candidate.Before(candidate.place) + candidate.right -
                     2 * costs_.log_anywhere(),
                 std::nullopt};
      for (size_t j = candidate.first; candidates_[j].place < candidate.place; ++j) {
        const Candidate& earlier = candidates_[j];
        const size_t places = candidate.place - earlier.place - 1;
        const double between = all_wrong_[candidate.place] - all_wrong_[earlier.place + 1] +
                               earlier.After(places) + candidate.Before(places);
        const double tied = candidate.tied[j - candidate.first];
        const double lost = costs_.Lost(earlier.anchor, candidate.anchor);
        const double total = states[j].cost + between + candidate.right + std::min(tied, lost);
        if (total < best.cost) best = {total, j, lost < tied};
      }
      states.push_back(best);
    }
    std::optional<size_t> last;
    double least = std::numeric_limits<double>::infinity();
    for (size_t k = 0; k < states.size(); ++k) {
      const size_t place = candidates_[k].place;
      const double wrong_after = all_wrong_.back() - all_wrong_[place + 1] +
                                 candidates_[k].After(all_wrong_.size() - 2 - place);
      const double total = states[k].cost + wrong_after;
      if (total < least) std::tie(least, last) = std::pair(total, k);
    }
    std::vector<Anchor> anchors;
    for (; last; last = states[*last].before) {
      anchors.push_back(candidates_[*last].anchor);
      anchors.back().lost_before = states[*last].lost;
    }
    std::reverse(anchors.begin(), anchors.end());
    return WithoutReturns(anchors);
  }

 private:
  // Joins runs of anchors that odometry ties together again: odometry that tells later what it told
  // before was not lost, but repeated structure shows the place elsewhere in between, or before and
  // after. The fewer anchors are wrong, and dropped.
  std::vector<Anchor> WithoutReturns(const std::vector<Anchor>& anchors) const {
    std::vector<std::vector<Anchor>> runs;
    for (const Anchor& anchor : anchors) {
      if (runs.empty() || anchor.lost_before) runs.emplace_back();
      runs.back().push_back(anchor);
    }
    for (size_t i = 0; i < runs.size(); ++i) {
      for (size_t k = runs.size() - 1; k > i + 1; --k) {
        if (costs_.IsLost(runs[i].back(), runs[k].front())) continue;
        const auto begin = runs.begin() + static_cast<std::ptrdiff_t>(i);
        const auto end = runs.begin() + static_cast<std::ptrdiff_t>(k);
        size_t between = 0;
        for (auto run = begin + 1; run < end; ++run) between += run->size();
        if (runs[i].size() + runs[k].size() < between) {
          runs.erase(end);
          runs.erase(begin);
          return WithoutReturns(Joined(runs));
        }
        runs[i].insert(runs[i].end(), runs[k].begin(), runs[k].end());
        runs.erase(begin + 1, end + 1);
        break;
      }
    }
    return Joined(runs);
  }

  // Returns the anchors of all runs, with whether the odometry is lost before each.
  std::vector<Anchor> Joined(const std::vector<std::vector<Anchor>>& runs) const {
    std::vector<Anchor> anchors;
    for (const std::vector<Anchor>& run : runs) {
      for (Anchor anchor : run) {
        anchor.lost_before = !anchors.empty() && costs_.IsLost(anchors.back(), anchor);
        anchors.push_back(anchor);
      }
    }
    return anchors;
  }

  // One of a frame's own poses.
  struct Candidate {
    Anchor anchor;
    size_t place;  // of the frame among those with a pose
    size_t first;  // candidate that it may be tied to
    // These are TieCosts::Tied() to the candidate `first` and to each after it, up to those of the
    // frame before.
    std::vector<double> tied = {};
    double wrong = 0;  // CostOfWrongPose()
    double right = 0;  // the cost of its being right, but for that of where it is if wrong
    // These are the additional costs of so many frames before or after it being wrong although they
    // agree with it.
    std::vector<double> before = {0}, after = {0};

    double Before(size_t places) const { return before[std::min(places, before.size() - 1)]; }
    double After(size_t places) const { return after[std::min(places, after.size() - 1)]; }
  };

  void AddFrame(size_t frame) {
    const std::vector<SinglePose>& singles = frames_[frame].singles;
    const std::vector<double> confidences = UsedConfidences(frames_[frame].singles);
    const auto tells = [&](const SinglePose& single) {
      return VarianceOf(single) <= most_variance_;
    };
    if (std::none_of(singles.begin(), singles.end(), tells)) return;
    const double wrong = 1 - std::accumulate(confidences.begin(), confidences.end(), 0.0);
    const size_t place = all_wrong_.size() - 1;
    size_t first = candidates_.empty() ? 0 : candidates_.back().first;
    while (first < candidates_.size() && candidates_[first].place + kWindow < place) ++first;
    const size_t end = candidates_.size();
    for (size_t k = 0; k < confidences.size(); ++k) {
      if (!tells(singles[k])) continue;
      Candidate candidate{{frame, k}, place, first};
      for (size_t j = first; j < end; ++j) {
        candidate.tied.push_back(costs_.Tied(candidates_[j].anchor, candidate.anchor));
      }
      candidate.wrong = CostOfWrongPose(candidate, std::log(wrong) - std::log(confidences[k]));
      candidate.right = -2 * std::log(confidences[k]) - candidate.wrong;
      candidates_.push_back(std::move(candidate));
    }
    all_wrong_.push_back(all_wrong_.back() - 2 * std::log(wrong));
  }

  // Returns the cost of a pose's place if it is wrong: -2 log of the larger of two densities, that
  // of anywhere, and that of being wrong in the same way as a pose of a frame before, as what
  // repeats in the scene deceives many frames. The latter has half of the weight of being wrong or,
  // if that is less, of being right; `log_odds` are those of wrong to right: poses that agree are
  // rather right.
  double CostOfWrongPose(const Candidate& pose, double log_odds) const {
    double least = std::numeric_limits<double>::infinity();
    for (const double tied : pose.tied) least = std::min(least, tied);
    return std::min(-2 * costs_.log_anywhere(),
                    least + 2 * (std::log(2) + std::max(log_odds, 0.0)));
  }

  // Adds the costs of poses that agree with a right one, but are wrong: they are not wrong in the
  // same way as others, but by chance.
  void AddContradictions(size_t k) {
    Candidate& later = candidates_[k];
    std::vector<double> of_places(later.place - candidates_[later.first].place, 0);
    for (size_t j = later.first; j < later.first + later.tied.size(); ++j) {
      Candidate& earlier = candidates_[j];
      const bool agree = later.tied[j - later.first] < costs_.Lost(earlier.anchor, later.anchor);
      of_places[later.place - earlier.place - 1] +=
          agree ? -2 * costs_.log_anywhere() - earlier.wrong : 0;
      const size_t places = later.place - earlier.place;
      while (earlier.after.size() <= places) earlier.after.push_back(earlier.after.back());
      if (agree) earlier.after[places] += -2 * costs_.log_anywhere() - later.wrong;
    }
    for (const double more : of_places) later.before.push_back(later.before.back() + more);
  }

  std::span<const WalkEvidence> frames_;
  TieCosts costs_;
  double most_variance_;  // of position, of poses that count
  std::vector<Candidate> candidates_;
  // The cost of the first n frames with a pose all being wrong, without that of where their poses
  // are.
  std::vector<double> all_wrong_ = {0};
};

}  // namespace

Rigid3 OdometryStep(const Rigid3& later, const Rigid3& earlier, double scale) {
  Rigid3 step = later * earlier.Inverse();
  step.translation *= scale;
  return step;
}

std::vector<double> UsedConfidences(std::span<const SinglePose> singles) {
  constexpr double kMost = 1 - 0.1 * kLost;
  std::vector<double> confidences;
  for (const SinglePose& single : singles) {
    confidences.push_back(std::clamp(single.confidence, 0.02, kMost));
  }
  double all = std::accumulate(confidences.begin(), confidences.end(), 0.0);
  if (confidences.size() > 1) {
    all += (all - confidences.front()) / static_cast<double>(confidences.size() - 1);
  }
  for (double& confidence : confidences) confidence *= std::min(1.0, kMost / all);
  return confidences;
}

StepLength LengthOfStep(const WalkEvidence& before, const WalkEvidence& frame) {
  const Rigid3 step = OdometryStep(frame.cam_from_odometry, before.cam_from_odometry, 1);
  return {std::max(frame.since_before.way, step.OriginInSource().norm()),
          std::max(frame.since_before.turn_deg,
                   AngleBetweenDeg(step.rotation, Eigen::Quaterniond::Identity()))};
}

std::vector<double> StepAmounts(std::span<const WalkEvidence> frames) {
  std::vector<double> lengths, angles;
  double length = 0, angle = 0;
  for (size_t i = 1; i < frames.size(); ++i) {
    const StepLength step = LengthOfStep(frames[i - 1], frames[i]);
    length += lengths.emplace_back(step.way);
    angle += angles.emplace_back(step.turn_deg);
  }
  const auto steps = static_cast<double>(lengths.size());
  std::vector<double> amounts = {0};
  for (size_t i = 0; i < lengths.size(); ++i) {
    double amount = 0;
    if (length > 0) amount += steps * lengths[i] / length;
    if (angle > 0) amount += steps * angles[i] / angle;
    amounts.push_back(std::max(length > 0 && angle > 0 ? 0.5 * amount : amount, kLeastAmount));
  }
  return amounts;
}

double LogDensityAnywhere(double extent) {
  const double rotations = 8 * std::numbers::pi * std::numbers::pi;
  return Log2Pi3() - std::log(rotations * extent * extent * extent);
}

double ExtentOf(std::span<const WalkEvidence> frames, double scale) {
  Eigen::AlignedBox3d singles, odometry;
  for (const WalkEvidence& frame : frames) {
    odometry.extend(frame.cam_from_odometry.OriginInSource());
    for (const SinglePose& single : frame.singles) {
      singles.extend(single.cam_from_world.OriginInSource());
    }
  }
  const double walked = scale * odometry.diagonal().norm();
  const double seen = singles.isEmpty() ? 0 : singles.diagonal().norm();
  const double extent = 2 * std::max(walked, seen);
  return extent > 0 ? extent : 1;
}

std::optional<double> ScaleByPairs(std::span<const WalkEvidence> frames) {
  constexpr double kBand = 0.05;   // of the logarithm
  constexpr double kFarApart = 4;  // standard deviations of the two positions
  std::vector<double> logs;
  std::vector<size_t> with_pose;
  for (size_t i = 0; i < frames.size(); ++i) {
    if (!frames[i].singles.empty()) with_pose.push_back(i);
  }
  for (size_t k = 0; k < with_pose.size(); ++k) {
    const WalkEvidence& a = frames[with_pose[k]];
    const SinglePose& of_a = a.singles.front();
    for (size_t j = k > kWindow ? k - kWindow : 0; j < k; ++j) {
      const WalkEvidence& b = frames[with_pose[j]];
      const SinglePose& of_b = b.singles.front();
      const double seen =
          (of_a.cam_from_world.OriginInSource() - of_b.cam_from_world.OriginInSource()).norm();
      const double walked =
          (a.cam_from_odometry.OriginInSource() - b.cam_from_odometry.OriginInSource()).norm();
      const double variance = (of_a.covariance + of_b.covariance).bottomRightCorner<3, 3>().trace();
      if (walked > 0 && seen > kFarApart * std::sqrt(variance)) {
        logs.push_back(std::log(seen / walked));
      }
    }
  }
  std::sort(logs.begin(), logs.end());
  size_t most = 0;
  double best = 0;
  for (size_t begin = 0, end = 0; begin < logs.size(); ++begin) {
    while (end < logs.size() && logs[end] - logs[begin] <= kBand) ++end;
    if (end - begin > most) {
      most = end - begin;
      best = logs[begin + (end - begin) / 2];
    }
  }
  if (most < 2) return std::nullopt;
  return std::exp(best);
}

std::vector<Anchor> FindAnchors(std::span<const WalkEvidence> frames, double scale,
                                const StepNoise& noise) {
  return AnchorSearch(frames, scale, noise).Run();
}

}  // namespace raylift
