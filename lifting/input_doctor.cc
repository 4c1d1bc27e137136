#include "raylift/lifting/input_doctor.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <string>
#include <utility>

#include "base/index_sets.h"
#include "base/statistics.h"
#include "diagnosis_text.h"
#include "match_agreement.h"
#include "mesh_frame.h"
#include "reading_errors.h"
#include "stored_faults.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"

namespace raylift {
namespace {

// Of images, that standard errors can rest on; a shift, whose gain is small, needs more.
constexpr size_t kFewestPairs = 10;
constexpr size_t kFewestPairsForShift = 40;
constexpr size_t kFewestKeypoints = 50;
// A smaller mean gain in c changes no result: errors that are smaller by a hundredth.
constexpr double kSmallestGain = 0.02;
// A scale nearer to 1 is a matter of calibration.
constexpr double kSmallestScaleChange = 0.03;

// Of the matches that agree with the poses, those that do so by more than chance; and of all
// matches those, at least. Images that do not overlap have wrong matches only.
constexpr double kLeastPurity = 0.7;
constexpr double kLeastAgreement = 0.03;
constexpr size_t kFewestAgreeing = 100;

// Of what is seen, a mesh in its place should have this much.
constexpr double kLeastCoverageOfPlaced = 0.4;
// A surface that a few rays happen to meet rightly (the ground of a mirrored mesh) proves little.
constexpr double kLeastCoverage = 0.25;

using ErrorsPx = std::vector<std::optional<double>>;

std::vector<double> Known(const ErrorsPx& errors) {
  std::vector<double> known;
  for (const auto& error : errors) {
    if (error) known.push_back(*error);
  }
  return known;
}

double Cost(double error_px) { return std::log1p(error_px * error_px); }

// How much better one explanation is than another.
struct Gain {
  double mean = 0;
  double sigmas = 0;
};

struct RunningSum {
  double sum = 0;
  double count = 0;

  void Add(double value) {
    sum += value;
    count += 1;
  }
};

// By pairs of images, whose matches share the errors of their poses.
Gain Compare(const ReadingErrors& data, const ErrorsPx& former, const ErrorsPx& other) {
  std::map<std::pair<int, int>, RunningSum> of_pair;
  RunningSum all;
  for (size_t i = 0; i < former.size(); ++i) {
    if (!former[i] || !other[i]) continue;
    const double gain = Cost(*former[i]) - Cost(*other[i]);
    const ReadingErrors::Keypoint& keypoint = data.keypoints()[i];
    of_pair[std::minmax(keypoint.map, keypoint.other)].Add(gain);
    all.Add(gain);
  }
  if (all.count < kFewestKeypoints || of_pair.size() < kFewestPairs) return {};
  const double mean = all.sum / all.count;
  double squares = 0;
  for (const auto& [pair, part] : of_pair) {
    const double deviation = part.sum - part.count * mean;
    squares += deviation * deviation;
  }
  const auto pairs = static_cast<double>(of_pair.size());
  const double standard_error = std::sqrt(squares * pairs / (pairs - 1)) / all.count;
  // Where all gain alike there is no doubt.
  return {mean, mean / std::max(standard_error, 1e-6)};
}

// A reading, and the errors with each map at its own scale.
struct Candidate {
  InputReading reading;
  ErrorsPx own_scale;
  CommonScale common;
};

std::vector<Candidate> Explain(const ReadingErrors& data, std::vector<InputReading> readings,
                               int threads) {
  std::vector<Candidate> candidates(readings.size());
  ParallelFor(readings.size(), threads, [&](size_t i) {
    const InputReading& reading = readings[i];
    const MapScales scales = data.FitScales(reading);
    candidates[i] = {reading, data.Errors(reading, scales.log_factors), scales.common};
  });
  return candidates;
}

// All combinations of kind and orientation, with the poses by which the matches agree; as read
// first.
std::vector<InputReading> DiscreteReadings(const DoctorInput& input, PoseConvention poses) {
  using enum MapOrientation;
  const InputReading& as_read = input.as_read;
  std::vector<InputReading> readings = {as_read};
  const bool maps = input.map_size_px.has_value();
  for (const auto kind : {DepthKind::kZ, DepthKind::kRay, DepthKind::kInverse}) {
    for (const auto relative : {kAsStored, kFlippedX, kFlippedY, kHalfTurn, kTransposed}) {
      const auto orientation = Combined(as_read.orientation, relative);
      if (!orientation || (!maps && (kind != as_read.kind || relative != kAsStored))) continue;
      InputReading reading = as_read;
      reading.kind = kind;
      reading.orientation = *orientation;
      reading.poses = poses;
      if (!(reading == as_read)) readings.push_back(reading);
    }
  }
  return readings;
}

std::vector<ReferenceMatch> Evenly(std::span<const ReferenceMatch> matches, size_t most) {
  std::vector<ReferenceMatch> chosen;
  for (const size_t i : EvenlySpaced(matches.size(), most)) chosen.push_back(matches[i]);
  return chosen;
}

size_t NumPairs(std::span<const ReferenceMatch> matches) {
  std::set<std::pair<int, int>> pairs;
  for (const ReferenceMatch& m : matches) pairs.insert(std::minmax(m.reference_a, m.reference_b));
  return pairs.size();
}

// About as exact as the matches themselves.
bool IsExact(const ReadingFit& fit, double yardstick_px) {
  constexpr double kYardsticks = 4;
  return fit.median_px <= kYardsticks * std::max(yardstick_px, 0.5);
}

// What repairs must be: far nearer to the matches than depths at random, and with few exceptions.
bool IsGood(const ReadingFit& fit, double yardstick_px) {
  constexpr double kOfChance = 0.25;
  constexpr double kUpperOfChance = 0.4;
  return (IsExact(fit, yardstick_px) || fit.median_px <= kOfChance * fit.median_chance_px) &&
         fit.upper_px <= std::max(kUpperOfChance * fit.upper_chance_px, 8 * yardstick_px);
}

// What may pass as it is read where nothing explains the matches better: noisy depth.
bool IsPassable(const ReadingFit& fit, double yardstick_px) {
  constexpr double kOfChance = 0.5;
  constexpr double kUpperOfChance = 0.3;
  return IsGood(fit, yardstick_px) || (fit.median_px <= kOfChance * fit.median_chance_px &&
                                       fit.upper_px <= kUpperOfChance * fit.upper_chance_px);
}

class Examination {
 public:
  Examination(const DoctorInput& input, const DoctorOptions& options)
      : input_(input), options_(options) {
    diagnosis_.as_read = input.as_read;
    diagnosis_.best = input.as_read;
  }

  Diagnosis Run() {
    if (!KeepAgreeingMatches()) return diagnosis_;
    data_.emplace(input_, matches_);
    const StoredStatistics statistics = LookAtMaps(input_, options_.threads);
    MaskExtremes(statistics);
    Examine();
    Judge(statistics);
    ListEvidence();
    return diagnosis_;
  }

 private:
  void Say(InputVerdict verdict, InputFault fault, std::string reason) {
    diagnosis_.verdict = verdict;
    diagnosis_.fault = fault;
    diagnosis_.reason = std::move(reason);
  }

  // False: there are not enough to go on with.
  bool TooFewMatches(std::string reason) {
    Say(InputVerdict::kTooFewMatches, InputFault::kNone, std::move(reason));
    return false;
  }

  // With the convention of poses that the matches agree with.
  MatchAgreement BestAgreement(std::span<const ReferenceMatch> matches) const {
    const auto agreement = [&](PoseConvention poses) {
      return Agreement(input_.references, matches, input_.as_read.poses, poses, options_.threads);
    };
    // Others must agree far better: with few matches chance may play.
    constexpr double kFarBetter = 0.1;
    MatchAgreement best = agreement(input_.as_read.poses);
    const double as_read_skill = best.Skill();
    for (const PoseConvention poses : AllValues<PoseConvention>()) {
      if (poses == input_.as_read.poses) continue;
      MatchAgreement other = agreement(poses);
      if (other.Skill() > as_read_skill + kFarBetter && other.Skill() > best.Skill()) {
        best = std::move(other);
      }
    }
    return best;
  }

  // Whether there are enough; else the diagnosis says so.
  bool KeepAgreeingMatches() {
    const std::vector<ReferenceMatch> all = Evenly(input_.matches, options_.max_matches);
    diagnosis_.num_matches = all.size();
    if (2 * all.size() < kFewestKeypoints || NumPairs(all) < kFewestPairs) {
      return TooFewMatches(DescribeFewMatches(all.size(), NumPairs(all)));
    }
    const MatchAgreement best = BestAgreement(all);
    for (size_t i = 0; i < all.size(); ++i) {
      if (best.agrees[i]) matches_.push_back(all[i]);
    }
    diagnosis_.num_agreeing = best.num_agreeing;
    diagnosis_.epipolar_px = best.median_px;
    yardstick_px_ = best.median_px;
    poses_ = best.poses;
    constexpr size_t kFewestAtRandom = 20;
    if (best.num_random < kFewestAtRandom) return TooFewMatches(DescribeFewAtRandom(best));
    // Where even wrong matches fit, right ones prove nothing.
    constexpr double kMostByChance = 0.5;
    if (best.chance > kMostByChance) return TooFewMatches(DescribeChance(best));
    if (best.Purity() < kLeastPurity || best.Skill() < kLeastAgreement) {
      const std::string reason = DescribeDisagreement(best, all, input_.references);
      if (all.size() < kFewestAgreeing) return TooFewMatches(reason);
      Say(InputVerdict::kNothingFits, InputFault::kPoses, reason);
      return false;
    }
    if (2 * matches_.size() < kFewestKeypoints || NumPairs(matches_) < kFewestPairs) {
      return TooFewMatches(DescribeFewAgreeing(best, NumPairs(matches_)));
    }
    return true;
  }

  // Keypoints there are asked by themselves.
  void MaskExtremes(const StoredStatistics& statistics) {
    for (const StoredExtreme& extreme : statistics.extremes) {
      data_->MaskStored(extreme.value * input_.stored->unit);
      masked_.push_back(extreme);
    }
  }

  void Examine() {
    const std::vector<InputReading> readings = DiscreteReadings(input_, poses_);
    data_->Prepare(readings, options_.threads);
    candidates_ = Explain(*data_, readings, options_.threads);
    Candidate best = candidates_[ChooseDiscrete()];
    if (input_.map_size_px) {
      if (options_.half_pixels && data_->NumPairs() >= kFewestPairsForShift)
        best = ChooseShift(best);
      diagnosis_.best = ChooseScale(best);
    } else {
      diagnosis_.best = best.reading;
    }
  }

  ReadingFit FitOf(const InputReading& reading) const {
    return data_->FitOf(reading, data_->FitScales(reading).log_factors);
  }

  // What the best reading is worth in itself, and what else is wrong.
  void Judge(const StoredStatistics& statistics) {
    const InputReading best = diagnosis_.best;
    const ReadingFit fit = FitOf(best);
    diagnosis_.fit = fit;
    if (!TellsDepth(fit)) {
      diagnosis_.best = input_.as_read;
      Say(InputVerdict::kTooFewMatches, InputFault::kNone, kViewsTooClose);
      return;
    }
    const bool is_as_read = best == input_.as_read;
    const bool covered = input_.map_size_px || fit.coverage >= kLeastCoverage;
    const bool accepted =
        best.poses == poses_ && covered && fit.count >= kFewestKeypoints &&
        (IsGood(fit, yardstick_px_) || (is_as_read && IsPassable(fit, yardstick_px_)));
    if (FindWrapFault(statistics, accepted)) return;
    if (!accepted && IsMeshInPlace()) {
      // Limits of what is lifted are the user's choice where what they leave fits.
      if (fit.count >= kFewestKeypoints && IsGood(fit, yardstick_px_)) return AcceptBest(fit);
      return NothingFits(InputFault::kNone, kLimitsDrop);
    }
    if (input_.mesh != nullptr && options_.mesh_frames && FindMeshFrame(accepted)) return;
    if (input_.map_size_px && FindAffineFault(accepted)) return;
    if (accepted) return AcceptBest(fit);
    if (best.poses != poses_) {
      return NothingFits(InputFault::kPoses, DescribeOtherPoses(poses_, input_.as_read.poses));
    }
    NothingFits(InputFault::kNone, WhyNothingFits(fit));
  }

  // Whether the mesh itself is good as read.
  bool IsMeshInPlace() const {
    if (input_.mesh == nullptr || diagnosis_.best.poses != poses_) return false;
    const MeshFrameSearch search(*input_.mesh, input_, *data_, diagnosis_.best, options_.threads);
    const ReadingFit whole = search.Judge({}).fit;
    return whole.count >= kFewestKeypoints && whole.coverage >= kLeastCoverageOfPlaced &&
           IsGood(whole, yardstick_px_);
  }

  // Where all depths project to about the same place, no depth is right or wrong.
  bool TellsDepth(const ReadingFit& fit) const {
    constexpr double kYardsticks = 4;
    constexpr double kWrongBy = 0.3;  // of log z
    std::vector<double> gains_px;
    for (const auto& depth : data_->Triangulated(poses_)) {
      if (depth) gains_px.push_back(depth->gain_px);
    }
    const double exact_px = kYardsticks * std::max(yardstick_px_, 0.5);
    const bool few = gains_px.size() < kFewestKeypoints;
    const bool as_by_chance = fit.count >= kFewestKeypoints && fit.median_chance_px <= exact_px &&
                              kWrongBy * UpperMedianOr(std::move(gains_px), 0) <= exact_px;
    return !few && !as_by_chance;
  }

  // Whether the diagnosis is that.
  bool FindWrapFault(const StoredStatistics& statistics, bool accepted) {
    InputReading as_read = input_.as_read;
    as_read.poses = poses_;
    const auto wrap = FindWrap(input_, *data_, as_read, statistics.largest, yardstick_px_, IsGood);
    if (!wrap) return false;
    const InputReading& best = diagnosis_.best;
    if (accepted &&
        !IsFarBetter(Compare(*data_, data_->Errors(best, data_->FitScales(best).log_factors),
                             wrap->errors_px))) {
      return false;
    }
    NothingFits(InputFault::kWrap, Describe(*wrap));
    return true;
  }

  // Whether the diagnosis is that. Where a reading is good, it must be one that a shift of inverse
  // depth, or of depth, may be hidden behind.
  bool FindAffineFault(bool accepted) {
    const InputReading& best = diagnosis_.best;
    const bool inverse = best.kind == DepthKind::kInverse;
    std::vector<AffineForm> forms = {{true, true}, {false, true}, {true, false}, {false, false}};
    if (accepted && inverse) forms = {{true, true}, {true, false}};
    if (accepted && !inverse) forms = {{false, true}};
    if (accepted && !inverse && best.scale == input_.as_read.scale) return false;
    InputReading stored = input_.as_read;
    stored.poses = poses_;
    stored.orientation = best.orientation;
    const auto affine = FindAffine(input_, *data_, stored, forms, yardstick_px_, IsGood);
    if (!affine) return false;
    if (accepted) {
      constexpr double kGreatGain = 0.1;
      const Gain gain = Compare(*data_, data_->Errors(best, data_->FitScales(best).log_factors),
                                affine->errors_px);
      if (!IsFarBetter(gain) || gain.mean < kGreatGain) return false;
    }
    NothingFits(affine->form.inverse ? InputFault::kDisparity : InputFault::kAffine,
                Describe(*affine));
    return true;
  }

  void NothingFits(InputFault fault, std::string reason) {
    diagnosis_.best = input_.as_read;
    Say(InputVerdict::kNothingFits, fault, std::move(reason));
  }

  // As meant or a repair; values that are cut off are taken for none.
  void AcceptBest(const ReadingFit& fit) {
    std::vector<std::string> reasons;
    std::vector<float> invalid;  // in the digits that tell floats apart
    for (const StoredExtreme& extreme : masked_) {
      if (const auto clamp = FindClampAt(extreme, fit)) {
        reasons.push_back(Describe(*clamp));
        invalid.push_back(static_cast<float>(extreme.value));
      }
    }
    diagnosis_.repair = FindRepair(input_.as_read, diagnosis_.best);
    if (!(diagnosis_.best == input_.as_read)) {
      reasons.insert(reasons.begin(), DescribeDifference(input_.as_read, diagnosis_.best));
    }
    if (reasons.empty()) return;
    if (!invalid.empty()) {
      invalid.insert(invalid.begin(), input_.stored->invalid_values.begin(),
                     input_.stored->invalid_values.end());
      diagnosis_.repair.geometry_keys.push_back(fmt::format("invalid={}", fmt::join(invalid, "/")));
    }
    Say(InputVerdict::kRepair, invalid.empty() ? InputFault::kNone : InputFault::kClamp,
        fmt::format("{}", fmt::join(reasons, "; ")));
  }

  std::optional<ClampFault> FindClampAt(const StoredExtreme& extreme, const ReadingFit& fit) const {
    // The same keypoints without the mask of this value.
    ReadingErrors unmasked(input_, matches_);
    for (const StoredExtreme& other : masked_) {
      if (&other != &extreme) unmasked.MaskStored(other.value * input_.stored->unit);
    }
    const InputReading& best = diagnosis_.best;
    unmasked.Prepare({&best, 1}, options_.threads);
    return FindClamp(*data_, unmasked, best, extreme, std::max(fit.median_px, yardstick_px_));
  }

  std::string WhyNothingFits(const ReadingFit& fit) const {
    std::optional<MeshSearch> search;
    if (input_.mesh != nullptr) search = mesh_search_;
    if (fit.count < kFewestKeypoints) return DescribeFewDepths(fit, masked_, search);
    if (!input_.map_size_px && fit.coverage < kLeastCoverage) {
      return DescribeFewRaysMet(fit, search);
    }
    return DescribeMisfit(input_, fit, yardstick_px_, search);
  }

  // Whether the diagnosis is that. Where the mesh as read is good, only for far smaller errors.
  bool FindMeshFrame(bool accepted) {
    InputReading reading = input_.as_read;
    reading.poses = poses_;
    const ErrorsPx as_read = data_->Errors(reading, 0);
    const ReadingFit as_read_fit = FitOf(reading);
    // With rays that pass it by.
    const double as_read_px = UpperMedianOr(Known(as_read), ReadingErrors::kLargestPx);
    constexpr double kExact = 2;  // about as exact as it can become
    if (accepted && as_read_px < kExact * std::max(yardstick_px_, 0.5)) return false;
    const MeshFrameSearch search(*input_.mesh, input_, *data_, reading, options_.threads);
    mesh_search_ = search.Obstacle();
    if (mesh_search_ != MeshSearch::kNoneFound) return false;
    std::vector<PlacedMesh> found = search.Find();
    if (!found.empty()) mesh_search_ = MeshSearch::kRejected;
    const double largest_px = accepted ? 0.6 * as_read_px : std::numeric_limits<double>::infinity();
    std::erase_if(found, [&](const PlacedMesh& placed) {
      return placed.fit.count < kFewestKeypoints || placed.fit.coverage < kLeastCoverageOfPlaced ||
             !IsGood(placed.fit, yardstick_px_) || placed.fit.median_px > largest_px ||
             !IsFarBetter(Compare(*data_, as_read, placed.errors_px));
    });
    if (found.empty()) return false;
    const PlacedMesh& best = *std::min_element(
        found.begin(), found.end(),
        [](const auto& a, const auto& b) { return a.fit.median_px < b.fit.median_px; });
    // A symmetric scene has several frames.
    const auto about_as_good = std::count_if(found.begin(), found.end(), [&](const auto& other) {
      return &other != &best && !IsFarBetter(Compare(*data_, other.errors_px, best.errors_px));
    });
    if (about_as_good > 0) {
      NothingFits(InputFault::kMeshFrame, DescribeManyPlaces(about_as_good + 1));
      return true;
    }
    diagnosis_.fit = best.fit;
    if (best.placement.IsIdentity()) {
      NothingFits(InputFault::kNone, kLimitsDrop);
      return true;
    }
    diagnosis_.best = reading;
    diagnosis_.mesh_placement = best.from_files;
    diagnosis_.repair = FindRepair(input_.as_read, reading);
    const std::string keys = KeysOf(best.from_files);
    const std::string keys_as_read = KeysOf(input_.as_placed);
    if (!keys.empty()) diagnosis_.repair.geometry_keys.push_back(keys);
    if (!keys_as_read.empty()) {
      diagnosis_.repair.replaced_keys.push_back(keys.empty() ? keys_as_read
                                                             : "scale, axes, shift, matrix");
    }
    Say(InputVerdict::kRepair, InputFault::kMeshFrame,
        DescribePlace(best, input_.as_placed,
                      as_read_fit.count == 0 ? std::nullopt : std::optional(as_read_px)));
    return true;
  }

  bool IsFarBetter(const Gain& gain) const {
    return gain.sigmas >= options_.min_sigmas && gain.mean >= kSmallestGain;
  }

  // The best of the readings with the fewest changes: one more must pay for itself.
  size_t ChooseDiscrete() const {
    size_t best = 0;
    for (int changes = 1; changes <= 3; ++changes) {
      size_t next = best;
      Gain largest;
      for (size_t i = 0; i < candidates_.size(); ++i) {
        if (NumDifferences(input_.as_read, candidates_[i].reading) != changes) continue;
        const Gain gain = Compare(*data_, candidates_[best].own_scale, candidates_[i].own_scale);
        if (IsFarBetter(gain) && gain.mean > largest.mean) {
          largest = gain;
          next = i;
        }
      }
      best = next;
    }
    return best;
  }

  Candidate ChooseShift(const Candidate& best) {
    std::vector<InputReading> readings;
    for (const double first_sample_px : {0.0, 0.5, 1.0}) {
      InputReading shifted = best.reading;
      shifted.first_sample_px = first_sample_px;
      if (std::abs(first_sample_px - input_.as_read.first_sample_px) == 0.5) {
        readings.push_back(shifted);
      }
    }
    data_->Prepare(readings, options_.threads);
    const Candidate* chosen = &best;
    Gain largest;
    const std::vector<Candidate> shifted = Explain(*data_, readings, options_.threads);
    for (const Candidate& candidate : shifted) {
      const Gain gain = Compare(*data_, best.own_scale, candidate.own_scale);
      if (IsFarBetter(gain) && gain.mean > largest.mean) {
        largest = gain;
        chosen = &candidate;
      }
    }
    const Candidate result = *chosen;
    candidates_.insert(candidates_.end(), shifted.begin(), shifted.end());
    return result;
  }

  // The reading at the maps' common scale where that explains the data far better.
  InputReading ChooseScale(const Candidate& candidate) const {
    const double log_factor = KnownUnit(candidate.common.log_factor);
    if (std::abs(log_factor) <
        std::max(options_.min_sigmas * candidate.common.standard_error, kSmallestScaleChange)) {
      return candidate.reading;
    }
    const Gain gain = Compare(*data_, data_->Errors(candidate.reading, 0),
                              data_->Errors(candidate.reading, log_factor));
    return IsFarBetter(gain) ? Scaled(candidate.reading, log_factor) : candidate.reading;
  }

  ReadingEvidence Evidence(const InputReading& reading) const {
    const ErrorsPx errors = data_->Errors(reading, 0);
    const InputReading& as_read = input_.as_read;
    ReadingEvidence evidence{.reading = reading};
    const std::vector<double> known = Known(errors);
    const auto within =
        std::count_if(known.begin(), known.end(), [](double error) { return error <= 5; });
    evidence.num_keypoints = known.size();
    evidence.median_px = UpperMedianOr(known, 0);
    evidence.share_within_5px =
        static_cast<double>(within) / std::max<double>(1, static_cast<double>(known.size()));
    const ErrorsPx own_scale = data_->Errors(reading, data_->FitScales(reading).log_factors);
    evidence.median_own_scale_px = UpperMedianOr(Known(own_scale), 0);
    const Gain gain =
        reading.scale != as_read.scale
            ? Compare(*data_, data_->Errors(as_read, 0), errors)
            : Compare(*data_, data_->Errors(as_read, data_->FitScales(as_read).log_factors),
                      own_scale);
    evidence.gain = gain.mean;
    evidence.sigmas = gain.sigmas;
    return evidence;
  }

  // Of as read, every single change, and the best.
  void ListEvidence() {
    std::vector<InputReading> readings = {diagnosis_.best};
    const auto add = [&](const InputReading& reading) {
      if (std::find(readings.begin(), readings.end(), reading) == readings.end()) {
        readings.push_back(reading);
      }
    };
    for (const Candidate& candidate : candidates_) {
      const InputReading reading = input_.map_size_px ? ChooseScale(candidate) : candidate.reading;
      if (reading.scale != input_.as_read.scale && candidate.reading == input_.as_read) {
        add(reading);
      }
      if (NumDifferences(input_.as_read, candidate.reading) <= 1) add(candidate.reading);
    }
    std::vector<ReadingEvidence>& listed = diagnosis_.readings;
    listed.resize(readings.size());
    ParallelFor(readings.size(), options_.threads,
                [&](size_t i) { listed[i] = Evidence(readings[i]); });
    std::stable_sort(listed.begin() + 1, listed.end(),
                     [](const ReadingEvidence& a, const ReadingEvidence& b) {
                       return a.median_own_scale_px < b.median_own_scale_px;
                     });
  }

  const DoctorInput& input_;
  const DoctorOptions& options_;
  std::vector<ReferenceMatch> matches_;  // that agree with the poses
  double yardstick_px_ = 0;
  PoseConvention poses_ = PoseConvention::kCamFromWorld;  // by which they agree
  std::optional<ReadingErrors> data_;
  std::vector<StoredExtreme> masked_;
  std::vector<Candidate> candidates_;
  MeshSearch mesh_search_ = MeshSearch::kNotSearched;
  Diagnosis diagnosis_;
};

}  // namespace

DoctorInput MakeDoctorInput(const NamedGeometry& geometry, std::span<const PosedImage> references,
                            std::span<const ReferenceMatch> matches, PoseConvention poses) {
  DoctorInput input{.source = *geometry.source,
                    .references = references,
                    .matches = matches,
                    .as_read = geometry.depth_reading.value_or(InputReading{})};
  input.as_read.poses = poses;
  input.mesh = geometry.mesh;
  input.as_placed = geometry.placement;
  if (geometry.maps != nullptr) {
    input.map_size_px = geometry.maps->size_px();
    input.stored = {.load = [maps = geometry.maps](
                                const PosedImage& reference) { return maps->Load(reference); },
                    .unit = geometry.maps->unit(),
                    .invalid_values = geometry.maps->convention().invalid_values};
  }
  return input;
}

const ReadingEvidence& Diagnosis::EvidenceOf(const InputReading& reading) const {
  const auto found =
      std::find_if(readings.begin(), readings.end(),
                   [&](const ReadingEvidence& evidence) { return evidence.reading == reading; });
  RAYLIFT_CHECK(found != readings.end());
  return *found;
}

Diagnosis Diagnose(const DoctorInput& input, const DoctorOptions& options) {
  return Examination(input, options).Run();
}

}  // namespace raylift
