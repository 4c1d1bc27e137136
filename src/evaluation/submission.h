// Says whether a file of poses can be handed in at visuallocalization.net, whose server accepts a
// wrong file silently and rates it 0: lines `name qw qx qy qz tx ty tz`, world to camera, one per
// query.

#pragma once

#include <cstddef>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

namespace raylift {

struct SubmissionReport {
  size_t num_queries = 0;
  size_t num_poses = 0;               // of known queries
  std::vector<std::string> problems;  // one line each; empty: fit to be handed in
  std::vector<std::string> remarks;   // what is allowed, but may not be meant
  std::vector<std::string> missing;   // queries without a pose, which is allowed
};

// Names must be those of the queries or their ends from a `/` on. `reference_centers` (may be
// empty) say where the scene is: where most camera centers lie far outside of it and would not,
// were the poses camera to world, the direction is wrong. Throws InputError where the file cannot
// be read.
SubmissionReport CheckSubmission(const std::filesystem::path& file,
                                 std::span<const std::string> query_names,
                                 std::span<const Eigen::Vector3d> reference_centers);

}  // namespace raylift
