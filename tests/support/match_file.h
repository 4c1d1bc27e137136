// Writes matches.h5 as hloc does.

#pragma once

#include <algorithm>
#include <array>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "io/hloc/hdf5_file.h"

#include "raylift/base/error.h"
#include "raylift/scene/features.h"

namespace raylift {

struct MatchedPair {
  std::string query_name;
  std::string reference_name;
  size_t num_query_keypoints;
  std::vector<FeatureMatch> matches;
};

inline void WritePair(const MatchedPair& pair, Hdf5Writer* file) {
  std::string group = pair.query_name + '/' + pair.reference_name;
  const auto flatten = [&group](size_t begin, size_t end) {
    std::replace(group.begin() + static_cast<ptrdiff_t>(begin),
                 group.begin() + static_cast<ptrdiff_t>(end), '/', '-');
  };
  flatten(0, pair.query_name.size());
  flatten(pair.query_name.size() + 1, group.size());
  std::vector<int64_t> indices(pair.num_query_keypoints, -1);
  std::vector<float> scores(pair.num_query_keypoints, 0);
  int64_t largest = 0;
  for (const FeatureMatch& match : pair.matches) {
    const auto i = static_cast<size_t>(match.query_index);
    RAYLIFT_CHECK(match.query_index >= 0 && i < indices.size() && match.reference_index >= 0);
    indices[i] = match.reference_index;
    scores[i] = match.score;
    largest = std::max(largest, indices[i]);
  }
  const std::array shape{pair.num_query_keypoints};
  file->WriteIntegers(group + "/matches0", shape, indices, largest <= INT16_MAX ? 2 : 4);
  file->WriteFloats(group + "/matching_scores0", shape, scores, Hdf5Kind::kHalf);
}

inline void WriteMatchFile(const std::filesystem::path& path, std::span<const MatchedPair> pairs) {
  Hdf5Writer file(path);
  for (const MatchedPair& pair : pairs) {
    WritePair(pair, &file);
  }
  file.Commit();
}

}  // namespace raylift
