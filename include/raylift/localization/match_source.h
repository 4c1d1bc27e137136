// Where the 2D-2D matches of a query come from: from hloc's files, or from the built-in front end.

#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/features/dot_product_search.h"
#include "raylift/geometry/pose_convention.h"
#include "raylift/io/query_list.h"
#include "raylift/localization/covisibility.h"
#include "raylift/scene/pose_problem.h"
#include "raylift/scene/posed_image.h"
#include "raylift/scene/thinning.h"

namespace raylift {

struct QueryMatches {
  std::vector<PosedImage> references;  // the retrieved ones, best first
  std::vector<Match2D2D> matches;      // `reference` counts in `references`
};

class MatchSource {
 public:
  virtual ~MatchSource() = default;

  // The matches of a query with its retrieved references; both may be empty. Thread safe.
  // InputError where a file is malformed.
  virtual QueryMatches Match(const Query& query) const = 0;

  // From now on this query, localized, is also a reference. Not while Match() runs. Only for
  // sources that were opened for it.
  virtual void Join(const PosedImage& localized_query);

  // What the user should be told, collected so far.
  virtual std::vector<std::string> Warnings() const = 0;
};

// The references of a scene: those in use, and the names that exist but are thinned out, which a
// retrieval list may name without being wrong.
struct ReferenceSet {
  std::filesystem::path model;  // for messages
  std::vector<PosedImage> images;
  std::vector<std::string> thinned_out;
};

// The images of a COLMAP model whose poses may be in another convention, thinned out. Cameras of
// equal parameters count as one. InputError where no image is left, or where thinning per camera
// drops none as each image has a camera of its own.
struct LoadedReferences {
  ReferenceSet references;
  Covisibility covisibility;
  std::vector<std::string> warnings;
};
LoadedReferences LoadReferences(const std::filesystem::path& model, const Thinning& thinning,
                                PoseConvention poses = PoseConvention::kCamFromWorld);
// Every `every`-th from the first on.
LoadedReferences LoadReferences(const std::filesystem::path& model, int every,
                                PoseConvention poses = PoseConvention::kCamFromWorld);

struct HlocFiles {
  std::filesystem::path features;
  std::filesystem::path matches;
  std::filesystem::path pairs;
};

// Queries that may become references by Join(), and how many of them a query may have among its
// references; none may by default.
struct JoiningQueries {
  std::span<const Query> queries = {};
  int max_joined = 0;
};

// Reads hloc's files. The pairs file ranks the references of each query; `top_k` of those in use
// are taken. InputError where it names a reference that the model does not hold. References that
// are joining queries stand in the files like others, and are passed over until they join.
std::unique_ptr<MatchSource> OpenHlocMatches(const HlocFiles& files, const ReferenceSet& references,
                                             int top_k, const JoiningQueries& joining = {});

struct FrontEndOptions {
  std::filesystem::path reference_images;
  std::filesystem::path query_images;
  // Features and retrieval are kept here in hloc's layout; features are used again where nothing
  // changed.
  std::filesystem::path cache;
  int top_k = 10;
  int max_features = 4096;
  double max_ratio = 0.8;
  uint64_t seed = 0;
  int threads = 0;
  bool show_progress = true;
  // The references of each query where they were not to be retrieved by VLAD.
  std::optional<RetrievedLists> retrieved = std::nullopt;
  // With a number, queries may become references, up to so many of the top_k; Match() itself
  // then uses `threads`.
  std::optional<int> max_joined = std::nullopt;
};

// Extracts RootSIFT features of all images and retrieves references by VLAD; Match() matches.
// InputError where an image is missing or does not have its camera's size.
std::unique_ptr<MatchSource> MakeFrontEndMatches(const FrontEndOptions& options,
                                                 const ReferenceSet& references,
                                                 const std::vector<Query>& queries);

}  // namespace raylift
