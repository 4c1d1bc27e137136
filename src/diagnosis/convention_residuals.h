// Computes the residuals of the doctor: distances of the references' keypoints, lifted under a
// reading of the input and projected into other references, from their matches.

#pragma once

#include <algorithm>
#include <cstddef>
#include <map>
#include <optional>
#include <span>
#include <tuple>
#include <vector>

#include "lifting/reference_matches.h"
#include <Eigen/Core>

#include "raylift/diagnosis/doctor.h"
#include "raylift/lifting/depth_alignment.h"

namespace raylift {

// Returns the orientation that has the effect of both; nullopt where it has no name.
std::optional<MapOrientation> Combined(MapOrientation a, MapOrientation b);

// Returns in how many respects two conventions differ.
int NumDifferences(const DataConvention& a, const DataConvention& b);

// Returns the log factor of a well-known unit where one is near.
double KnownUnit(double log_factor);

// Returns the convention with all depth multiplied.
DataConvention Scaled(const DataConvention& convention, double log_factor);

// The scale that the factors of the maps have in common.
struct CommonScale {
  double log_factor = 0;
  double standard_error = 0;
};

struct MapScales {
  std::vector<double> log_factors;  // of each reference's depth
  CommonScale common;
};

// Returns the largest error that is about as small as those of the matches themselves.
inline double ExactPx(double baseline_error_px) { return 4 * std::max(baseline_error_px, 0.5); }

ConventionFit MakeFit(std::vector<double> errors_px, std::vector<double> chance_px);

class ConventionResiduals {
 public:
  struct Keypoint {
    int map;
    int other;
    Eigen::Vector2d pixel;
    Eigen::Vector2d other_px;
    double ray_z;  // of the pixel's unit ray
  };

  // Takes both sides of the matches.
  ConventionResiduals(const DoctorInput& input, std::span<const ReferenceMatch> matches);

  size_t num_maps() const { return input_.references.size(); }
  size_t NumPairs() const;  // of references with matches
  const std::vector<Keypoint>& keypoints() const { return keypoints_; }

  // Looks up what these readings need; the rest may then be called for them, from many threads.
  void Prepare(std::span<const DataConvention> conventions, int threads);

  // Returns the factors by which the depth of each map agrees best with its matches; those of maps
  // with few matches are the others' median. All are 1 where the source is a surface in the world.
  MapScales FitScales(const DataConvention& convention) const;

  ConventionFit FitOf(const DataConvention& convention,
                      std::span<const double> log_factor_of_map) const;

  // Lowers the errors by chance of a fit of these depths to those that right depths of the same
  // keypoints, exchanged at random, would have: a reading whose depths are all further off tells
  // nothing, however much worse its own depths, exchanged, would be.
  void LimitChance(const DataConvention& convention, std::span<const std::optional<double>> depths,
                   ConventionFit& fit) const;

  // Returns the error in pixels, at most `kLargestPx`, of a keypoint at a depth z.
  double ErrorAt(const DataConvention& convention, size_t keypoint, double z) const;
  // Returns the triangulated depth of each keypoint; nullopt where the match does not tell.
  std::vector<std::optional<TriangulatedDepth>> Triangulated(PoseConvention poses) const;
  // Returns z as read; nullopt where there is none.
  std::vector<std::optional<double>> Depths(const DataConvention& convention) const;
  // Returns indices of keypoints, in which those of each map are exchanged at random.
  std::vector<size_t> Shuffled() const;

  // Takes keypoints out that lie where maps store this value (z or ray length or inverse z, as
  // read). What is prepared before stays as it is.
  void MaskStored(double value) { masked_.push_back(value); }

  // Returns the distances of projected keypoints from their matches, at most kLargestPx; nullopt
  // where a map has no depth (a surface that is not met has the largest error: holes are rare).
  // Depth is multiplied by exp(log factor).
  static constexpr double kLargestPx = 1000;
  std::vector<std::optional<double>> Errors(const DataConvention& convention,
                                            std::span<const double> log_factor_of_map) const;
  std::vector<std::optional<double>> Errors(const DataConvention& convention,
                                            double log_factor) const;

 private:
  // A keypoint in the other camera, and its depth by triangulation with the match, where that fits.
  struct Observation {
    SightLine line_in_other;
    std::optional<TriangulatedDepth> depth;
  };
  using Key = std::tuple<MapOrientation, double, PoseConvention>;

  std::vector<size_t> MapBegins() const;  // and the end of the last
  Key KeyOf(const DataConvention& convention) const;
  Eigen::Vector2d PlaceInMap(const Keypoint& keypoint, const DataConvention& convention) const;
  std::vector<std::optional<double>> LookUp(const DataConvention& convention, int threads) const;
  Observation Observe(const Keypoint& keypoint, PoseConvention poses) const;

  const DoctorInput& input_;
  std::vector<Keypoint> keypoints_;                           // by map
  std::map<Key, std::vector<std::optional<double>>> stored_;  // z or ray length or inverse z
  std::map<PoseConvention, std::vector<Observation>> observations_;
  std::vector<double> masked_;
};

}  // namespace raylift
