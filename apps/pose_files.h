// The poses that results are judged by.

#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "raylift/evaluation/pose_errors.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// InputError where a name stands twice.
PosesByName ReadPoses(const std::filesystem::path& file);

// From a COLMAP model's folder or a pose file.
PosesByName ReadGroundTruth(const std::filesystem::path& model_or_file);

// The same with the cameras: the model's, or those of a query list (which must then be given and
// hold every name).
std::vector<PosedImage> ReadPosedQueries(const std::filesystem::path& model_or_file,
                                         const std::filesystem::path& query_list);

// The poses in the order of their times, in seconds: those of the file, which must know all, or
// else their places in the order of names.
struct TimedName {
  double time_s = 0;
  std::string name;
};
std::vector<TimedName> InOrderOfTime(const PosesByName& poses,
                                     const std::filesystem::path& times_file);

// Result files are mostly called poses.txt: then the folder tells them apart.
std::string ResultName(const std::filesystem::path& file);

}  // namespace raylift
