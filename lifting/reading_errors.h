// The data of the doctor: keypoints of references with their matches in other references, and
// how far they project from them under a reading of the input. Private to lifting.

#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <span>
#include <tuple>
#include <vector>

#include "keypoint_sight.h"
#include <Eigen/Core>

#include "raylift/lifting/input_doctor.h"

namespace raylift {

// The log factor of a well-known unit where one is near.
double KnownUnit(double log_factor);

// The reading with all depth multiplied.
InputReading Scaled(const InputReading& reading, double log_factor);

// What the factors of the maps have in common.
struct CommonScale {
  double log_factor = 0;
  double standard_error = 0;
};

struct MapScales {
  std::vector<double> log_factors;  // of each reference's depth
  CommonScale common;
};

class ReadingErrors {
 public:
  struct Keypoint {
    int map;
    int other;
    Eigen::Vector2d pixel;
    Eigen::Vector2d other_px;
    double ray_z;  // of the pixel's unit ray
  };

  // Both sides of matches, `max_matches` of them, evenly.
  ReadingErrors(const DoctorInput& input, size_t max_matches);

  size_t num_maps() const { return input_.references.size(); }
  size_t NumPairs() const;  // of references with matches
  const std::vector<Keypoint>& keypoints() const { return keypoints_; }

  // Looks up what these readings need; the rest may then be called for them, from many threads.
  void Prepare(std::span<const InputReading> readings, int threads);

  // The factors by which the depth of each map agrees best with its matches; those of maps with few
  // matches are the others' median. All 1 where the source is a surface in the world.
  MapScales FitScales(const InputReading& reading) const;

  // Distances of projected keypoints from their matches in pixels, at most kLargestPx; none where a
  // map has no depth (a surface that is not met has the largest error: holes are rare). Depth is
  // multiplied by exp(log factor).
  static constexpr double kLargestPx = 1000;
  std::vector<std::optional<double>> Errors(const InputReading& reading,
                                            std::span<const double> log_factor_of_map) const;
  std::vector<std::optional<double>> Errors(const InputReading& reading, double log_factor) const;

 private:
  // A keypoint as the other camera sees it, and its depth by the match, where that fits.
  struct Sight {
    KeypointSight seen;
    std::optional<TriangulatedDepth> depth;
  };
  using Key = std::tuple<MapOrientation, double, PoseConvention>;

  Key KeyOf(const InputReading& reading) const;
  PosedImage ReadAs(const PosedImage& reference, PoseConvention poses) const;
  Eigen::Vector2d PlaceInMap(const Keypoint& keypoint, const InputReading& reading) const;
  std::vector<std::optional<double>> LookUp(const InputReading& reading, int threads) const;
  Sight See(const Keypoint& keypoint, PoseConvention poses) const;
  std::vector<std::optional<double>> Depths(const InputReading& reading) const;

  const DoctorInput& input_;
  std::vector<Keypoint> keypoints_;                           // by map
  std::map<Key, std::vector<std::optional<double>>> stored_;  // z or ray length or inverse z
  std::map<PoseConvention, std::vector<Sight>> sights_;
};

}  // namespace raylift
