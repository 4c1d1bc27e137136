// Pose problems on disk: JSON, the interchange file of pose estimators. "pose-problem/1" and, where
// something is known of the pose, "pose-problem/2", whose "query" also holds "position_prior"
// {"position", "sigma": both [x, y, z], world}, "gravity_prior" {"down_in_cam", "down_in_world",
// "sigma_deg"} or "focal_range", the factor up to which the camera's focal length is known; and, of
// a rig, "other_cameras" [{"name", "camera", "cam_from_query": a pose}], while
// "matches_2d2d_camera" and "matches_2d3d_camera" hold a number per match: 0 for the query's own
// camera, i for other_cameras[i - 1]. Both are read.
//
// Beyond the format's own members, the query's "heading_prior", "orientation_prior" and
// "range_prior" (of PosePriors), "focal_sigma" (of its focal length, as a share of it),
// "reference_sigmas" (how far the references err as wholes: "factor", "rotation_deg" and
// "position", each of them if known), "search_area_px2" (of PoseProblem), "reference_clusters" (the
// covisibility cluster of each reference), "matches_2d3d_reference" (an index or null per 2D-3D
// match), "matches_2d3d_sigma", "matches_2d3d_log_depth_sigma" and "matches_2d2d_sigma_px" (a
// number or null per match: of the point, of its distance's logarithm, of the reference pixel) keep
// what the format has no place for, and so does "extra", whose members hold an integer or null per
// match: "keypoint" (of a 2D-2D match: which keypoint of the query it is of), "keypoint_2d3d" (the
// same of a 2D-3D match; where it is missing, "keypoint" is of the 2D-3D matches as well if there
// are as many), "reference_keypoint" (of a 2D-2D match) and "match_2d2d" (the 2D-2D match that a
// 2D-3D match was lifted from). Readers that do not know them lose nothing else. In a file without
// indices of keypoints equal pixels are one keypoint, see keypoints.h; all matches that are read
// have one.

#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "raylift/geometry/rigid3.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

// A pose problem and, apart from it, the ground truth that only an evaluation may use.
struct PoseProblemFile {
  PoseProblem problem;
  std::optional<Rigid3> gt_cam_from_world;
};

// Reads a pose problem. Throws InputError with the JSON path for anything wrong: a missing member,
// a reference index out of range, a value that is not finite.
PoseProblemFile ReadPoseProblem(const std::filesystem::path& path);
PoseProblemFile ParsePoseProblem(std::string_view json,
                                 const std::filesystem::path& path_for_messages);

// Writes a pose problem; numbers read back as the same doubles.
void WritePoseProblem(const std::filesystem::path& path, const PoseProblemFile& file);
std::string FormatPoseProblem(const PoseProblemFile& file);

// Returns the .json files of a folder and the folders in it, in the order of their paths, or the
// file itself. Throws InputError where there are none.
std::vector<std::filesystem::path> ListPoseProblems(const std::filesystem::path& file_or_folder);

}  // namespace raylift
