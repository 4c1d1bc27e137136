// Perturbs depth maps and odometry, each in the way that some source of them is bad: to test what a
// localizer withstands, and that a comparison names the fault. The same seed gives the same errors.

#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "raylift/base/enum_names.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/scene/image.h"

namespace raylift {

// The perturbations are applied in this order; 0 (for a factor, 1) leaves the depth as it is. Holes
// stay holes. Each kind draws from a random stream of its own by seed and image, so that adding one
// leaves the others as they were.
struct DepthPerturbation {
  double scale = 1;           // one factor for all images
  double scale_sigma = 0;     // ln of a factor per image
  double offset = 0;          // scene units, added
  double warp_sigma = 0;      // ln of a smooth field's factors, nodes of a 5 x 4 grid
  int bubbles = 0;            // per image: smooth domes toward the camera (Poisson meshing)
  double bubble_height = .2;  // of a bubble, relative to the depth
  int floaters = 0;           // per image: small blobs in front of the surface (over-fitted NeRFs)
  double flying_share = 0;    // of the pixels at depth edges: moved between the two surfaces
  double smoothing_px = 0;    // standard deviation of a Gaussian over all surfaces
  double noise_sigma = 0;     // scene units, per pixel
  double relative_noise_sigma = 0;  // times the depth, per pixel
  double clamp = 0;                 // scene units: what is farther is put there
  double quantization_step = 0;     // scene units
  int quantization_bits = 0;        // of an integer whose largest value is the map's
  double hole_share = 0;            // of the pixels, in blobs
  uint64_t seed = 0;

  // Throws OptionError for a value out of its range.
  void Validate() const;

  bool operator==(const DepthPerturbation&) const = default;
};

// Returns the depth smoothed by a Gaussian of `sigma_px`: the weighted mean of the known depths
// within 3 sigma. Holes stay holes.
DepthMap SmoothDepth(const DepthMap& map, double sigma_px);

DepthMap PerturbDepth(const DepthMap& map, const DepthPerturbation& perturbation,
                      std::string_view image_name);

// The confidence map that stands beside the depth of a simulated network.
enum class MadeConfidence {
  kNone,
  kInformative,  // falls with the size of the errors around, but knows of no scale and no warp
  kRandom,       // a smooth field that tells nothing
};
template <>
inline constexpr auto kEnumNames<MadeConfidence> = std::to_array<EnumName<MadeConfidence>>({
    {MadeConfidence::kNone, "none"},
    {MadeConfidence::kInformative, "informative"},
    {MadeConfidence::kRandom, "random"},
});

// Returns confidences, from 1 on, for the map that PerturbDepth() makes. `kind` must not be kNone.
DepthMap ConfidenceOfPerturbed(const DepthMap& map, const DepthPerturbation& perturbation,
                               MadeConfidence kind, std::string_view image_name);

// Makes odometry from a true trajectory, with the errors that odometry has.

// Errors of drift are drawn for each step, so that they add up as in a random walk: their deviation
// grows with the square root of the way.
struct OdometryPerturbation {
  double drift_sigma = 0;     // of the position over a scene unit of way, per axis, scene units
  double turn_sigma_deg = 0;  // of the orientation over a scene unit of way, per axis
  double unit = 1;            // scene units per unit of the odometry
  double lost_share = 0;      // of the steps: the odometry begins anew somewhere
  double dropout_share = 0;   // of the poses, which are missing

  // Throws OptionError for a value out of its range.
  void Validate() const;
};

struct OdometryPose {
  size_t index = 0;  // in the trajectory
  Rigid3 cam_from_odometry;
};

// Returns the odometry of a trajectory. Its world is the first camera's frame.
std::vector<OdometryPose> PerturbOdometry(std::span<const Rigid3> cam_from_world,
                                          const OdometryPerturbation& perturbation, uint64_t seed);

}  // namespace raylift
