// The matches of a scene's queries by whatever there is: hloc's files, COLMAP's database, a folder
// of pairs, or the built-in front end with any kind of retrieval.

#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <span>

#include "raylift/localization/front_end.h"
#include "raylift/localization/hloc_matches.h"
#include "raylift/localization/match_source.h"
#include "raylift/localization/retrieval.h"
#include "raylift/localization/scene.h"

namespace raylift {

struct MatchingOptions {
  // None: the front end. Where `matches` stand alone, they are all that is needed.
  std::optional<HlocFiles> hloc = std::nullopt;
  MatchReading reading = {};  // of matches in files
  int top_k = 10;             // references per query
  // With a number, localized queries may join the references, up to so many among the top_k.
  std::optional<int> max_joined = std::nullopt;

  // Of the front end. Its top_k, max_joined and reference images are set from here and the scene.
  FrontEndOptions front_end = {};
  // None: by VLAD. top_k is set from here, and from the scene the covisibility, and the mesh of
  // `overlap` unless one is given.
  std::optional<RetrievalOptions> retrieval = std::nullopt;
};

// Whether these matches need no features and no pairs: COLMAP's database, a folder of pairs.
bool StandAlone(const std::filesystem::path& matches);

// Warnings of the retrieval come with those of the source.
std::unique_ptr<MatchSource> OpenMatches(const Scene& scene, std::span<const Query> queries,
                                         const MatchingOptions& options);

// Makes beforehand what OpenMatches() would: the features of a shard's images and, after the last
// of them, the vectors for retrieval; nothing where the matches are in files.
FeatureCount PrepareMatches(const Scene& scene, std::span<const Query> queries,
                            const MatchingOptions& options, const Shard& shard);

}  // namespace raylift
