#include "raylift/sequences/smoothing.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <optional>
#include <utility>

#include "base/constants.h"
#include "sequences/anchors.h"
#include "sequences/chain.h"
#include "sequences/judgment.h"
#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include "raylift/base/error.h"
#include "raylift/geometry/residuals.h"

namespace raylift {
namespace {

// A tenth of the errors has a broader distribution, of three times the standard deviation.
constexpr double kBroadShare = 0.1;
constexpr double kBroadVariance = 9;

// Priors of the odometry's noise over a mean step, 3 % of its length and 0.5 degrees, with the
// weight of so many observed numbers; and the weight of the prior of the frames' covariances.
constexpr double kPriorShare = 0.03;
constexpr double kPriorRotation = 0.5 / kDegPerRad;
constexpr double kPriorWeight = 0.3;
constexpr double kPriorFactorWeight = 12;
// The search for anchors takes noise that is rather too large, by this factor of the standard
// deviation.
constexpr double kSearchFactor = 3;
// The standard deviation of the logarithm of the scale, from where it starts, where it is unknown.
constexpr double kPriorLogScale = 0.1;

constexpr int kRounds = 10;
// Iterations while the noise still changes, and at the end.
constexpr int kIterationsOfRound = 4;
constexpr int kIterations = 50;

// The inverse of a covariance, and the logarithm of the inverse's determinant.
struct Information {
  explicit Information(const Matrix6d& inverse_covariance)
      : matrix(inverse_covariance), log_determinant(std::log(inverse_covariance.determinant())) {}

  // Returns the information of a covariance that is larger by a factor.
  Information Over(double factor) const {
    Information less = *this;
    less.matrix /= factor;
    less.log_determinant -= 6 * std::log(factor);
    return less;
  }

  Matrix6d matrix;
  double log_determinant;
};

// The likelihood of an error with several possible explanations, each normally distributed or,
// without information, anywhere.
class Mixture {
 public:
  static constexpr size_t kMostComponents = 3;

  void Add(double weight, const Information& information) {
    components_[count_++] = {std::log(weight) + 0.5 * information.log_determinant,
                             information.matrix};
  }
  // Adds a component that is anywhere, with this density, times (2 pi)^3 as that of normal ones.
  void AddAnywhere(double weight, double log_density) {
    components_[count_++] = {std::log(weight) + log_density, Matrix6d::Zero()};
  }

  struct Value {
    double cost = 0;                               // - 2 log likelihood
    Matrix6d information = Matrix6d::Zero();       // of the error: the components' mean
    std::array<double, kMostComponents> shares{};  // the probability of each component
  };
  Value At(const Vector6d& error) const {
    Value value;
    double largest = -HUGE_VAL;
    for (size_t k = 0; k < count_; ++k) {
      value.shares[k] =
          components_[k].log_factor - 0.5 * error.dot(components_[k].information * error);
      largest = std::max(largest, value.shares[k]);
    }
    double sum = 0;
    for (size_t k = 0; k < count_; ++k) {
      sum += value.shares[k] = std::exp(value.shares[k] - largest);
    }
    for (size_t k = 0; k < count_; ++k) {
      value.shares[k] /= sum;
      value.information += value.shares[k] * components_[k].information;
    }
    value.cost = -2 * (largest + std::log(sum));
    return value;
  }

 private:
  struct Component {
    double log_factor;
    Matrix6d information;
  };
  std::array<Component, kMostComponents> components_;
  size_t count_ = 0;
};

Information InverseDiagonal(double rotation_variance, double position_variance) {
  Matrix6d information = Matrix6d::Zero();
  information.diagonal().head<3>().setConstant(1 / rotation_variance);
  information.diagonal().tail<3>().setConstant(1 / position_variance);
  return Information(information);
}

// Returns d e(from, to) as `to` moves by a step, where e is small.
Matrix6d OfMoved(const Vector6d& error) {
  Matrix6d jacobian = Matrix6d::Identity();
  jacobian.topLeftCorner<3, 3>() -= 0.5 * Skew(error.head<3>());
  jacobian.bottomLeftCorner<3, 3>() = -Skew(error.tail<3>());
  return jacobian;
}

// The terms of a walk's cost: the errors of poses and steps, and their distributions under the
// present noise. `poses` are of all frames; exp(log_scale) is the odometry's unit.
class WalkTerms {
 public:
  // `scale` is known or about right.
  WalkTerms(std::span<const WalkEvidence> frames, double scale, bool scale_is_known)
      : frames_(frames),
        scale_is_known_(scale_is_known),
        prior_log_scale_(std::log(scale)),
        amounts_(StepAmounts(frames)),
        steps_(frames.size()),
        lost_steps_(frames.size(), 0) {
    for (const WalkEvidence& frame : frames) {
      std::vector<Information>& singles = singles_.emplace_back();
      for (const SinglePose& single : frame.singles) singles.push_back(InformationOf(single));
    }
    for (size_t i = 1; i < frames.size(); ++i) {
      steps_[i] = OdometryStep(frames[i].cam_from_odometry, frames[i - 1].cam_from_odometry, 1);
    }
    extent_ = ExtentOf(frames, std::exp(prior_log_scale_));
    log_anywhere_ = LogDensityAnywhere(extent_);
    double way = 0;
    for (size_t i = 1; i < frames.size(); ++i) {
      way += Step(i, prior_log_scale_).OriginInSource().norm();
    }
    const double mean_step = std::max(way / static_cast<double>(frames.size() - 1), 1e-6 * extent_);
    prior_noise_ = {kPriorShare * kPriorShare * mean_step * mean_step,
                    kPriorRotation * kPriorRotation};
    noise_ = prior_noise_;
  }

  // Takes for each step in which the odometry may have been lost how many such steps there are
  // between its two anchors; 0 where it was not lost.
  void TakeLostSteps(std::vector<size_t> lost_steps) {
    lost_steps_ = std::move(lost_steps);
    TakeNoise(noise_, single_factor_);
  }

  void TakeNoise(const StepNoise& noise, double single_factor) {
    noise_ = noise;
    single_factor_ = single_factor;
    of_singles_.clear();
    of_rematched_.clear();
    of_steps_.clear();
    for (size_t i = 0; i < frames_.size(); ++i) {
      of_singles_.push_back(OfSingles(i));
      of_rematched_.push_back(OfRematched(i));
      of_steps_.push_back(i > 0 ? OfStep(i) : Mixture());
    }
  }

  double Amount(size_t i) const { return amounts_[i]; }
  bool IsLost(size_t i) const { return lost_steps_[i] > 0; }
  const Information& InformationOfSingle(size_t i, size_t k) const { return singles_[i][k]; }
  const Mixture& OfStepError(size_t i) const { return of_steps_[i]; }
  const StepNoise& prior_noise() const { return prior_noise_; }
  const StepNoise& noise() const { return noise_; }
  double single_factor() const { return single_factor_; }

  Rigid3 Step(size_t i, double log_scale) const {
    Rigid3 step = steps_[i];
    step.translation *= std::exp(log_scale);
    return step;
  }

  // The likeliest of a frame's own poses, of which there is one at least, if the frame is at
  // `pose`.
  struct SingleTerm {
    size_t single = 0;
    Vector6d error;
    Mixture::Value value;
  };
  SingleTerm SingleAt(size_t i, const Rigid3& pose) const {
    SingleTerm best;
    for (size_t k = 0; k < frames_[i].singles.size(); ++k) {
      const Vector6d error = StepBetween(frames_[i].singles[k].cam_from_world, pose);
      const Mixture::Value value = of_singles_[i][k].At(error);
      if (k == 0 || value.cost < best.value.cost) best = {k, error, value};
    }
    return best;
  }

  // The pose that counts if the frame is at `pose`: the one that was found where it was predicted,
  // or the likeliest of its own; nullopt without any.
  std::optional<SingleTerm> TermAt(size_t i, const Rigid3& pose) const {
    if (const auto& rematched = frames_[i].rematched) {
      const Vector6d error = StepBetween(rematched->pose.cam_from_world, pose);
      return SingleTerm{0, error, of_rematched_[i].At(error)};
    }
    if (frames_[i].singles.empty()) return std::nullopt;
    return SingleAt(i, pose);
  }

  Vector6d StepError(size_t i, const Rigid3& before, const Rigid3& pose, double log_scale) const {
    return StepBetween(Step(i, log_scale), pose * before.Inverse());
  }

  ChainEquations::Jacobians StepJacobians(size_t i, const std::vector<Rigid3>& poses,
                                          const Vector6d& error, double log_scale) const {
    const Rigid3 seen = poses[i] * poses[i - 1].Inverse();
    const Eigen::Matrix3d R = seen.rotation.toRotationMatrix();
    const Eigen::Vector3d turned =
        RotationFromVector(error.head<3>()) * Step(i, log_scale).translation;
    ChainEquations::Jacobians jacobians{OfMoved(error), Matrix6d::Zero(), Vector6d::Zero()};
    jacobians.of_before.topLeftCorner<3, 3>() = -OfMoved(error).topLeftCorner<3, 3>() * R;
    jacobians.of_before.bottomRightCorner<3, 3>() = -R;
    jacobians.of_before.bottomLeftCorner<3, 3>() = -Skew(turned) * R;
    if (!scale_is_known_) jacobians.of_number.tail<3>() = -turned;
    return jacobians;
  }

  double Cost(const std::vector<Rigid3>& poses, double log_scale) const {
    double cost = 0;
    for (size_t i = 0; i < poses.size(); ++i) {
      if (const auto term = TermAt(i, poses[i])) cost += term->value.cost;
      if (i > 0) cost += of_steps_[i].At(StepError(i, poses[i - 1], poses[i], log_scale)).cost;
    }
    const double off = (log_scale - prior_log_scale_) / kPriorLogScale;
    return cost + off * off;
  }

  ChainEquations Equations(const std::vector<Rigid3>& poses, double log_scale) const {
    ChainEquations equations(poses.size());
    for (size_t i = 0; i < poses.size(); ++i) {
      if (const auto term = TermAt(i, poses[i])) {
        equations.Add(i, term->error, OfMoved(term->error), term->value.information);
      }
      if (i == 0) continue;
      const Vector6d error = StepError(i, poses[i - 1], poses[i], log_scale);
      equations.AddStep(i, error, StepJacobians(i, poses, error, log_scale),
                        of_steps_[i].At(error).information);
    }
    constexpr double kInformation = 1 / (kPriorLogScale * kPriorLogScale);
    equations.corner += kInformation;
    equations.corner_gradient += kInformation * (log_scale - prior_log_scale_);
    return equations;
  }

 private:
  static Information InformationOf(const SinglePose& single) {
    return Information(Matrix6d(single.covariance.inverse()));
  }

  // Returns the distribution of the error of a pose: right, right but less exact, or anywhere, as
  // Mixture::AddAnywhere() has it.
  Mixture OfPose(const Information& information, double right, double wrong,
                 double log_density_of_wrong) const {
    const Information less = information.Over(single_factor_);
    Mixture mixture;
    mixture.Add(right * (1 - kBroadShare), less);
    mixture.Add(right * kBroadShare, less.Over(kBroadVariance));
    mixture.AddAnywhere(wrong, log_density_of_wrong);
    return mixture;
  }

  // Returns the distributions of the errors of a frame's own poses.
  std::vector<Mixture> OfSingles(size_t i) const {
    std::vector<Mixture> mixtures;
    const std::vector<double> confidences = UsedConfidences(frames_[i].singles);
    const double wrong = 1 - std::accumulate(confidences.begin(), confidences.end(), 0.0);
    for (size_t k = 0; k < confidences.size(); ++k) {
      mixtures.push_back(OfPose(singles_[i][k], confidences[k], wrong, log_anywhere_));
    }
    return mixtures;
  }

  Mixture OfRematched(size_t i) const {
    const auto& rematched = frames_[i].rematched;
    if (!rematched) return {};
    const double right = UsedConfidences({&rematched->pose, 1}).front();
    return OfPose(InformationOf(rematched->pose), right, 1 - right,
                  -0.5 * std::log(rematched->predicted_covariance.determinant()));
  }

  // Returns the distribution of the error of a step.
  Mixture OfStep(size_t i) const {
    double rotation = noise_.rotation_variance * amounts_[i];
    double position = noise_.position_variance * amounts_[i];
    Mixture mixture;
    if (lost_steps_[i] > 0) {
      const auto among = static_cast<double>(lost_steps_[i]);
      rotation += 1 / among;
      position += 0.25 * extent_ * extent_ / among;
      mixture.Add(1, InverseDiagonal(rotation, position));
      return mixture;
    }
    const Information information = InverseDiagonal(rotation, position);
    mixture.Add(1 - kBroadShare, information);
    mixture.Add(kBroadShare, information.Over(kBroadVariance));
    return mixture;
  }

  std::span<const WalkEvidence> frames_;
  bool scale_is_known_;
  double prior_log_scale_;
  std::vector<double> amounts_;
  std::vector<Rigid3> steps_;                      // the odometry's, in its units; nothing at 0
  std::vector<std::vector<Information>> singles_;  // of each frame's own poses
  double extent_ = 1;
  double log_anywhere_ = 0;
  StepNoise prior_noise_;

  StepNoise noise_;
  double single_factor_ = 1;
  std::vector<size_t> lost_steps_;
  std::vector<std::vector<Mixture>> of_singles_;
  std::vector<Mixture> of_rematched_;
  std::vector<Mixture> of_steps_;
};

class WalkGraph {
 public:
  // `scale` is known or about right.
  WalkGraph(std::span<const WalkEvidence> frames, double scale, bool scale_is_known)
      : frames_(frames),
        scale_is_known_(scale_is_known),
        terms_(frames, scale, scale_is_known),
        log_scale_(std::log(scale)) {}

  // Initializes the poses from the anchors; returns false where no frame's pose is right.
  bool Begin() {
    const double wider = kSearchFactor * kSearchFactor;
    const StepNoise& noise = terms_.noise();
    const std::vector<Anchor> anchors = FindAnchors(
        frames_, Scale(), {wider * noise.position_variance, wider * noise.rotation_variance});
    if (anchors.empty()) return false;
    std::vector<size_t> lost_steps(frames_.size(), 0);
    for (size_t k = 1; k < anchors.size(); ++k) {
      if (!anchors[k].lost_before) continue;
      const size_t between = anchors[k].frame - anchors[k - 1].frame;
      for (size_t i = anchors[k - 1].frame + 1; i <= anchors[k].frame; ++i) {
        lost_steps[i] = between;
      }
    }
    poses_ = FromAnchors(anchors);
    terms_.TakeLostSteps(std::move(lost_steps));
    return true;
  }

  void Minimize() {
    for (int round = 0; round < kRounds; ++round) {
      MinimizePoses(kIterationsOfRound);
      if (!EstimateNoise()) break;
    }
    MinimizePoses(kIterations);
  }

  SmoothedWalk Result() const {
    SmoothedWalk walk;
    walk.scale = Scale();
    walk.step_sigma = std::sqrt(terms_.noise().position_variance);
    walk.step_rotation_sigma_deg = kDegPerRad * std::sqrt(terms_.noise().rotation_variance);
    walk.single_sigma_factor = std::sqrt(terms_.single_factor());
    const auto covariance = Invert(terms_.Equations(poses_, log_scale_));
    if (!covariance) return walk;
    walk.scale_sigma = scale_is_known_ ? 0 : Scale() * std::sqrt(covariance->corner);
    for (size_t i = 0; i < frames_.size(); ++i) {
      SmoothedFrame& frame = walk.frames.emplace_back();
      frame.cam_from_world = poses_[i];
      frame.covariance = covariance->diagonal[i];
      frame.lost_before = terms_.IsLost(i);
      const auto used = terms_.TermAt(i, poses_[i]);
      frame.predicted = Without(used, frame);
      if (frames_[i].rematched) {
        // The mixture's share is that at its mode.
        frame.rematched_agrees =
            std::min(used->value.shares[0] + used->value.shares[1],
                     UsedConfidences({&frames_[i].rematched->pose, 1}).front());
      }
      if (frames_[i].singles.empty()) continue;
      const WalkTerms::SingleTerm term = terms_.SingleAt(i, poses_[i]);
      frame.single_agrees = term.value.shares[0] + term.value.shares[1];
      frame.single = term.single;
    }
    return walk;
  }

 private:
  double Scale() const { return std::exp(log_scale_); }
  Rigid3 Step(size_t i) const { return terms_.Step(i, log_scale_); }

  // Takes the term of a frame's own pose out of the frame's distribution, which is the product of
  // both: its information is less by that of the term, W, and its mean away by S W e from the
  // smoothed pose, with what is left as covariance S and the term's error e.
  static std::optional<FramePrediction> Without(const std::optional<WalkTerms::SingleTerm>& term,
                                                const SmoothedFrame& frame) {
    if (!term) return FramePrediction{frame.cam_from_world, frame.covariance};
    const Matrix6d J = OfMoved(term->error);
    const Matrix6d of_term = J.transpose() * term->value.information * J;
    const Matrix6d of_all = frame.covariance.inverse();
    const Matrix6d rest = of_all - of_term;
    // What is left of a difference of nearly equal numbers is no information.
    constexpr double kLeastShare = 1e-6;
    const Vector6d unit = of_all.diagonal().cwiseSqrt().cwiseInverse();
    const Eigen::SelfAdjointEigenSolver<Matrix6d> shares(
        Matrix6d(unit.asDiagonal() * rest * unit.asDiagonal()));
    if (!(shares.eigenvalues().minCoeff() > kLeastShare)) return std::nullopt;
    const Matrix6d covariance = rest.inverse();
    const Vector6d pull = J.transpose() * term->value.information * term->error;
    return FramePrediction{Moved(frame.cam_from_world, covariance * pull), covariance};
  }

  // Returns each frame's pose by odometry from the pose that is known with the shortest way to it:
  // an anchor's, or one that was found where it was predicted.
  std::vector<Rigid3> FromAnchors(const std::vector<Anchor>& anchors) const {
    std::vector<Rigid3> poses(frames_.size());
    std::vector<double> way(frames_.size(), HUGE_VAL);
    for (const Anchor& anchor : anchors) {
      poses[anchor.frame] = frames_[anchor.frame].singles[anchor.single].cam_from_world;
      way[anchor.frame] = 0;
    }
    for (size_t i = 0; i < poses.size(); ++i) {
      if (!frames_[i].rematched) continue;
      poses[i] = frames_[i].rematched->pose.cam_from_world;
      way[i] = 0;
    }
    for (size_t i = 1; i < poses.size(); ++i) {
      const double from_before = way[i - 1] + terms_.Amount(i);
      if (!(from_before < way[i])) continue;
      way[i] = from_before;
      poses[i] = Step(i) * poses[i - 1];
    }
    for (size_t i = poses.size() - 1; i > 0; --i) {
      const double from_after = way[i] + terms_.Amount(i);
      if (!(from_after < way[i - 1])) continue;
      way[i - 1] = from_after;
      poses[i - 1] = Step(i).Inverse() * poses[i];
    }
    return poses;
  }

  // Minimizes the cost over the poses and the scale by Levenberg's and Marquardt's method.
  void MinimizePoses(int iterations) {
    double damping = 1e-6;
    double cost = terms_.Cost(poses_, log_scale_);
    std::optional<ChainEquations> equations;  // at poses_ and log_scale_
    for (int iteration = 0; iteration < iterations && damping < 1e6; ++iteration) {
      if (!equations) equations = terms_.Equations(poses_, log_scale_);
      const auto solution = Solve(*equations, damping);
      if (!solution) {
        damping *= 10;
        continue;
      }
      std::vector<Rigid3> moved = poses_;
      for (size_t i = 0; i < moved.size(); ++i) moved[i] = Moved(moved[i], solution->steps[i]);
      const double log_scale = log_scale_ + solution->number;
      const double moved_cost = terms_.Cost(moved, log_scale);
      if (!(moved_cost < cost)) {
        damping *= 10;
        continue;
      }
      const bool converged = cost - moved_cost < 1e-9 * (1 + std::abs(cost));
      poses_ = std::move(moved);
      log_scale_ = log_scale;
      equations.reset();
      cost = moved_cost;
      damping = std::max(1e-9, 0.1 * damping);
      if (converged) break;
    }
  }

  // A variance by which squared errors are divided, estimated by MacKay's rule: the sum of squares
  // over the number of those that the poses leave free.
  struct Variance {
    double squares, free;
    double Over(double prior, double weight) const {
      return (squares + weight * prior) / (std::max(free, 0.0) + weight);
    }
  };

  // Estimates the noise; returns false once nothing changes.
  bool EstimateNoise() {
    const auto covariance = Invert(terms_.Equations(poses_, log_scale_));
    if (!covariance) return false;
    Variance rotation{}, position{}, single{};
    for (size_t i = 0; i < frames_.size(); ++i) {
      if (!frames_[i].singles.empty() && !frames_[i].rematched) {
        CountSingle(i, *covariance, single);
      }
      if (i > 0 && !terms_.IsLost(i)) CountStep(i, *covariance, rotation, position);
    }
    const StepNoise before = terms_.noise();
    const double factor_before = terms_.single_factor();
    terms_.TakeNoise({position.Over(terms_.prior_noise().position_variance, kPriorWeight),
                      rotation.Over(terms_.prior_noise().rotation_variance, kPriorWeight)},
                     std::clamp(single.Over(1, kPriorFactorWeight), 0.5, 100.0));
    constexpr double kSame = 0.01;
    const auto differ = [](double a, double b) { return std::abs(std::log(a / b)) > kSame; };
    return differ(before.position_variance, terms_.noise().position_variance) ||
           differ(before.rotation_variance, terms_.noise().rotation_variance) ||
           differ(factor_before, terms_.single_factor());
  }

  void CountSingle(size_t i, const ChainCovariance& covariance, Variance& single) const {
    const WalkTerms::SingleTerm term = terms_.SingleAt(i, poses_[i]);
    const auto& shares = term.value.shares;
    const double share = shares[0] + shares[1] / kBroadVariance;
    const Matrix6d& information = terms_.InformationOfSingle(i, term.single).matrix;
    single.squares += share * term.error.dot(information * term.error);
    single.free += 6 * (shares[0] + shares[1]) -
                   share * (information * covariance.diagonal[i]).trace() / terms_.single_factor();
  }

  void CountStep(size_t i, const ChainCovariance& covariance, Variance& rotation,
                 Variance& position) const {
    const Vector6d error = terms_.StepError(i, poses_[i - 1], poses_[i], log_scale_);
    const auto shares = terms_.OfStepError(i).At(error).shares;
    const double share = (shares[0] + shares[1] / kBroadVariance) / terms_.Amount(i);
    const auto J = terms_.StepJacobians(i, poses_, error, log_scale_);
    const Matrix6d across = J.of_frame * covariance.below[i] * J.of_before.transpose();
    const Vector6d variance = (J.of_frame * covariance.diagonal[i] * J.of_frame.transpose() +
                               J.of_before * covariance.diagonal[i - 1] * J.of_before.transpose() +
                               across + across.transpose())
                                  .diagonal();
    rotation.squares += share * error.head<3>().squaredNorm();
    rotation.free += 3 - share * variance.head<3>().sum() / terms_.noise().rotation_variance;
    position.squares += share * error.tail<3>().squaredNorm();
    position.free += 3 - share * variance.tail<3>().sum() / terms_.noise().position_variance;
  }

  std::span<const WalkEvidence> frames_;
  bool scale_is_known_;
  WalkTerms terms_;
  std::vector<Rigid3> poses_;
  double log_scale_;
};

// Returns the scale that pairs of frames tell, where it contradicts the known one.
std::optional<double> ContradictingScale(std::span<const WalkEvidence> frames,
                                         const SmoothedWalk& walk) {
  constexpr double kSame = 1.2;
  size_t with_pose = 0, agreeing = 0;
  for (size_t i = 0; i < walk.frames.size(); ++i) {
    with_pose += frames[i].singles.empty() ? 0 : 1;
    agreeing += Agrees(walk.frames[i]) ? 1 : 0;
  }
  if (2 * agreeing >= with_pose) return std::nullopt;
  const std::optional<double> by_pairs = ScaleByPairs(frames);
  const bool is_other = by_pairs && std::max(*by_pairs, 1 / *by_pairs) >= kSame;
  return is_other ? by_pairs : std::nullopt;
}

}  // namespace

SmoothedWalk SmoothWalk(std::span<const WalkEvidence> frames, OdometryScale scale) {
  RAYLIFT_CHECK(frames.size() >= 2);
  const bool is_known = scale == OdometryScale::kKnown;
  const std::optional<double> start = is_known ? 1 : ScaleByPairs(frames);
  if (!start) return {.scale_is_observable = false};
  WalkGraph graph(frames, *start, is_known);
  if (!graph.Begin()) return {};
  graph.Minimize();
  SmoothedWalk walk = graph.Result();
  JudgeWalk(frames, walk);
  if (is_known) walk.contradicting_scale = ContradictingScale(frames, walk);
  return walk;
}

}  // namespace raylift
