// The pieces of work of an experiment. A cell is one setting with one seed on a block of a scene's
// queries; what comes out of it is kept in a file that is named by the hash of all that went in, so
// that a cell is estimated once and a changed input is noticed.

#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "raylift/experiment/experiment.h"
#include "raylift/scene/photographs.h"

namespace raylift {

struct Cell {
  Setting setting;
  uint64_t seed = 0;
  size_t offset = 0;          // of the first reference that is taken
  size_t begin = 0, end = 0;  // of the scene's queries
  std::string inputs;         // all that went in, as JSON

  std::string Key() const;  // the hash of the inputs
};

// Says whether a file or folder is still the same: by its contents, or, where it is large, by sizes
// and times of modification. Remembers what it looked at. InputError where there is nothing.
class InputIdentity {
 public:
  const std::string& Of(const std::filesystem::path& path);

 private:
  std::map<std::filesystem::path, std::string> known_;
};

// The experiment's paths with the thinning put in for "{every}".
std::filesystem::path ForThinning(const std::filesystem::path& path, size_t every);
// The files or folders of a specification of geometry; none where it names none ("sfm").
std::vector<std::filesystem::path> PathsOfSpec(const std::string& spec);

// The queries of a scene, or those of its group. InputError where there are none.
std::vector<Query> QueriesOf(const ExperimentScene& scene);

// The inputs of the settings' scenes that are not there.
std::vector<std::filesystem::path> MissingInputs(const Experiment& experiment,
                                                 std::span<const Setting> settings);

// The offsets that thinning is run with.
size_t NumOffsets(const Experiment& experiment, const Setting& setting);

// The cells of the settings, by scene, thinning, block of queries, geometry. InputError where an
// input is missing.
std::vector<Cell> ListCells(const Experiment& experiment, std::span<const Setting> settings);

}  // namespace raylift
