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

// Result files are mostly called poses.txt: then the folder tells them apart.
std::string ResultName(const std::filesystem::path& file);

}  // namespace raylift
