#include "raylift/lifting/input_doctor.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

#include "reading_errors.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/median.h"
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

using ErrorsPx = std::vector<std::optional<double>>;

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

// All combinations of kind, orientation and poses, as read first.
std::vector<InputReading> DiscreteReadings(const DoctorInput& input) {
  using enum MapOrientation;
  using enum PoseConvention;
  const InputReading& as_read = input.as_read;
  std::vector<InputReading> readings = {as_read};
  const bool maps = input.map_size_px.has_value();
  for (const auto poses :
       {kCamFromWorld, kWorldFromCam, kOpenGlCamFromWorld, kWorldFromOpenGlCamera}) {
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
  }
  return readings;
}

class Examination {
 public:
  Examination(const DoctorInput& input, const DoctorOptions& options)
      : input_(input), options_(options), data_(input, options.max_matches) {
    diagnosis_.as_read = input.as_read;
    diagnosis_.best = input.as_read;
  }

  Diagnosis Run() {
    if (data_.keypoints().size() < kFewestKeypoints || data_.NumPairs() < kFewestPairs) {
      diagnosis_.too_few_matches = true;
      return diagnosis_;
    }
    const std::vector<InputReading> readings = DiscreteReadings(input_);
    data_.Prepare(readings, options_.threads);
    candidates_ = Explain(data_, readings, options_.threads);
    Candidate best = candidates_[ChooseDiscrete()];
    if (input_.map_size_px) {
      if (options_.shifts && data_.NumPairs() >= kFewestPairsForShift) best = ChooseShift(best);
      diagnosis_.best = ChooseScale(best);
    } else {
      diagnosis_.best = best.reading;
    }
    ListEvidence();
    return diagnosis_;
  }

 private:
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

  Candidate ChooseShift(const Candidate& best) {
    std::vector<InputReading> readings;
    for (const double first_sample_px : {0.0, 0.5, 1.0}) {
      InputReading shifted = best.reading;
      shifted.first_sample_px = first_sample_px;
      if (std::abs(first_sample_px - input_.as_read.first_sample_px) == 0.5) {
        readings.push_back(shifted);
      }
    }
    data_.Prepare(readings, options_.threads);
    const Candidate* chosen = &best;
    Gain largest;
    const std::vector<Candidate> shifted = Explain(data_, readings, options_.threads);
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

  // The reading at the maps' common scale where that explains the data far better.
  InputReading ChooseScale(const Candidate& candidate) const {
    const double log_factor = KnownUnit(candidate.common.log_factor);
    if (std::abs(log_factor) <
        std::max(options_.min_sigmas * candidate.common.standard_error, kSmallestScaleChange)) {
      return candidate.reading;
    }
    const Gain gain = Compare(data_, data_.Errors(candidate.reading, 0),
                              data_.Errors(candidate.reading, log_factor));
    return IsFarBetter(gain) ? Scaled(candidate.reading, log_factor) : candidate.reading;
  }

  ReadingEvidence Evidence(const InputReading& reading) const {
    const ErrorsPx errors = data_.Errors(reading, 0);
    const InputReading& as_read = input_.as_read;
    ReadingEvidence evidence{.reading = reading};
    std::vector<double> sorted;
    for (const auto& error : errors) {
      if (error) sorted.push_back(*error);
    }
    const auto within =
        std::count_if(sorted.begin(), sorted.end(), [](double error) { return error <= 5; });
    evidence.num_keypoints = sorted.size();
    evidence.median_px = UpperMedianOr(sorted, 0);
    evidence.share_within_5px =
        static_cast<double>(within) / std::max<double>(1, static_cast<double>(sorted.size()));
    const ErrorsPx own_scale = data_.Errors(reading, data_.FitScales(reading).log_factors);
    std::vector<double> own_sorted;
    for (const auto& error : own_scale) {
      if (error) own_sorted.push_back(*error);
    }
    evidence.median_own_scale_px = UpperMedianOr(std::move(own_sorted), 0);
    const Gain gain =
        reading.scale != as_read.scale
            ? Compare(data_, data_.Errors(as_read, 0), errors)
            : Compare(data_, data_.Errors(as_read, data_.FitScales(as_read).log_factors),
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
  ReadingErrors data_;
  std::vector<Candidate> candidates_;
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
  if (geometry.maps != nullptr) input.map_size_px = geometry.maps->size_px();
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

std::string Summary(const Diagnosis& diagnosis) {
  if (diagnosis.too_few_matches) {
    return "there are too few matches between references to tell";
  }
  const ReadingEvidence& as_read = diagnosis.EvidenceOf(diagnosis.as_read);
  if (!diagnosis.suspicious()) {
    return fmt::format("the input is read as the matches suggest: median {:.2f} px",
                       as_read.median_px);
  }
  const ReadingEvidence& best = diagnosis.EvidenceOf(diagnosis.best);
  return fmt::format(
      "another reading of the input explains the matches far better: {} (median {:.2f} px, as read "
      "{:.2f} px; {:.0f} standard errors). Repair: {}",
      DescribeDifference(diagnosis.as_read, diagnosis.best), best.median_px, as_read.median_px,
      best.sigmas, ToString(FindRepair(diagnosis.as_read, diagnosis.best)));
}

}  // namespace raylift
