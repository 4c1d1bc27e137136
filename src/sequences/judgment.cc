#include "sequences/judgment.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

#include "geometry/pose_step.h"
#include "sequences/anchors.h"
#include <Eigen/Cholesky>

#include "raylift/estimation/pose_estimator.h"
#include "raylift/geometry/residuals.h"

namespace raylift {
namespace {

// Frames whose own pose is right with more than this probability agree with the walk.
constexpr double kAgrees = 0.5;

// Returns whether poses differ by no more than they may err in 95 % of cases (chi-square of 6
// degrees of freedom).
bool AreOnePlace(const Rigid3& a, const Rigid3& b, const Matrix6d& covariance) {
  constexpr double kWithin = 12.6;
  const Vector6d step = StepBetween(a, b);
  return step.dot(covariance.ldlt().solve(step)) < kWithin;
}

// Sums up what frames that follow each other say of one walk. What makes a pose wrong makes the
// next ones of the same place wrong, too: they are one witness, as sure as the surest of them.
class Witnesses {
 public:
  // `pose` is where the walk has the frame.
  void Add(const SinglePose& single, const Rigid3& pose) {
    const double log_wrong = std::log(std::clamp(1 - single.confidence, 1e-3, 1.0));
    if (last_ && AreOnePlace(last_->cam_from_world, pose, last_->covariance + single.covariance)) {
      log_last_wrong_ = std::min(log_last_wrong_, log_wrong);
      return;
    }
    log_before_wrong_ += log_last_wrong_;
    surest_before_ = WithLast();
    last_ = {pose, single.covariance, single.confidence};
    log_last_wrong_ = log_wrong;
  }

  // Returns the logarithm of the probability that all witnesses are wrong.
  double LogAllWrong() const { return log_before_wrong_ + log_last_wrong_; }
  // Returns that of the three surest alone: structure that repeats along the walk makes all
  // witnesses wrong, however many.
  double LogSurestWrong() const {
    const Surest surest = WithLast();
    return std::accumulate(surest.begin(), surest.end(), 0.0);
  }

 private:
  using Surest = std::array<double, 3>;  // the surest first
  Surest WithLast() const {
    Surest surest = surest_before_;
    if (log_last_wrong_ < surest.back()) surest.back() = log_last_wrong_;
    std::sort(surest.begin(), surest.end());
    return surest;
  }

  std::optional<SinglePose> last_;
  double log_last_wrong_ = 0;
  double log_before_wrong_ = 0;
  Surest surest_before_ = {};
};

// Finds the other walks that frames make by their other poses, moving as the smoothed walk does:
// chains of poses, each of which is tied to one of the last frames. Such walks may drift, and a
// pose of no certain place may be of any: rather too many poses count as one walk.
class OtherWalks {
 public:
  // Takes the other poses of a frame, of which `agreeing` agrees with the walk.
  void Add(const std::vector<SinglePose>& singles, size_t agreeing, const SmoothedFrame& smoothed) {
    std::vector<Member> members;
    for (size_t k = 0; k < singles.size(); ++k) {
      if (k == agreeing) continue;
      Member member{singles[k].cam_from_world, smoothed.cam_from_world,
                    singles[k].covariance + smoothed.covariance};
      if (const Member* before = Before(member)) {
        member.walk = before->walk;
        member.witnesses = before->witnesses;
      } else {
        member.walk = log_all_wrong_.size();
        log_all_wrong_.push_back(0);
      }
      member.witnesses.Add(singles[k], smoothed.cam_from_world);
      double& of_walk = log_all_wrong_[member.walk];
      of_walk = std::min(of_walk, member.witnesses.LogAllWrong());
      members.push_back(member);
    }
    if (members.empty()) return;
    recent_.push_front(std::move(members));
    if (recent_.size() > kWindow) recent_.pop_back();
  }

  // Returns the sum of log W of each walk, along the surest of its branches.
  const std::vector<double>& LogAllWrong() const { return log_all_wrong_; }

 private:
  struct Member {
    Rigid3 cam_from_world;
    Rigid3 smoothed;
    Matrix6d covariance;  // of both
    size_t walk = 0;
    Witnesses witnesses = {};  // of the walk up to this frame
  };

  // Returns the last pose of the walk that `member` continues; of several walks, of the one that
  // has most evidence; null where it continues none.
  const Member* Before(const Member& member) const {
    const Member* most = nullptr;
    for (const std::vector<Member>& members : recent_) {
      for (const Member& before : members) {
        if (most && before.witnesses.LogAllWrong() >= most->witnesses.LogAllWrong()) continue;
        const Rigid3 moved = member.smoothed * before.smoothed.Inverse();
        const Matrix6d adjoint = StepAdjoint(moved);
        if (AreOnePlace(moved * before.cam_from_world, member.cam_from_world,
                        member.covariance + adjoint * before.covariance * adjoint.transpose())) {
          most = &before;
        }
      }
    }
    return most;
  }

  std::deque<std::vector<Member>> recent_;  // the last one first
  std::vector<double> log_all_wrong_;
};

// Returns the confidence by the formula of JudgeWalk().
double ProbabilityOfAgreeing(const Witnesses& agreeing, const Witnesses& differing,
                             const OtherWalks& others) {
  const double all_agreeing = agreeing.LogAllWrong();
  if (all_agreeing == 0) return 0;
  const double none_agreeing = agreeing.LogSurestWrong();
  const double share = none_agreeing / all_agreeing;
  double of_others = 1;
  for (const double log_wrong : others.LogAllWrong()) of_others += std::expm1(-share * log_wrong);
  const double some_agreeing = -std::expm1(none_agreeing);
  const double against = std::exp(none_agreeing - share * differing.LogAllWrong()) * of_others;
  return some_agreeing / (some_agreeing + against);
}

// The weight of the prior shares, in steps.
constexpr double kPriorSteps = 30;

// Returns the share of steps in which the odometry is lost: the walk's or, where it was seldom or
// never lost in the walk, a mean of this and the prior share.
double ShareLost(const std::vector<SmoothedFrame>& smoothed) {
  const auto lost = static_cast<double>(
      std::count_if(smoothed.begin(), smoothed.end(),
                    [](const SmoothedFrame& frame) { return frame.lost_before; }));
  const auto steps = static_cast<double>(smoothed.size() - 1);
  return std::max(lost / steps, (lost + kLost * kPriorSteps) / (steps + kPriorSteps));
}

// Returns the end of the frames from `begin` on between which the odometry was not lost.
size_t EndOfRun(const std::vector<SmoothedFrame>& smoothed, size_t begin) {
  size_t end = begin + 1;
  while (end < smoothed.size() && !smoothed[end].lost_before) ++end;
  return end;
}

// Returns the probability that a frame is where the walk has it although it says otherwise; 1 where
// it does not.
double ProbabilityAgainstOwn(const WalkEvidence& frame, const SmoothedFrame& smoothed,
                             double share_of_other_times) {
  if (frame.singles.empty() || Agrees(smoothed)) return 1;
  const std::vector<double> confidences = UsedConfidences(frame.singles);
  const double right = std::accumulate(confidences.begin(), confidences.end(), 0.0);
  return (1 - right) / (1 - right + right * share_of_other_times);
}

// Returns a frame's own poses as the walk takes them: with the confidences that they count with,
// and standard deviations times `sigma_factor`.
std::vector<SinglePose> AsUsed(const WalkEvidence& frame, double sigma_factor) {
  const std::vector<double> confidences = UsedConfidences(frame.singles);
  std::vector<SinglePose> singles = frame.singles;
  for (size_t k = 0; k < singles.size(); ++k) {
    singles[k].covariance *= sigma_factor * sigma_factor;
    singles[k].confidence = confidences[k];
  }
  return singles;
}

}  // namespace

bool Agrees(const SmoothedFrame& frame) { return frame.single_agrees > kAgrees; }

bool IsRematched(const SmoothedFrame& frame) { return frame.rematched_agrees > kAgrees; }

void JudgeWalk(std::span<const WalkEvidence> frames, SmoothedWalk& walk) {
  std::vector<SmoothedFrame>& smoothed = walk.frames;
  const double kept = 1 - ShareLost(smoothed);
  const auto all_agreeing = static_cast<double>(std::ranges::count_if(smoothed, Agrees));
  const double other_times = kLost * kPriorSteps / (all_agreeing + kPriorSteps);
  for (size_t begin = 0, end = 0; begin < smoothed.size(); begin = end) {
    end = EndOfRun(smoothed, begin);
    Witnesses agreeing, differing;
    OtherWalks others;
    std::optional<size_t> first, last;
    for (size_t i = begin; i < end; ++i) {
      smoothed[i].against_own = ProbabilityAgainstOwn(frames[i], smoothed[i], other_times);
      if (Agrees(smoothed[i]) || smoothed[i].rematched_agrees >= kLocalizedConfidence) {
        if (!first) first = i;
        last = i;
      }
      if (frames[i].singles.empty()) continue;
      const std::vector<SinglePose> singles = AsUsed(frames[i], walk.single_sigma_factor);
      if (!Agrees(smoothed[i])) {
        SinglePose any = singles.front();
        for (size_t k = 1; k < singles.size(); ++k) any.confidence += singles[k].confidence;
        differing.Add(any, any.cam_from_world);
        continue;
      }
      agreeing.Add(singles[smoothed[i].single], smoothed[i].cam_from_world);
      others.Add(singles, smoothed[i].single, smoothed[i]);
    }
    const double probability = ProbabilityOfAgreeing(agreeing, differing, others);
    for (size_t i = begin; i < end && first; ++i) {
      const size_t beyond = i < *first ? *first - i : (i > *last ? i - *last : 0);
      smoothed[i].confidence = probability * std::pow(kept, beyond);
    }
  }
}

}  // namespace raylift
