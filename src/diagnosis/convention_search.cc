#include "diagnosis/convention_search.h"

#include <algorithm>
#include <map>
#include <utility>

#include "base/statistics.h"

#include "raylift/base/parallel.h"

namespace raylift {
namespace {

constexpr double kFewestSigmas = 5;
constexpr size_t kFewestPairsForShift = 40;
// A smaller mean gain in c changes no result; this is that of errors that are smaller by a
// hundredth.
constexpr double kSmallestGain = 0.02;
// A scale that is nearer to 1 is left to calibration.
constexpr double kSmallestScaleChange = 0.03;

double Cost(double error_px) { return std::log1p(error_px * error_px); }

struct RunningSum {
  double sum = 0;
  double count = 0;

  void Add(double value) {
    sum += value;
    count += 1;
  }
};

// Returns all combinations of kind and orientation, with the poses with which the matches agree;
// the one as read first.
std::vector<DataConvention> DiscreteConventions(const DoctorInput& input, PoseConvention poses) {
  using enum MapOrientation;
  const DataConvention& as_read = input.as_read;
  std::vector<DataConvention> conventions = {as_read};
  const bool maps = input.map_size_px.has_value();
  for (const auto kind : {DepthKind::kZ, DepthKind::kRay, DepthKind::kInverse}) {
    for (const auto relative : {kAsStored, kFlippedX, kFlippedY, kHalfTurn, kTransposed}) {
      const auto orientation = Combined(as_read.orientation, relative);
      if (!orientation || (!maps && (kind != as_read.kind || relative != kAsStored))) continue;
      DataConvention convention = as_read;
      convention.kind = kind;
      convention.orientation = *orientation;
      convention.poses = poses;
      if (!(convention == as_read)) conventions.push_back(convention);
    }
  }
  return conventions;
}

}  // namespace

std::vector<double> Known(const ErrorsPx& errors) {
  std::vector<double> known;
  for (const auto& error : errors) {
    if (error) known.push_back(*error);
  }
  return known;
}

Gain Compare(const ConventionResiduals& data, const ErrorsPx& former, const ErrorsPx& other) {
  std::map<std::pair<int, int>, RunningSum> of_pair;
  RunningSum all;
  for (size_t i = 0; i < former.size(); ++i) {
    if (!former[i] || !other[i]) continue;
    const double gain = Cost(*former[i]) - Cost(*other[i]);
    const ConventionResiduals::Keypoint& keypoint = data.keypoints()[i];
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

ConventionSearch::ConventionSearch(const DoctorInput& input, const DoctorOptions& options,
                                   PoseConvention poses, ConventionResiduals& data)
    : input_(input), options_(options), data_(data) {
  const std::vector<DataConvention> conventions = DiscreteConventions(input, poses);
  data_.Prepare(conventions, options.threads);
  candidates_ = Explain(conventions);
  Candidate best = candidates_[ChooseDiscrete()];
  best_ = best.convention;
  if (!input.map_size_px) return;
  if (options.half_pixels && data_.NumPairs() >= kFewestPairsForShift) best = ChooseShift(best);
  best_ = ChooseScale(best);
}

std::vector<ConventionSearch::Candidate> ConventionSearch::Explain(
    const std::vector<DataConvention>& conventions) const {
  std::vector<Candidate> candidates(conventions.size());
  ParallelFor(conventions.size(), options_.threads, [&](size_t i) {
    const MapScales scales = data_.FitScales(conventions[i]);
    candidates[i] = {conventions[i], data_.Errors(conventions[i], scales.log_factors),
                     scales.common};
  });
  return candidates;
}

bool ConventionSearch::IsFarBetter(const Gain& gain) const {
  return gain.sigmas >= kFewestSigmas && gain.mean >= kSmallestGain;
}

// Returns the best of the readings with the fewest changes: one more change must pay for itself.
size_t ConventionSearch::ChooseDiscrete() const {
  size_t best = 0;
  for (int changes = 1; changes <= 3; ++changes) {
    size_t next = best;
    Gain largest;
    for (size_t i = 0; i < candidates_.size(); ++i) {
      if (NumDifferences(input_.as_read, candidates_[i].convention) != changes) continue;
      const Gain gain = Compare(data_, candidates_[best].own_scale, candidates_[i].own_scale);
      if (IsFarBetter(gain) && gain.mean > largest.mean) {
        largest = gain;
        next = i;
      }
    }
    best = next;
  }
  return best;
}

ConventionSearch::Candidate ConventionSearch::ChooseShift(const Candidate& best) {
  std::vector<DataConvention> conventions;
  for (const double first_sample_px : {0.0, 0.5, 1.0}) {
    DataConvention shifted = best.convention;
    shifted.first_sample_px = first_sample_px;
    if (std::abs(first_sample_px - input_.as_read.first_sample_px) == 0.5) {
      conventions.push_back(shifted);
    }
  }
  data_.Prepare(conventions, options_.threads);
  const Candidate* chosen = &best;
  Gain largest;
  const std::vector<Candidate> shifted = Explain(conventions);
  for (const Candidate& candidate : shifted) {
    const Gain gain = Compare(data_, best.own_scale, candidate.own_scale);
    if (IsFarBetter(gain) && gain.mean > largest.mean) {
      largest = gain;
      chosen = &candidate;
    }
  }
  const Candidate result = *chosen;
  candidates_.insert(candidates_.end(), shifted.begin(), shifted.end());
  return result;
}

// Returns the reading at the maps' common scale where that explains the data far better.
DataConvention ConventionSearch::ChooseScale(const Candidate& candidate) const {
  const double log_factor = KnownUnit(candidate.common.log_factor);
  if (std::abs(log_factor) <
      std::max(kFewestSigmas * candidate.common.standard_error, kSmallestScaleChange)) {
    return candidate.convention;
  }
  const Gain gain = Compare(data_, data_.Errors(candidate.convention, 0),
                            data_.Errors(candidate.convention, log_factor));
  return IsFarBetter(gain) ? Scaled(candidate.convention, log_factor) : candidate.convention;
}

ConventionEvidence ConventionSearch::Evidence(const DataConvention& convention) const {
  const ErrorsPx errors = data_.Errors(convention, 0);
  const DataConvention& as_read = input_.as_read;
  ConventionEvidence evidence{.convention = convention};
  const std::vector<double> known = Known(errors);
  const auto within =
      std::count_if(known.begin(), known.end(), [](double error) { return error <= 5; });
  evidence.num_keypoints = known.size();
  evidence.median_px = UpperMedianOr(known, 0);
  evidence.share_within_5px =
      static_cast<double>(within) / std::max<double>(1, static_cast<double>(known.size()));
  const ErrorsPx own_scale = data_.Errors(convention, data_.FitScales(convention).log_factors);
  evidence.median_own_scale_px = UpperMedianOr(Known(own_scale), 0);
  const Gain gain =
      convention.scale != as_read.scale
          ? Compare(data_, data_.Errors(as_read, 0), errors)
          : Compare(data_, data_.Errors(as_read, data_.FitScales(as_read).log_factors), own_scale);
  evidence.gain = gain.mean;
  evidence.sigmas = gain.sigmas;
  return evidence;
}

std::vector<ConventionEvidence> ConventionSearch::ListEvidence(const DataConvention& best) const {
  std::vector<DataConvention> conventions = {best};
  const auto add = [&](const DataConvention& convention) {
    if (std::find(conventions.begin(), conventions.end(), convention) == conventions.end()) {
      conventions.push_back(convention);
    }
  };
  for (const Candidate& candidate : candidates_) {
    const DataConvention convention =
        input_.map_size_px ? ChooseScale(candidate) : candidate.convention;
    if (convention.scale != input_.as_read.scale && candidate.convention == input_.as_read) {
      add(convention);
    }
    if (NumDifferences(input_.as_read, candidate.convention) <= 1) add(candidate.convention);
  }
  std::vector<ConventionEvidence> listed(conventions.size());
  ParallelFor(conventions.size(), options_.threads,
              [&](size_t i) { listed[i] = Evidence(conventions[i]); });
  std::stable_sort(listed.begin() + 1, listed.end(),
                   [](const ConventionEvidence& a, const ConventionEvidence& b) {
                     return a.median_own_scale_px < b.median_own_scale_px;
                   });
  return listed;
}

}  // namespace raylift
