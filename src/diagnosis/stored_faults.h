// Finds faults of the stored values of depth maps that no reading repairs: values that are cut off
// at a largest or smallest one, that start again at zero beyond a power of two, or that are an
// affine map of depth or inverse depth. They are found by the depth that matches between references
// triangulate.

#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "diagnosis/convention_residuals.h"

#include "raylift/diagnosis/doctor.h"

namespace raylift {

// A value that many pixels have exactly and none exceeds.
struct StoredExtreme {
  double value = 0;  // as stored
  double share = 0;  // of the pixels that have depth
  bool largest = true;
};

// The values that a sample of the maps stores.
struct StoredStatistics {
  std::vector<StoredExtreme> extremes;
  double largest = 0;  // as stored
};
StoredStatistics LookAtMaps(const DoctorInput& input, int threads);

// An extreme value at pixels whose depth it is not.
struct ClampFault {
  StoredExtreme extreme;
  double depth_ratio = 1;  // how many times as deep keypoints there are (median)
  size_t num_keypoints = 0;
  bool is_cut_off = true;  // else it marks what has no depth
};
// Returns nullopt where keypoints there fit like the others (median error `usual_px`) or are too
// few to tell. `data` masks the value, `unmasked` does not; both are prepared for the convention.
std::optional<ClampFault> FindClamp(const ConventionResiduals& data,
                                    const ConventionResiduals& unmasked,
                                    const DataConvention& convention, const StoredExtreme& extreme,
                                    double usual_px);

// Says whether depth fits the matches in itself.
using IsGoodFit = bool (*)(const ConventionFit& fit, double baseline_error_px);

// Values that start again at 0 where they reach `modulus`: depth agrees once multiples of it are
// added.
struct WrapFault {
  double modulus = 0;                                 // as stored
  double share = 0;                                   // of keypoints that are wrapped
  ConventionFit fit = {};                             // with the multiples
  std::vector<std::optional<double>> errors_px = {};  // of each keypoint, with them
};
std::optional<WrapFault> FindWrap(const DoctorInput& input, const ConventionResiduals& data,
                                  const DataConvention& convention, double largest,
                                  double baseline_error_px, IsGoodFit is_good);

// Says which of the two is an affine function of what is stored:
//   z or 1 / z = factor * stored + shift
struct AffineForm {
  bool inverse = true;
  bool common = true;  // the same of all maps
};
struct AffineFault {
  AffineForm form;
  double factor = 1;  // of the first map, where each has its own
  double shift = 0;
  // The fit of held-out matches.
  ConventionFit fit = {};
  std::vector<std::optional<double>> errors_px = {};  // of each keypoint
};
// Returns the best of the forms that are good, the first of those that are about as good.
std::optional<AffineFault> FindAffine(const DoctorInput& input, const ConventionResiduals& data,
                                      const DataConvention& convention,
                                      std::span<const AffineForm> forms, double baseline_error_px,
                                      IsGoodFit is_good);

// A keypoint is for fitting or, with those of other pairs of images, for testing the fit. One place
// in a map is not for both: some of its matches are for neither.
enum class Half { kFitting, kHeldOut, kNeither };
std::vector<Half> SplitKeypoints(const ConventionResiduals& data);

}  // namespace raylift
