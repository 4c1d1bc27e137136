// The poses that results are judged by.

#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "raylift/evaluation/pose_errors.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// The poses of a COLMAP model's folder or a pose file with the cameras: the model's, or those of a
// query list (which must then be given and hold every name).
std::vector<PosedImage> ReadPosedQueries(const std::filesystem::path& model_or_file,
                                         const std::filesystem::path& query_list);

// The poses in the order of their times, in seconds: those of the file, which must know all, or
// else their places in the order of the numbers in their names.
struct TimedName {
  double time_s = 0;
  std::string name;
};
std::vector<TimedName> InOrderOfTime(const PosesByName& poses,
                                     const std::filesystem::path& times_file);

// Result files are mostly called poses.txt: then the folder tells them apart.
std::string ResultName(const std::filesystem::path& file);

}  // namespace raylift
