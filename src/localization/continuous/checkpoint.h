// Keeps what continuous localization has done so far on disk: a file for each query, written the
// moment it is done, so that a run that was stopped or killed can go on where it was.

#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "localization/continuous/joined_references.h"

#include "raylift/localization/localizer.h"

namespace raylift {

// A query that is done.
struct ContinuousRecord {
  // Of a record that was read, as far as poses.txt and summary.json need it.
  LocalizedQuery localized;
  // Its line of queries.jsonl, without the line's end.
  std::string diagnostics;
  std::optional<JoinedReference> joined;  // none: it did not join the references
};

class ContinuousCheckpoint {
 public:
  // `key` tells runs apart that give different results. With `resume`, the records that a run of
  // the same key has left in `folder` are kept, else they are removed. InputError where they are of
  // another key.
  ContinuousCheckpoint(std::filesystem::path folder, const std::string& key, bool resume);

  // The record of the query in this place of the order; none where it is not done. InputError where
  // it is malformed or of another query.
  std::optional<ContinuousRecord> Read(size_t place, const Query& query) const;
  // Complete or not there at all, whenever the run is killed.
  void Write(size_t place, const ContinuousRecord& record) const;

 private:
  std::filesystem::path FileOf(size_t place) const;

  std::filesystem::path folder_;
};

}  // namespace raylift
