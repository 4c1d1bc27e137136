#include "raylift/diagnosis/doctor.h"

#include <algorithm>
#include <limits>
#include <set>
#include <utility>

#include "base/index_sets.h"
#include "base/statistics.h"
#include "diagnosis/convention_residuals.h"
#include "diagnosis/convention_search.h"
#include "diagnosis/diagnosis_text.h"
#include "diagnosis/match_agreement.h"
#include "diagnosis/mesh_frame.h"
#include "diagnosis/stored_faults.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"

namespace raylift {
namespace {

// The least share of the agreeing matches that agree by more than chance, and the least share of
// all matches. Images that do not overlap have wrong matches only.
constexpr double kLeastPurity = 0.7;
constexpr double kLeastAgreement = 0.03;
constexpr size_t kFewestAgreeing = 100;

// The largest median error of what may pass, of that of depths at random.
constexpr double kPassableOfChance = 0.5;

// A mesh in its place should cover this share of the keypoints.
constexpr double kLeastCoverageOfPlaced = 0.4;

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

bool IsExact(const ConventionFit& fit, double baseline_error_px) {
  return fit.median_px <= ExactPx(baseline_error_px);
}

// Returns whether a fit is good: repairs must be far nearer to the matches than depths at random,
// with few exceptions.
bool IsGood(const ConventionFit& fit, double baseline_error_px) {
  constexpr double kOfChance = 0.25;
  constexpr double kUpperOfChance = 0.4;
  return (IsExact(fit, baseline_error_px) || fit.median_px <= kOfChance * fit.median_chance_px) &&
         fit.upper_px <= std::max(kUpperOfChance * fit.upper_chance_px, 8 * baseline_error_px);
}

// Returns whether a fit may pass as it is read where nothing explains the matches better, as that
// of noisy depth.
bool IsPassable(const ConventionFit& fit, double baseline_error_px) {
  constexpr double kUpperOfChance = 0.3;
  return IsGood(fit, baseline_error_px) ||
         (fit.median_px <= kPassableOfChance * fit.median_chance_px &&
          fit.upper_px <= kUpperOfChance * fit.upper_chance_px);
}

void Say(Diagnosis& diagnosis, InputVerdict verdict, InputFault fault, std::string reason) {
  diagnosis.verdict = verdict;
  diagnosis.fault = fault;
  diagnosis.reason = std::move(reason);
}

// Finds the convention of poses that the matches agree with.
MatchAgreement BestAgreement(const DoctorInput& input, std::span<const ReferenceMatch> matches,
                             int threads) {
  const auto agreement = [&](PoseConvention poses) {
    return Agreement(input.references, matches, input.as_read.poses, poses, threads);
  };
  // Others must agree far better: with few matches chance may play.
  constexpr double kFarBetter = 0.1;
  MatchAgreement best = agreement(input.as_read.poses);
  const double as_read_skill = best.Skill();
  for (const PoseConvention poses : AllValues<PoseConvention>()) {
    if (poses == input.as_read.poses) continue;
    MatchAgreement other = agreement(poses);
    if (other.Skill() > as_read_skill + kFarBetter && other.Skill() > best.Skill()) {
      best = std::move(other);
    }
  }
  return best;
}

struct AgreeingMatches {
  std::vector<ReferenceMatch> matches = {};
  PoseConvention poses = PoseConvention::kCamFromWorld;  // by which they agree
  double baseline_error_px = 0;
};

// Returns nullopt where there are not enough, as the diagnosis then says.
std::optional<AgreeingMatches> KeepAgreeingMatches(const DoctorInput& input,
                                                   const DoctorOptions& options,
                                                   Diagnosis& diagnosis) {
  const auto too_few = [&](std::string reason) {
    Say(diagnosis, InputVerdict::kTooFewMatches, InputFault::kNone, std::move(reason));
    return std::nullopt;
  };
  const std::vector<ReferenceMatch> all = Evenly(input.matches, options.max_matches);
  diagnosis.num_matches = all.size();
  if (2 * all.size() < kFewestKeypoints || NumPairs(all) < kFewestPairs) {
    return too_few(DescribeFewMatches(all.size(), NumPairs(all)));
  }
  const MatchAgreement best = BestAgreement(input, all, options.threads);
  AgreeingMatches agreeing{.poses = best.poses, .baseline_error_px = best.median_px};
  for (size_t i = 0; i < all.size(); ++i) {
    if (best.agrees[i]) agreeing.matches.push_back(all[i]);
  }
  diagnosis.num_agreeing = best.num_agreeing;
  diagnosis.epipolar_px = best.median_px;
  constexpr size_t kFewestAtRandom = 20;
  if (best.num_random < kFewestAtRandom) return too_few(DescribeFewAtRandom(best));
  // Where even wrong matches fit, right ones prove nothing.
  constexpr double kMostByChance = 0.5;
  if (best.chance > kMostByChance) return too_few(DescribeChance(best));
  if (best.Purity() < kLeastPurity || best.Skill() < kLeastAgreement) {
    const std::string reason = DescribeDisagreement(best, all, input.references);
    if (all.size() < kFewestAgreeing) return too_few(reason);
    Say(diagnosis, InputVerdict::kNothingFits, InputFault::kPoses, reason);
    return std::nullopt;
  }
  if (2 * agreeing.matches.size() < kFewestKeypoints || NumPairs(agreeing.matches) < kFewestPairs) {
    return too_few(DescribeFewAgreeing(best, NumPairs(agreeing.matches)));
  }
  return agreeing;
}

// Returns whether depth can be told at all: where all depths project to about the same place, no
// depth is right or wrong.
bool TellsDepth(const ConventionFit& fit, const ConventionResiduals& data, PoseConvention poses,
                double baseline_error_px) {
  constexpr double kWrongBy = 0.3;  // of log z
  std::vector<double> gains_px;
  for (const auto& depth : data.Triangulated(poses)) {
    if (depth) gains_px.push_back(depth->gain_px);
  }
  const double exact_px = ExactPx(baseline_error_px);
  const bool few = gains_px.size() < kFewestKeypoints;
  const bool as_by_chance = fit.count >= kFewestKeypoints && fit.median_chance_px <= exact_px &&
                            kWrongBy * UpperMedianOr(std::move(gains_px), 0) <= exact_px;
  return !few && !as_by_chance;
}

// Returns the forms of a fault that a convention which is good may hide: a shift of inverse depth,
// or of depth.
std::vector<AffineForm> FormsBehind(const DataConvention& good, const DataConvention& as_read) {
  if (good.kind == DepthKind::kInverse) return {{true, true}, {true, false}};
  if (good.scale == as_read.scale) return {};
  return {{false, true}};
}

// Returns the residuals with the keypoints at extremes masked, except at the one that `except`
// points to.
ConventionResiduals& MaskExtremes(const DoctorInput& input, std::span<const StoredExtreme> extremes,
                                  const StoredExtreme* except, ConventionResiduals& data) {
  for (const StoredExtreme& extreme : extremes) {
    if (&extreme != except) data.MaskStored(extreme.value * input.stored->unit);
  }
  return data;
}

// `data` has the keypoints at all extremes masked.
std::vector<ClampFault> FindClamps(const DoctorInput& input,
                                   std::span<const ReferenceMatch> matches,
                                   std::span<const StoredExtreme> extremes,
                                   const ConventionResiduals& data, const DataConvention& best,
                                   double error_px, int threads) {
  std::vector<ClampFault> clamps;
  for (const StoredExtreme& extreme : extremes) {
    // The same keypoints without the mask of this value.
    ConventionResiduals unmasked(input, matches);
    MaskExtremes(input, extremes, &extreme, unmasked);
    unmasked.Prepare({&best, 1}, threads);
    if (const auto clamp = FindClamp(data, unmasked, best, extreme, error_px)) {
      clamps.push_back(*clamp);
    }
  }
  return clamps;
}

bool IsGoodPlace(const ConventionFit& fit, double baseline_error_px) {
  return fit.count >= kFewestKeypoints && fit.coverage >= kLeastCoverageOfPlaced &&
         IsGood(fit, baseline_error_px);
}

// Returns the repair of a mesh that belongs elsewhere than it was placed as read.
RepairOptions RepairOfPlace(const DoctorInput& input, const DataConvention& convention,
                            const MeshPlacement& from_files) {
  RepairOptions repair = FindRepair(input.as_read, convention);
  const std::string keys = KeysOf(from_files);
  const std::string keys_as_read = KeysOf(input.as_placed);
  if (!keys.empty()) repair.geometry_keys.push_back(keys);
  if (!keys_as_read.empty()) {
    repair.replaced_keys.push_back(keys.empty() ? keys_as_read : "scale, axes, shift, matrix");
  }
  return repair;
}

class Examination {
 public:
  // `diagnosis` already knows of the matches.
  Examination(const DoctorInput& input, const DoctorOptions& options, AgreeingMatches agreeing,
              Diagnosis diagnosis)
      : input_(input),
        options_(options),
        matches_(std::move(agreeing.matches)),
        baseline_error_px_(agreeing.baseline_error_px),
        poses_(agreeing.poses),
        data_(input, matches_),
        statistics_(LookAtMaps(input, options.threads)),
        search_(input, options, poses_, MaskExtremes(input, statistics_.extremes, nullptr, data_)),
        diagnosis_(std::move(diagnosis)) {}

  Diagnosis Run() {
    diagnosis_.best = search_.best();
    Judge();
    diagnosis_.conventions = search_.ListEvidence(diagnosis_.best);
    return diagnosis_;
  }

 private:
  ConventionFit FitOf(const DataConvention& convention) const {
    return data_.FitOf(convention, data_.FitScales(convention).log_factors);
  }
  const ConventionFit& LimitChance(const DataConvention& convention, ConventionFit& fit) const {
    data_.LimitChance(convention, data_.Depths(convention), fit);
    return fit;
  }

  // Judges the best convention in itself, and looks for other faults.
  void Judge() {
    const DataConvention best = diagnosis_.best;
    diagnosis_.fit = FitOf(best);
    if (!TellsDepth(diagnosis_.fit, data_, poses_, baseline_error_px_)) {
      diagnosis_.best = input_.as_read;
      Say(diagnosis_, InputVerdict::kTooFewMatches, InputFault::kNone, kViewsTooClose);
      return;
    }
    const ConventionFit fit = LimitChance(best, diagnosis_.fit);
    const bool is_as_read = best == input_.as_read;
    const bool covered = input_.map_size_px || fit.coverage >= kLeastCoverage;
    const bool accepted =
        best.poses == poses_ && covered && fit.count >= kFewestKeypoints &&
        (IsGood(fit, baseline_error_px_) || (is_as_read && IsPassable(fit, baseline_error_px_)));
    if (FindWrapFault(accepted)) return;
    if (!accepted && IsMeshInPlace()) {
      // Limits of what is lifted are the user's choice where what they leave fits.
      if (fit.count >= kFewestKeypoints && IsGood(fit, baseline_error_px_)) return AcceptBest(fit);
      return NothingFits(InputFault::kNone, kLimitsDrop);
    }
    if (input_.mesh != nullptr && FindMeshFrame(accepted)) return;
    if (input_.map_size_px && FindAffineFault(accepted)) return;
    if (accepted) return AcceptBest(fit);
    if (best.poses != poses_) {
      return NothingFits(InputFault::kPoses, DescribeOtherPoses(poses_, input_.as_read.poses));
    }
    NothingFits(InputFault::kNone,
                fit.count < kFewestKeypoints
                    ? DescribeFewDepths(fit, statistics_.extremes, mesh_search_)
                    : DescribeMisfit(input_, fit, baseline_error_px_, mesh_search_));
  }

  // Returns whether the mesh itself is good as read.
  bool IsMeshInPlace() const {
    if (input_.mesh == nullptr || diagnosis_.best.poses != poses_) return false;
    const MeshFrameSearch search(*input_.mesh, input_, data_, diagnosis_.best, options_.threads);
    return IsGoodPlace(search.Judge({}).fit, baseline_error_px_);
  }

  Gain GainOverBest(const ErrorsPx& errors_px) const {
    const DataConvention& best = diagnosis_.best;
    return Compare(data_, data_.Errors(best, data_.FitScales(best).log_factors), errors_px);
  }

  // Returns whether the diagnosis is that.
  bool FindWrapFault(bool accepted) {
    DataConvention as_read = input_.as_read;
    as_read.poses = poses_;
    const auto wrap =
        FindWrap(input_, data_, as_read, statistics_.largest, baseline_error_px_, IsGood);
    if (!wrap) return false;
    if (accepted && !search_.IsFarBetter(GainOverBest(wrap->errors_px))) return false;
    NothingFits(InputFault::kWrap, Describe(*wrap));
    return true;
  }

  // Returns whether the diagnosis is that.
  bool FindAffineFault(bool accepted) {
    const DataConvention& best = diagnosis_.best;
    const std::vector<AffineForm> forms =
        accepted
            ? FormsBehind(best, input_.as_read)
            : std::vector<AffineForm>{{true, true}, {false, true}, {true, false}, {false, false}};
    if (forms.empty()) return false;
    DataConvention stored = input_.as_read;
    stored.poses = poses_;
    stored.orientation = best.orientation;
    const auto affine = FindAffine(input_, data_, stored, forms, baseline_error_px_, IsGood);
    if (!affine) return false;
    if (accepted) {
      constexpr double kGreatGain = 0.1;
      const Gain gain = GainOverBest(affine->errors_px);
      if (!search_.IsFarBetter(gain) || gain.mean < kGreatGain) return false;
    }
    NothingFits(affine->form.inverse ? InputFault::kDisparity : InputFault::kAffine,
                Describe(*affine));
    return true;
  }

  void NothingFits(InputFault fault, std::string reason) {
    diagnosis_.best = input_.as_read;
    Say(diagnosis_, InputVerdict::kNothingFits, fault, std::move(reason));
  }

  // The verdict is as meant or a repair; values that are cut off are taken for none.
  void AcceptBest(const ConventionFit& fit) {
    std::vector<std::string> reasons;
    std::vector<float> invalid;  // in the digits that tell floats apart
    for (const ClampFault& clamp :
         FindClamps(input_, matches_, statistics_.extremes, data_, diagnosis_.best,
                    std::max(fit.median_px, baseline_error_px_), options_.threads)) {
      reasons.push_back(Describe(clamp));
      invalid.push_back(static_cast<float>(clamp.extreme.value));
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
    Say(diagnosis_, InputVerdict::kRepair, invalid.empty() ? InputFault::kNone : InputFault::kClamp,
        fmt::format("{}", fmt::join(reasons, "; ")));
  }

  // Returns whether a place explains what the mesh as read meets as well as that does. Else the
  // mesh is where it belongs, and models a part of the scene alone.
  bool ExplainsTheSame(const ErrorsPx& as_read, const ErrorsPx& placed) const {
    std::vector<double> before, now;
    for (size_t i = 0; i < as_read.size(); ++i) {
      if (!as_read[i] || !(*as_read[i] < ConventionResiduals::kLargestPx) || !placed[i]) continue;
      before.push_back(*as_read[i]);
      now.push_back(*placed[i]);
    }
    if (before.size() < kFewestKeypoints) return true;
    const double noise_px = std::max(baseline_error_px_, 0.5);
    return UpperMedianOr(std::move(now), 0) <=
           std::max(UpperMedianOr(std::move(before), 0), noise_px);
  }

  // Returns whether the diagnosis is that; where the mesh as read is good, only for far smaller
  // errors.
  bool FindMeshFrame(bool accepted) {
    DataConvention convention = input_.as_read;
    convention.poses = poses_;
    const ErrorsPx as_read = data_.Errors(convention, 0);
    ConventionFit as_read_fit = FitOf(convention);
    LimitChance(convention, as_read_fit);
    // Rays that pass the mesh by count, too.
    const double as_read_px = UpperMedianOr(Known(as_read), ConventionResiduals::kLargestPx);
    constexpr double kExact = 2;  // about as exact as it can become
    if (accepted && as_read_px < kExact * std::max(baseline_error_px_, 0.5)) return false;
    const MeshFrameSearch search(*input_.mesh, input_, data_, convention, options_.threads);
    mesh_search_ = search.Obstacle();
    if (mesh_search_ != MeshSearch::kNoneFound) return false;
    std::vector<PlacedMesh> found = search.Find();
    if (!found.empty()) mesh_search_ = MeshSearch::kRejected;
    // A place that is good in itself need only be compared with one that is, too: the spread over
    // pairs of images, of which a few references have too few, tells the better of two. What most
    // rays pass by is accepted for the few that meet it alone.
    const bool stands =
        accepted && as_read_px <= std::max(ExactPx(baseline_error_px_),
                                           kPassableOfChance * as_read_fit.median_chance_px);
    std::erase_if(found, [&](const PlacedMesh& placed) {
      return !IsGoodPlace(placed.fit, baseline_error_px_) ||
             placed.fit.median_px > 0.6 * as_read_px ||
             !ExplainsTheSame(as_read, placed.errors_px) ||
             (stands && !search_.IsFarBetter(Compare(data_, as_read, placed.errors_px)));
    });
    if (found.empty()) return false;
    const PlacedMesh& best = *std::min_element(
        found.begin(), found.end(),
        [](const auto& a, const auto& b) { return a.fit.median_px < b.fit.median_px; });
    // A symmetric scene has several frames.
    const auto about_as_good = std::count_if(found.begin(), found.end(), [&](const auto& other) {
      return !search_.IsFarBetter(Compare(data_, other.errors_px, best.errors_px));
    });
    if (about_as_good > 1) {
      NothingFits(InputFault::kMeshFrame, DescribeManyPlaces(about_as_good));
      return true;
    }
    if (best.placement.IsIdentity() && accepted) return false;
    diagnosis_.fit = best.fit;
    if (best.placement.IsIdentity()) {
      NothingFits(InputFault::kNone, kLimitsDrop);
      return true;
    }
    diagnosis_.best = convention;
    diagnosis_.mesh_placement = best.from_files;
    diagnosis_.repair = RepairOfPlace(input_, convention, best.from_files);
    Say(diagnosis_, InputVerdict::kRepair, InputFault::kMeshFrame,
        DescribePlace(best, input_.as_placed,
                      as_read_fit.count == 0 ? std::nullopt : std::optional(as_read_px)));
    return true;
  }

  const DoctorInput& input_;
  const DoctorOptions& options_;
  std::vector<ReferenceMatch> matches_;
  double baseline_error_px_;
  PoseConvention poses_;
  ConventionResiduals data_;
  StoredStatistics statistics_;
  ConventionSearch search_;
  std::optional<MeshSearch> mesh_search_;
  Diagnosis diagnosis_;
};

}  // namespace

DoctorInput MakeDoctorInput(const NamedGeometry& geometry, std::span<const PosedImage> references,
                            std::span<const ReferenceMatch> matches, PoseConvention poses) {
  DoctorInput input{.source = *geometry.source,
                    .references = references,
                    .matches = matches,
                    .as_read = geometry.depth_convention.value_or(DataConvention{})};
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

const ConventionEvidence& Diagnosis::EvidenceOf(const DataConvention& convention) const {
  const auto found = std::find_if(
      conventions.begin(), conventions.end(),
      [&](const ConventionEvidence& evidence) { return evidence.convention == convention; });
  RAYLIFT_CHECK(found != conventions.end());
  return *found;
}

Diagnosis Diagnose(const DoctorInput& input, const DoctorOptions& options) {
  Diagnosis diagnosis;
  diagnosis.as_read = input.as_read;
  diagnosis.best = input.as_read;
  auto agreeing = KeepAgreeingMatches(input, options, diagnosis);
  if (!agreeing) return diagnosis;
  return Examination(input, options, std::move(*agreeing), std::move(diagnosis)).Run();
}

}  // namespace raylift
