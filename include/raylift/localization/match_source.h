// Where the 2D-2D matches of a query come from: hloc's files (hloc_matches.h), the built-in front
// end (front_end.h), or anything else that implements this interface.

#pragma once

#include <string>
#include <vector>

#include "raylift/scene/features.h"
#include "raylift/scene/image.h"
#include "raylift/scene/photographs.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

struct QueryMatches {
  std::vector<PosedImage> references;  // the retrieved ones, best first
  std::vector<Match2D2D> matches;      // `reference` counts in `references`
};

class MatchSource {
 public:
  virtual ~MatchSource() = default;

  // Of a query that the source knows by its name. Thread safe.
  virtual QueryMatches Match(const Query& query) const = 0;

  // Of a photograph in memory, or of features that were extracted from it. Thread safe. InputError
  // where the source has nothing to match them with, or cannot: only the front end can.
  virtual QueryMatches MatchPhotograph(const Query& query, const Image& photograph) const;
  virtual QueryMatches MatchFeatures(const Query& query, const Features& features) const;

  // From now on this query, localized, is also a reference. Not while matches are made. Only for
  // sources that were opened for it.
  virtual void Join(const PosedImage& localized_query);

  // What the user should be told, collected so far.
  virtual std::vector<std::string> Warnings() const = 0;
};

}  // namespace raylift
