// Pose problems with a known answer, by regime: accurate and noisy geometry, few and many outliers,
// few matches, and the layouts in which an estimator's assumptions fail.

#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/rng.h"

#include "raylift/geometry/rigid3.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

struct UniformRange {
  double low;
  double high;
};

enum class SceneShape { kVolume, kPlane };

enum class ReferenceLayout {
  kAround,      // anywhere around the query
  kShared,      // all at one center
  kCoincident,  // the first at the query's center
  kForward,     // on the query's optical axis, all turned alike
};

struct SyntheticOptions {
  int num_2d3d = 500;  // inliers and outliers
  int num_2d2d = 1000;
  UniformRange outlier_ratio_2d3d = {0.1, 0.1};  // drawn per problem
  UniformRange outlier_ratio_2d2d = {0.1, 0.1};
  double sigma_px = 1;     // of each keypoint's coordinate, in both images
  double sigma_point = 0;  // of each 3D coordinate, meters
  int num_references = 20;
  double baseline = 2;  // references lie within this distance of the query, meters
  double tilt_deg = 8;  // at most, off the direction to the scene's middle
  UniformRange depth = {5, 15};
  SceneShape scene = SceneShape::kVolume;
  ReferenceLayout layout = ReferenceLayout::kAround;
  bool split_five_and_one = false;  // the first six 2D-2D matches: five to one reference, one to
                                    // another
  double unit = 1;                  // scene units per meter
  double origin_distance = 0;       // of the world's origin, meters
  // Of all images; none for a pinhole camera of 640 x 480 pixels with f = 585.
  std::optional<Camera> camera;
};

struct SyntheticProblem {
  PoseProblem problem;
  Rigid3 query_from_world;
  std::vector<bool> is_outlier_2d3d;
  std::vector<bool> is_outlier_2d2d;
};

SyntheticProblem MakeSyntheticProblem(const std::string& name, const SyntheticOptions& options,
                                      Rng& rng);

// The standard regimes.
struct SyntheticRegime {
  std::string_view name;
  std::string_view title;
  // What its problems are named after, and so their random numbers: "A" to "F".
  std::string_view stream;
  int num_problems;
  SyntheticOptions options;
};
std::span<const SyntheticRegime> AllRegimes();
const SyntheticRegime& RegimeByName(std::string_view name);

// A regime's problems with an independent stream each: the first ones are the same for any count.
std::vector<SyntheticProblem> MakeRegime(const SyntheticRegime& regime, int count,
                                         uint64_t seed = 0);

}  // namespace raylift
