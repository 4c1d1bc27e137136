// Reads poses from files: ground truth, and the results of a run of localize for commands that go
// on with it.

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

// Returns the poses of a COLMAP model's folder or a pose file, with the cameras of the query list,
// which must hold every name, or of the model where no list is given; a pose file needs the list.
std::vector<PosedImage> ReadPosedQueries(const std::filesystem::path& model_or_file,
                                         const std::filesystem::path& query_list);

// Returns the names of the poses in the order of their times, in seconds: those of the times file,
// which must hold all names, or, without a file, their places in the order of the numbers in their
// names.
struct TimedName {
  double time_s = 0;
  std::string name;
};
std::vector<TimedName> InOrderOfTime(const PosesByName& poses,
                                     const std::filesystem::path& times_file);

// Returns a short name of a result file: its stem or, where that is "poses", as of most, its
// folder.
std::string ResultName(const std::filesystem::path& file);

// The results and inputs of a finished run of localize.
struct FinishedRun {
  std::vector<LocalizedQuery> queries;  // in the order of the list, with and without poses
  // Paths are as options.json has them: relative paths start where the run was started. They are
  // empty where there is none.
  std::filesystem::path query_list, query_images;
  ReferenceFlags references;
  bool leave_one_out = false;  // the queries are the model's images, and there is no list
  std::vector<std::string> geometry;
  std::optional<WorldFrame> world;

  // Returns the queries with their cameras, in the order of `queries`. Throws InputError where one
  // is not listed, OptionError where there is no list.
  std::vector<Query> PosedQueries() const;
};

// Reads the folder of a run, or a pose file alone, whose poses all count as localized. Throws
// InputError where it is neither.
FinishedRun ReadFinishedRun(const std::filesystem::path& folder_or_pose_file);

}  // namespace raylift
