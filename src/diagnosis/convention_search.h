// Finds the convention of depth maps and poses that explains the matches best: see doctor.h.

#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "diagnosis/convention_residuals.h"

#include "raylift/diagnosis/doctor.h"

namespace raylift {

// Standard errors rest on so many pairs of images and keypoints at least; a shift, whose gain is
// small, needs more pairs.
inline constexpr size_t kFewestPairs = 10;
inline constexpr size_t kFewestKeypoints = 50;

using ErrorsPx = std::vector<std::optional<double>>;

std::vector<double> Known(const ErrorsPx& errors);

// The gain of one explanation over another.
struct Gain {
  double mean = 0;
  double sigmas = 0;
};

// Compares by pairs of images, whose matches share the errors of their poses.
Gain Compare(const ConventionResiduals& data, const ErrorsPx& former, const ErrorsPx& other);

class ConventionSearch {
 public:
  // `poses` is the convention of poses that the matches agree with. Input, options and data must
  // outlive the search.
  ConventionSearch(const DoctorInput& input, const DoctorOptions& options, PoseConvention poses,
                   ConventionResiduals& data);

  const DataConvention& best() const { return best_; }
  bool IsFarBetter(const Gain& gain) const;
  // Returns what the matches say of `best`, which is first, of the input as read and of every
  // single change, the better ones first.
  std::vector<ConventionEvidence> ListEvidence(const DataConvention& best) const;

 private:
  // A convention, and the errors with each map at its own scale.
  struct Candidate {
    DataConvention convention;
    ErrorsPx own_scale;
    CommonScale common;
  };

  std::vector<Candidate> Explain(const std::vector<DataConvention>& conventions) const;
  size_t ChooseDiscrete() const;
  Candidate ChooseShift(const Candidate& best);
  DataConvention ChooseScale(const Candidate& candidate) const;
  ConventionEvidence Evidence(const DataConvention& convention) const;

  const DoctorInput& input_;
  const DoctorOptions& options_;
  ConventionResiduals& data_;
  std::vector<Candidate> candidates_;
  DataConvention best_;
};

}  // namespace raylift
