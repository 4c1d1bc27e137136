// Photographs: references, whose poses are known, queries, whose poses are looked for, and what is
// known of these beforehand.

#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"

namespace raylift {

// A reference photograph, or a picture that is to be rendered: its name, camera and pose.
struct PosedImage {
  std::string name;  // as in the model: a path relative to the image folder
  Camera camera;
  Rigid3 cam_from_world;

  // Returns whether the image would show the point if nothing occluded it.
  bool Sees(const Eigen::Vector3d& point_in_world) const;
};

// The camera that took a photograph, as far as the photograph's tags tell it.
struct LensTags {
  std::optional<double> film_mm;  // the focal length on film of 36 mm x 24 mm
  // As drones write it: fx, fy, the principal point from the picture's middle, then k1, k2, p1, p2
  // and k3 as in OpenCV; pixels of the picture as it was taken.
  std::optional<std::array<double, 9>> calibration;
  std::optional<double> taken_width_px;
};

struct PositionPrior {
  Eigen::Vector3d position;  // of the camera's center, world frame
  // These are standard deviations along each axis of the world, in scene units; 0 is exact.
  Eigen::Vector3d sigma = Eigen::Vector3d::Zero();
};

struct GravityPrior {
  Eigen::Vector3d down_in_cam;    // any length but 0
  Eigen::Vector3d down_in_world;  // any length but 0
  double sigma_deg = 1;  // standard deviation of the angle about each axis across; 0: exact
};

// The heading of the camera on the map: right in its image is a horizontal direction of the world.
// It does not apply to cameras that are rolled by so much that their right points up or down.
struct HeadingPrior {
  Eigen::Vector3d right_in_cam = Eigen::Vector3d::UnitX();  // any length but 0
  Eigen::Vector3d right_in_world;                           // any length but 0
  Eigen::Vector3d down_in_world;                            // not along right_in_world
  double sigma_deg = 10;  // standard deviation of the angle about the vertical; 0: exact
};

struct OrientationPrior {
  Eigen::Quaterniond cam_from_world = Eigen::Quaterniond::Identity();  // unit
  double sigma_deg = 1;  // standard deviation of the angle about each axis; 0: exact
};

// The distance from the camera's center along its optical axis to the surface, by a laser.
struct RangePrior {
  double range = 0;  // scene units, positive
  double sigma = 0;  // its standard deviation; 0: exact
  // The surface's plane there, in the world. Localizer finds it where a first estimate looks;
  // without it the range is not used.
  struct Plane {
    Eigen::Vector3d point;
    Eigen::Vector3d normal;  // any length but 0
    double sigma = 0;        // of the surface's distance from it along the axis, as on edges
  };
  std::optional<Plane> plane = std::nullopt;
};

inline constexpr double kMaxFocalRange = 10;
// The largest focal_sigma. Focal lengths that are less certain are estimated, see
// PosePriors::focal_range.
inline constexpr double kMaxFocalSigma = 0.3;

// The prior knowledge of a query's pose: a position from GNSS, the direction of gravity from an
// accelerometer, the heading from a compass, or the whole orientation; the range to the surface in
// the middle; and the uncertainty of its focal length.
struct PosePriors {
  std::optional<PositionPrior> position = std::nullopt;
  std::optional<GravityPrior> gravity = std::nullopt;
  std::optional<HeadingPrior> heading = std::nullopt;
  std::optional<OrientationPrior> orientation = std::nullopt;
  std::optional<RangePrior> range = std::nullopt;
  // The focal length is within this factor of the given camera's, from 1 (it is known) to
  // kMaxFocalRange. Where an estimator is asked to refine it, too, the wider range counts.
  double focal_range = 1;
  // The standard deviation of the given focal length as a share of it, from 0 (exact) to
  // kMaxFocalSigma, where it is not estimated: the pose's covariance then includes it. nullopt
  // where it is not known, which counts as exact.
  std::optional<double> focal_sigma = std::nullopt;

  // Returns whether nothing is known of the pose, and the focal length is not to be estimated.
  bool empty() const {
    return !position && !gravity && !heading && !orientation && !range && focal_range == 1;
  }
};

// The place of a photograph's camera on a rig. Photographs of one frame were taken at one moment
// and have one unknown pose together.
struct RigMount {
  std::string frame;
  int sensor = 0;  // among the rig's cameras: the first one that a frame has speaks for it
  Rigid3 cam_from_rig;
};

// A photograph whose pose is to be estimated.
struct Query {
  std::string name;
  Camera camera;
  PosePriors priors = {};
  std::optional<RigMount> rig = std::nullopt;
};

// Subsampling of the references: every N-th image of a scene by name, to measure what fewer
// references cost.
struct Subsampling {
  int every = 1;   // at least 1; 1 keeps all
  int offset = 0;  // of the first that is kept, from 0 to every - 1
  // Takes every N-th image of each camera rather than of all: where the cameras of a rig take
  // turns, an even N would keep those of one camera alone.
  bool per_camera = false;

  bool KeepsAll() const { return every == 1; }
};

// Returns the indices of the images that are kept, in order. `cameras` names the camera that took
// each image; the images are sorted by name.
std::vector<size_t> KeptIndices(std::span<const std::string> cameras,
                                const Subsampling& subsampling);

}  // namespace raylift
