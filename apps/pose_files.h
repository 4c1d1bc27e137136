// Poses in files: those that results are judged by, and what a run of localize has left behind, for
// commands that go on with it.

#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "apps/options.h"

#include "raylift/evaluation/pose_errors.h"
#include "raylift/geometry/geodesy.h"
#include "raylift/localization/localizer.h"
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

// What a run of localize has left behind.
struct FinishedRun {
  std::vector<LocalizedQuery> queries;  // in the order of the list, with and without poses
  // As its options.json has them: relative paths start where it ran. Empty where it has none.
  std::filesystem::path query_list, query_images;
  ReferenceFlags references;
  bool leave_one_out = false;  // the queries are the model's images, and there is no list
  std::vector<std::string> geometry;
  std::optional<WorldFrame> world;

  // Returns the listed queries that have a pose, in the order of the run's, with their cameras.
  // Throws InputError where one is not listed, OptionError where there is no list.
  std::vector<Query> PosedQueries() const;
};

// From the folder of a run, or from a pose file alone, whose poses all count as localized. Throws
// InputError where it is neither.
FinishedRun ReadFinishedRun(const std::filesystem::path& folder_or_pose_file);

}  // namespace raylift
