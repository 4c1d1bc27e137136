// hloc's matches of pairs of images, matches.h5.

#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/scene/features.h"

namespace raylift {

class MatchFile {
 public:
  explicit MatchFile(const std::filesystem::path& path);
  ~MatchFile();
  MatchFile(MatchFile&&) noexcept;
  MatchFile& operator=(MatchFile&&) noexcept;

  // The matches of a pair whichever way round and in whichever naming (new or old) it is stored;
  // none where the pair is not in the file. Whether the indices fit the keypoints is the caller's
  // to check. Safe to call from several threads.
  std::optional<std::vector<FeatureMatch>> Read(const std::string& query_name,
                                                const std::string& reference_name) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

struct PairMatches {
  std::string query_name;
  std::string reference_name;
  size_t num_query_keypoints;
  std::vector<FeatureMatch> matches;
};
// InputError where the format cannot hold the matches: two of one query keypoint, or two pairs
// whose names differ only by "/" and "-".
void WriteMatchFile(const std::filesystem::path& path, std::span<const PairMatches> pairs);

}  // namespace raylift
