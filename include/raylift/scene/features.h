// Local features of one image and matches between two images, as the front end makes them and as
// hloc's files hold them.

#pragma once

#include <vector>

#include <Eigen/Core>

#include "raylift/base/enum_names.h"

namespace raylift {

// One row per keypoint. Pixels are COLMAP's (the first pixel's center is (0.5, 0.5)).
struct Features {
  int image_width_px = 0;
  int image_height_px = 0;
  std::vector<Eigen::Vector2d> keypoints_px;
  // D x N: a feature's descriptor is a column, unit length for RootSIFT. Empty where not stored.
  Eigen::MatrixXf descriptors;
  std::vector<float> scores;  // empty where not stored
  // Standard deviation of the keypoints in pixels, as hloc's attribute "uncertainty".
  float uncertainty_px = 1.0f;
};

// The precision in which descriptors are kept where space is short.
enum class DescriptorPrecision { kExact, kBytes, kCompact };
template <>
inline constexpr auto kEnumNames<DescriptorPrecision> =
    std::to_array<EnumName<DescriptorPrecision>>({
        {DescriptorPrecision::kExact, "exact", "", "as they are"},
        {DescriptorPrecision::kBytes, "bytes", "", "8 bits a value, as in COLMAP's databases"},
        {DescriptorPrecision::kCompact, "compact", "", "8 levels a value"},
    });

struct FeatureMatch {
  int query_index;
  int reference_index;
  float score;
  bool operator==(const FeatureMatch&) const = default;
};

// A reference that a query is to be matched with.
struct RetrievedReference {
  int reference_index;
  double score;  // the larger, the better
  bool operator==(const RetrievedReference&) const = default;
};

// The references of each query, best first, the lower index first among equals.
using RetrievedLists = std::vector<std::vector<RetrievedReference>>;

}  // namespace raylift
