#include "sequences/rematching.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <utility>

#include "geometry/pose_step.h"
#include "sequences/judgment.h"
#include "sequences/walked_query.h"
#include <Eigen/Cholesky>
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"
#include "raylift/geometry/residuals.h"

namespace raylift {
namespace {

// The references that a photograph is matched with.
constexpr size_t kReferences = 10;
constexpr int kMostRounds = 10;

double PositionSigma(const Matrix6d& covariance) {
  return std::sqrt(covariance.bottomRightCorner<3, 3>().trace());
}

class Rematching {
 public:
  Rematching(const WalkInputs& inputs, const SmoothingOptions& options,
             std::vector<WalkEvidence>& evidence, SmoothedWalk& smoothed)
      : inputs_(inputs),
        options_(options),
        evidence_(evidence),
        smoothed_(smoothed),
        asked_with_(evidence.size(), HUGE_VAL) {}

  void Run() {
    for (int round = 0; round < kMostRounds && AskAll(); ++round) {
      SmoothedWalk better = SmoothWalk(evidence_, options_.scale);
      if (better.frames.empty()) return;
      smoothed_ = std::move(better);
    }
    while (TakeBack()) {
      SmoothedWalk rest = SmoothWalk(evidence_, options_.scale);
      if (rest.frames.empty()) return;
      smoothed_ = std::move(rest);
    }
  }

  // Returns what the scene's files said; empty where nothing was wrong.
  const std::string& error() const { return error_; }

 private:
  // Returns whether a pose was found.
  bool AskAll() {
    std::vector<size_t> asked;
    std::vector<std::vector<size_t>> references;
    for (size_t i = 0; i < evidence_.size(); ++i) {
      if (evidence_[i].rematched || !IsWorthAsking(i)) continue;
      std::vector<size_t> seeing_alike = inputs_.distances.SeeingAlike(
          PhotographOf(i).camera, smoothed_.frames[i].predicted->cam_from_world, kReferences);
      if (seeing_alike.empty()) continue;
      asked.push_back(i);
      references.push_back(std::move(seeing_alike));
    }
    if (asked.empty() || !Open()) return false;
    std::vector<std::optional<SinglePose>> found(asked.size());
    std::vector<std::string> errors(asked.size());
    ParallelFor(asked.size(), options_.threads, [&](size_t k) {
      try {
        found[k] = Ask(asked[k], references[k]);
      } catch (const InputError& error) {
        errors[k] = error.what();
      }
    });
    for (const std::string& error : errors) {
      if (error_.empty()) error_ = error;
    }
    bool is_any_found = false;
    for (size_t k = 0; k < asked.size(); ++k) {
      if (!found[k] || !IsNear(*found[k], asked[k]) || !IsBetter(*found[k], asked[k])) continue;
      evidence_[asked[k]].rematched =
          RematchedPose{*std::move(found[k]), smoothed_.frames[asked[k]].predicted->covariance};
      is_any_found = true;
    }
    return is_any_found;
  }

  bool Open() {
    if (localize_again_) return true;
    try {
      localize_again_ = options_.open_localizer();
    } catch (const InputError& error) {
      error_ = error.what();
    }
    return localize_again_ != nullptr;
  }

  const Query& PhotographOf(size_t i) const {
    return inputs_.photographs[inputs_.walk.frames[i].query];
  }

  // Returns whether the walk, which is more likely right than wrong, predicts a photograph that is
  // not sure by itself, and more closely than when it was asked before. A focal length that is to
  // be found, and a position that is known besides, are the photograph's own matter.
  bool IsWorthAsking(size_t i) {
    const SmoothedFrame& frame = smoothed_.frames[i];
    const size_t query = inputs_.walk.frames[i].query;
    const PosePriors& priors = PhotographOf(i).priors;
    if (frame.confidence < 0.5 || !frame.predicted || priors.focal_range > 1 || priors.position ||
        inputs_.queries[query].verdict() == PoseVerdict::kLocalized) {
      return false;
    }
    constexpr double kCloser = 0.8;
    const double sigma = PositionSigma(frame.predicted->covariance);
    if (!(sigma < kCloser * asked_with_[i])) return false;
    asked_with_[i] = sigma;
    return true;
  }

  // Returns what the photograph's matches say, if it is more likely right than wrong.
  std::optional<SinglePose> Ask(size_t i, std::span<const size_t> references) const {
    const FramePrediction& predicted = *smoothed_.frames[i].predicted;
    LocalizedQuery again = localize_again_(PhotographOf(i), references, predicted.cam_from_world,
                                           predicted.covariance);
    const std::vector<SinglePose> singles = SinglePosesOf(again);
    if (singles.empty() || singles.front().confidence < 0.5) return std::nullopt;
    return singles.front();
  }

  // Returns whether a pose is where it was predicted, as far as both may err (chi-square of 6
  // degrees of freedom, .999).
  bool IsNear(const SinglePose& found, size_t i) const {
    constexpr double kWithin = 22.5;
    const FramePrediction& predicted = *smoothed_.frames[i].predicted;
    const auto off = StepBetween(predicted.cam_from_world, found.cam_from_world);
    const Matrix6d covariance = predicted.covariance + smoothed_.single_sigma_factor *
                                                           smoothed_.single_sigma_factor *
                                                           found.covariance;
    return off.dot(covariance.ldlt().solve(off)) < kWithin;
  }

  // Returns whether a pose tells more than the frame's own that agrees, if there is one.
  bool IsBetter(const SinglePose& found, size_t i) const {
    const SmoothedFrame& frame = smoothed_.frames[i];
    return !Agrees(frame) || PositionSigma(found.covariance) <
                                 PositionSigma(evidence_[i].singles[frame.single].covariance);
  }

  // Forgets poses that no longer agree with the walk; returns whether there are any.
  bool TakeBack() {
    bool is_any = false;
    for (size_t i = 0; i < evidence_.size(); ++i) {
      if (!evidence_[i].rematched || IsRematched(smoothed_.frames[i])) continue;
      evidence_[i].rematched.reset();
      is_any = true;
    }
    return is_any;
  }

  const WalkInputs& inputs_;
  const SmoothingOptions& options_;
  std::vector<WalkEvidence>& evidence_;
  SmoothedWalk& smoothed_;
  LocalizeAgain localize_again_;
  std::vector<double> asked_with_;  // the deviation of the prediction, by frame
  std::string error_;
};

}  // namespace

void RematchFrames(const WalkInputs& inputs, const SmoothingOptions& options,
                   std::vector<WalkEvidence>& evidence, SmoothedWalk& smoothed,
                   std::vector<std::string>& warnings) {
  if (smoothed.frames.empty()) return;
  Rematching rematching(inputs, options, evidence, smoothed);
  rematching.Run();
  if (rematching.error().empty()) return;
  warnings.push_back(
      fmt::format("photographs could not be localized again where the walk predicts "
                  "them: {}",
                  rematching.error()));
}

}  // namespace raylift
