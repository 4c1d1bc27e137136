#include "localization/cached_matches.h"

#include <utility>

namespace raylift {

CachedMatches::CachedMatches(std::shared_ptr<MatchSource> source, size_t most_bytes)
    : source_(std::move(source)), most_bytes_(most_bytes) {}

QueryMatches CachedMatches::Match(const Query& query) const {
  {
    const std::lock_guard lock(mutex_);
    if (const auto known = of_query_.find(query.name); known != of_query_.end()) {
      return known->second;
    }
  }
  QueryMatches matches = source_->Match(query);
  const size_t bytes =
      matches.matches.size() * sizeof(Match2D2D) + matches.references.size() * sizeof(PosedImage);
  const std::lock_guard lock(mutex_);
  if (bytes_ + bytes <= most_bytes_ && of_query_.emplace(query.name, matches).second) {
    bytes_ += bytes;
  }
  return matches;
}

QueryMatches CachedMatches::MatchPhotograph(const Query& query, const Image& photograph) const {
  return source_->MatchPhotograph(query, photograph);
}

QueryMatches CachedMatches::MatchFeatures(const Query& query, const Features& features) const {
  return source_->MatchFeatures(query, features);
}

std::vector<std::string> CachedMatches::Warnings() const { return source_->Warnings(); }

}  // namespace raylift
