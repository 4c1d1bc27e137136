// Photographs whose poses are known, are to be taken or are looked for.

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

// A reference photograph, or a picture to be taken of a scene: its name, its camera and where it is.
struct PosedImage {
  std::string name;  // as in the model: a path relative to the image folder
  Camera camera;
  Rigid3 cam_from_world;

  // Whether it would show the point if nothing were in between.
  bool Sees(const Eigen::Vector3d& point_in_world) const;
};

// What a photograph says of the camera that took it, as far as it says something.
struct LensTags {
  std::optional<double> film_mm;  // the focal length on film of 36 mm x 24 mm
  // What drones write: fx, fy, the principal point from the picture's middle, then k1, k2, p1, p2
  // and k3 as OpenCV has them; pixels of the picture as it was taken.
  std::optional<std::array<double, 9>> calibration;
  std::optional<double> taken_width_px;
};

struct PositionPrior {
  Eigen::Vector3d position;  // of the camera's center, world frame
  // Standard deviation along each axis of the world, scene units; 0: exact.
  Eigen::Vector3d sigma = Eigen::Vector3d::Zero();
};

struct GravityPrior {
  Eigen::Vector3d down_in_cam;    // any length but 0
  Eigen::Vector3d down_in_world;  // any length but 0
  double sigma_deg = 1;  // standard deviation of the angle about each axis across; 0: exact
};

// Which way the camera looks on the map: right in its image is a horizontal direction of the world.
// It says nothing of cameras that are rolled by so much that their right points up or down.
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
  // without one the range says nothing.
  struct Plane {
    Eigen::Vector3d point;
    Eigen::Vector3d normal;  // any length but 0
    double sigma = 0;        // of the surface's distance from it along the axis, as on edges
  };
  std::optional<Plane> plane = std::nullopt;
};

inline constexpr double kMaxFocalRange = 10;
// Focal lengths that are less certain are looked for, see PosePriors::focal_range.
inline constexpr double kMaxFocalSigma = 0.3;

// The prior knowledge of a query's pose: a position from GNSS, the direction of gravity from an
// accelerometer, the heading from a compass, or all of the orientation; the range to what is in the
// middle; and what is not known of its camera.
struct PosePriors {
  std::optional<PositionPrior> position = std::nullopt;
  std::optional<GravityPrior> gravity = std::nullopt;
  std::optional<HeadingPrior> heading = std::nullopt;
  std::optional<OrientationPrior> orientation = std::nullopt;
  std::optional<RangePrior> range = std::nullopt;
  // The focal length is the given camera's up to this factor either way, of 1 (it is known) to
  // kMaxFocalRange. Where an estimator is asked to refine it, too, the wider range counts.
  double focal_range = 1;
  // The standard deviation of the given focal length as a share of it, from 0 (it is exact) to
  // kMaxFocalSigma, where it is not looked for: then the pose takes it into account. nullopt where
  // nothing is known of it, which counts as exact.
  std::optional<double> focal_sigma = std::nullopt;

  // Nothing is known of the pose, and the focal length is not to be looked for.
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

// A photograph whose pose is looked for.
struct Query {
  std::string name;
  Camera camera;
  PosePriors priors = {};
  std::optional<RigMount> rig = std::nullopt;
};

// Sparser references: every N-th image of a scene by name, to see what fewer of them cost.
struct Subsampling {
  int every = 1;   // at least 1; 1 keeps all
  int offset = 0;  // of the first that is kept, from 0 to every - 1
  // Every N-th image of each camera rather than of all: where the cameras of a rig take turns, an
  // even N would keep those of one camera alone.
  bool per_camera = false;

  bool KeepsAll() const { return every == 1; }
};

// The indices of the images that are kept, in order. `cameras` says which camera took each image,
// the images being sorted by name.
std::vector<size_t> KeptIndices(std::span<const std::string> cameras,
                                const Subsampling& subsampling);

}  // namespace raylift
