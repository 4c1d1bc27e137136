// The built-in front end: RootSIFT features, retrieval by VLAD unless it is given, and mutual
// nearest neighbors. All that other programs would bring, made from the photographs alone.

#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "raylift/jobs/shard.h"
#include "raylift/localization/match_source.h"
#include "raylift/localization/references.h"
#include "raylift/scene/features.h"
#include "raylift/scene/image.h"

namespace raylift {

struct FrontEndOptions {
  std::filesystem::path reference_images = {};
  std::filesystem::path query_images = {};
  // Features and retrieval are kept here in hloc's layout, and used again where nothing changed;
  // features are then read when they are matched. Empty: nothing is kept, all are in memory.
  std::filesystem::path cache = {};
  // By image name: features that are known already. The photographs of these are not read.
  std::map<std::string, Features> features = {};
  int top_k = 10;
  int max_features = 4096;
  double max_ratio = 0.8;
  uint64_t seed = 0;
  int threads = 0;
  bool show_progress = false;
  // The references of each query where they were not to be retrieved by VLAD.
  std::optional<RetrievedLists> retrieved = std::nullopt;
  // Queries may be references, which are matched with the others.
  bool among_references = false;
  // With a number, queries may become references, up to so many of the top_k; Match() itself
  // then uses `threads`.
  std::optional<int> max_joined = std::nullopt;
};

// Extracts the features of all images and retrieves references; Match() matches. Queries may also
// come one by one from memory, by MatchPhotograph() and MatchFeatures(): these take references by
// VLAD. InputError where an image is missing or does not have its camera's size.
std::unique_ptr<MatchSource> MakeFrontEndMatches(const FrontEndOptions& options,
                                                 const ReferenceSet& references,
                                                 const std::vector<Query>& queries);

// Of the images of a scene and its queries.
struct FeatureCount {
  size_t images = 0;
  size_t extracted = 0;  // now
  size_t missing = 0;    // not in the cache yet, as other shards have not ended
};

// Extracts the features of this shard's images to options.cache, where MakeFrontEndMatches() finds
// them. What was there already stays. The shard after which none is missing also learns what
// references are retrieved by, `for_vlad`.
FeatureCount PrepareFrontEnd(const FrontEndOptions& options, const ReferenceSet& references,
                             const std::vector<Query>& queries, const Shard& shard, bool for_vlad);

// The features of a photograph (gray or RGB) as MatchPhotograph() extracts them, rounded as a cache
// would store them: a query gives the same bytes from memory as from disk.
Features ExtractFrontEndFeatures(const Image& photograph, int max_features);

}  // namespace raylift
