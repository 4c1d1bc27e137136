// Minimal solvers, which return the poses that fit the fewest matches that determine one; and the
// refinement of any given pose. RANSAC over a whole problem is in pose_estimator.h.
//
// Rays point from a camera's center to what it sees, in the camera's frame (z along the optical
// axis); they need not have length 1 (Camera::RayInCam() gives those of pixels). Points are in the
// world's frame, in any unit. A sample has up to the number of solutions that is given; only those
// are returned that are finite and put every point in front of its cameras. A degenerate sample has
// none.

#pragma once

#include <span>
#include <vector>

#include <Eigen/Core>

#include "raylift/estimation/pose_estimator.h"
#include "raylift/geometry/rigid3.h"

namespace raylift {

struct EstimatorOptions;
struct PoseProblem;

// Solves P3P, a camera from three points, by Lambda Twist (Persson and Nordberg, ECCV 2018). There
// are up to 4 solutions, none for points on a line.
std::vector<Rigid3> SolveP3p(std::span<const Eigen::Vector3d, 3> rays_in_cam,
                             std::span<const Eigen::Vector3d, 3> points_in_world);

// Solves generalized P3P, a rig from three points, each seen by a camera of its own at a center in
// the rig's frame, whose axes the rays have, too. Returns rig_from_world; up to 8 solutions (Nister
// and Stewenius, JMIV 2007).
std::vector<Rigid3> SolveGeneralizedP3p(std::span<const Eigen::Vector3d, 3> centers_in_rig,
                                        std::span<const Eigen::Vector3d, 3> rays_in_rig,
                                        std::span<const Eigen::Vector3d, 3> points_in_world);

// Solves E5+1, a camera from five 2D-2D matches with one reference, which give its rotation and the
// direction of its translation (Nister, TPAMI 2004), and a sixth match with another reference,
// which gives the length (Zheng and Wu, ICCV 2015). Each reference's rays are in its own frame.
// There are up to 10 solutions, none where both references have one center.
std::vector<Rigid3> SolveE5p1(std::span<const Eigen::Vector3d, 6> rays_in_cam,
                              std::span<const Eigen::Vector3d, 6> rays_in_reference,
                              const Rigid3& reference_from_world,
                              const Rigid3& sixth_reference_from_world);

// Solves D3+1, a camera as in E5+1, but from three matches whose points are known in the
// reference's frame up to one common positive factor (depth of any scale): P3P gives rotation and
// direction, whatever the factor, and a fourth match with another reference the length. There are
// up to 4 solutions.
std::vector<Rigid3> SolveD3p1(std::span<const Eigen::Vector3d, 4> rays_in_cam,
                              std::span<const Eigen::Vector3d, 3> points_in_reference,
                              const Eigen::Vector3d& ray_in_fourth_reference,
                              const Rigid3& reference_from_world,
                              const Rigid3& fourth_reference_from_world);

// Solves UP2P, a camera from two points and the direction of gravity in both frames; up to 2
// solutions, none where both rays are level or one point is above the other (Kukelova, Bujnak and
// Pajdla, ACCV 2010).
std::vector<Rigid3> SolveUp2p(std::span<const Eigen::Vector3d, 2> rays_in_cam,
                              std::span<const Eigen::Vector3d, 2> points_in_world,
                              const Eigen::Vector3d& down_in_cam,
                              const Eigen::Vector3d& down_in_world);

// Solves for a camera with a known center from two points: the rotation that turns their directions
// into the rays, as nearly as the angle between them allows. There is one solution, none where they
// lie on one line with the center.
std::vector<Rigid3> SolveKnownCenter(std::span<const Eigen::Vector3d, 2> rays_in_cam,
                                     std::span<const Eigen::Vector3d, 2> points_in_world,
                                     const Eigen::Vector3d& center_in_world);

// Refines a pose without RANSAC: by local optimization on the matches near it, and then as the
// options' method refines RANSAC's best pose. It must be so near that some right matches lie within
// three thresholds. Select refines it by either match set and takes one of both; HLoc refines it on
// all 2D-3D matches. The camera's focal length is taken for granted, and the confidence is that of
// a pose which was tried alone. Throws OptionError where the options are out of range.
PoseEstimate RefinePose(const PoseProblem& problem, const EstimatorOptions& options,
                        const Rigid3& initial_cam_from_world);

}  // namespace raylift
