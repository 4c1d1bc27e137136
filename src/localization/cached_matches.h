// Matches that are asked for twice: to correct the depth by, and by their query's own turn.

#pragma once

#include <cstddef>
#include <memory>
#include <mutex>
#include <string>
#include <unordered_map>
#include <vector>

#include "raylift/localization/match_source.h"

namespace raylift {

// Keeps the first matches that it is asked for, up to so much memory. Thread safe. Its source must
// not be told of more references.
class CachedMatches final : public MatchSource {
 public:
  explicit CachedMatches(std::shared_ptr<MatchSource> source,
                         size_t most_bytes = size_t{256} << 20);

  QueryMatches Match(const Query& query) const override;
  QueryMatches MatchPhotograph(const Query& query, const Image& photograph) const override;
  QueryMatches MatchFeatures(const Query& query, const Features& features) const override;
  std::vector<std::string> Warnings() const override;

 private:
  std::shared_ptr<MatchSource> source_;
  size_t most_bytes_;
  mutable std::mutex mutex_;
  mutable size_t bytes_ = 0;
  mutable std::unordered_map<std::string, QueryMatches> of_query_;
};

}  // namespace raylift
