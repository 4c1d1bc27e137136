#include "raylift/localization/match_source.h"

#include <stdexcept>

#include "raylift/base/error.h"

namespace raylift {

QueryMatches MatchSource::MatchPhotograph(const Query& query, const Image&) const {
  throw InputError("the photograph " + query.name +
                   " is in memory: only the built-in front end can match it");
}

QueryMatches MatchSource::MatchFeatures(const Query& query, const Features&) const {
  throw InputError("the features of " + query.name +
                   " are in memory: only the built-in front end can match them");
}

void MatchSource::Join(const PosedImage& localized_query) {
  throw std::logic_error("this source of matches was not opened for " + localized_query.name);
}

}  // namespace raylift
