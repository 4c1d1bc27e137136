// Lists of query photographs with intrinsics, and lists of poses: the field's plain text files.

#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// Lines `name MODEL width height params...`; `#` comments and empty lines are skipped. The file
// name may hold `*` and `?` (several lists, in the order of their names). A name that stands twice
// is an error.
//
// Where the folder of the photographs is given, a line may be a name alone: then the camera is a
// pinhole with the principal point in the middle and a focal length of 1.2 times the longer side, as
// COLMAP has it, which the query's priors say to be known up to a factor of two.
std::vector<Query> ReadQueryList(const std::filesystem::path& path_or_pattern,
                                 const std::filesystem::path& images = {});
void WriteQueryList(const std::filesystem::path& path, const std::vector<Query>& queries);

// One image name per line.
std::vector<std::string> ReadImageList(const std::filesystem::path& path);

struct NamedPose {
  std::string name;
  Rigid3 cam_from_world;
};

// Lines `name qw qx qy qz tx ty tz`, world to camera. Quaternions are normalized; one that is not
// of unit length within 1e-3 is an error, as is a NaN. Numbers behind the pose are passed over: pGT's
// focal length, the errors and inliers of DSAC* and ACE.
std::vector<NamedPose> ReadPoseFile(const std::filesystem::path& path);
// Numbers in their shortest form that reads back as the same double.
void WritePoseFile(const std::filesystem::path& path, const std::vector<NamedPose>& poses);

}  // namespace raylift
