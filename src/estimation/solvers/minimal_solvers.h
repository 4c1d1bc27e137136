// The minimal solvers as RANSAC calls them, on the stack: each writes the poses of one sample and
// returns their count. raylift/estimation/solvers.h has them for everyone.

#pragma once

#include <array>
#include <optional>
#include <span>

#include "estimation/problem/cam_from_local.h"
#include <Eigen/Core>

namespace raylift {

// The pose of a camera from three points (P3P), by the Lambda Twist of Persson and Nordberg (ECCV
// 2018): the three distance equations define two quadratic forms; one real root of a cubic makes a
// combination of them degenerate, that is a pair of planes, and each plane leaves a quadratic.

// `rays` are unit vectors in the camera frame. Writes the poses that put all three points in front
// of the camera (along their rays) and returns their count, 0 to 4; 0 for collinear or coinciding
// points. All poses are finite.
int SolveP3p(const std::array<Eigen::Vector3d, 3>& rays,
             const std::array<Eigen::Vector3d, 3>& points_in_world,
             std::span<CamFromLocal, 4> poses);

// The pose of a rig from three points, each seen by a camera of its own (generalized P3P; Nister
// and Stewenius, "A minimal solution to the generalised 3-point pose problem", JMIV 2007). The
// distances between the points are three quadratic equations in how far along its ray each lies;
// two of them are eliminated linearly, which leaves a polynomial of degree eight in one.

inline constexpr int kMaxGeneralizedP3pSolutions = 8;

// `centers` are those of the cameras that see the points, `rays` unit vectors, both in the rig's
// frame. Writes the poses (rig_from_world) that put all points in front of their cameras, along the
// rays, and returns their count; 0 for collinear or coinciding points. All poses are finite.
int SolveGeneralizedP3p(const std::array<Eigen::Vector3d, 3>& centers,
                        const std::array<Eigen::Vector3d, 3>& rays,
                        const std::array<Eigen::Vector3d, 3>& points_in_world,
                        std::span<CamFromLocal, kMaxGeneralizedP3pSolutions> poses);

// The relative pose of two calibrated cameras from five matches: the essential matrices by Nister
// (TPAMI 2004), with his elimination to a polynomial of degree ten in one unknown, decomposed by
// Horn's closed form (1990) and polished by Newton's method on the five epipolar equations.

inline constexpr int kMaxFivePointSolutions = 10;

// Writes the essential matrices E with query_ray' E reference_ray = 0, and returns their count.
int SolveEssential(const std::array<Eigen::Vector3d, 5>& query_rays,
                   const std::array<Eigen::Vector3d, 5>& reference_rays,
                   std::span<Eigen::Matrix3d, kMaxFivePointSolutions> essentials);

// Is query_from_reference up to the length of the translation, which is one.
struct RelativePose {
  Eigen::Matrix3d rotation;
  Eigen::Vector3d direction;
};

// Writes the relative poses that put all five points in front of both cameras, and returns their
// count. Rays are unit vectors. All poses are finite, rotations orthogonal to rounding.
int SolveRelativePose(const std::array<Eigen::Vector3d, 5>& query_rays,
                      const std::array<Eigen::Vector3d, 5>& reference_rays,
                      std::span<RelativePose, kMaxFivePointSolutions> poses);

// The pose of a query from five matches to one reference and one match to another (E5+1; Zheng and
// Wu, ICCV 2015): the five give rotation and direction of the translation, the sixth its length.

// A match to one reference: unit rays, the reference's in world axes.
struct RayPair {
  Eigen::Vector3d query_ray;
  Eigen::Vector3d reference_ray;
};

// Returns cam_from_world of the query for a reference at `center` (rays in world axes) and a
// translation of `length` along the relative pose's direction.
CamFromLocal QueryPose(const RelativePose& relative, const Eigen::Vector3d& center, double length);

// Returns the length of the translation from the first reference at which the sixth match, to a
// reference at `sixth_center`, meets its epipolar constraint; nullopt where it is not positive and
// finite, or where the sixth point would lie behind the query or behind its own reference. nullopt,
// too, where the match says nothing of the length, its rays lying in one plane with the direction.
std::optional<double> TranslationLength(const RelativePose& relative, const Eigen::Vector3d& center,
                                        const RayPair& sixth, const Eigen::Vector3d& sixth_center);

// The pose of a query from three matches to one reference whose depths are known up to a common
// factor, and one match to another reference (D3+1): the three give rotation and direction of the
// translation by P3P, whatever the factor, and the fourth gives its length as the sixth match of
// E5+1 does (TranslationLength()). For depth whose scale is each reference's own, as of a single
// image.

// Writes the relative poses of three matches: unit rays of the query, and the points from the
// reference's center, in world axes, up to a common positive factor. Returns their count; 0 where
// the query is at the reference's center, as that has no direction, and where P3P has no solution.
int SolveRelativePoseByDepth(const std::array<Eigen::Vector3d, 3>& query_rays,
                             const std::array<Eigen::Vector3d, 3>& points_from_center,
                             std::span<RelativePose, 4> poses);

// Poses from two 2D-3D matches, where the camera's center or its vertical direction is known.

// Returns the pose at a center whose rotation turns the directions of two points from there into
// their rays, as nearly as the angle between them allows. `rays` are unit vectors in the camera
// frame. nullopt where the rays, or the points as seen from the center, lie in one line.
std::optional<CamFromLocal> SolvePoseAtCenter(const std::array<Eigen::Vector3d, 2>& rays,
                                              const std::array<Eigen::Vector3d, 2>& points_in_world,
                                              const Eigen::Vector3d& center_in_world);

// Writes the poses that turn the world's direction of gravity into the camera's and put both points
// onto their rays, in front of the camera (UP2P; Kukelova, Bujnak and Pajdla, "Closed-form
// solutions to minimal absolute pose problems with known vertical direction", ACCV 2010, by the two
// depths). Rays and directions of gravity have length 1. Returns their count; 0 for a degenerate
// sample: both rays level, or one point above the other. `centers` are those of the cameras that
// see the points, in the frame of the pose; they are zero, but for a rig.
int SolveUprightPose(const std::array<Eigen::Vector3d, 2>& centers,
                     const std::array<Eigen::Vector3d, 2>& rays,
                     const std::array<Eigen::Vector3d, 2>& points_in_world,
                     const Eigen::Vector3d& down_in_cam, const Eigen::Vector3d& down_in_world,
                     std::span<CamFromLocal, 2> poses);

}  // namespace raylift
