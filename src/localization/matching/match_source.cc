#include "raylift/localization/match_source.h"

#include <stdexcept>
#include <utility>

#include "io/colmap/colmap_database.h"
#include "localization/matching/file_matches.h"
#include "localization/retrieval/retrieval.h"

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/localization/scene.h"

namespace raylift {

QueryMatches MatchSource::MatchPhotograph(const Query& query, const Image&) const {
  throw InputError("the photograph " + query.name +
                   " is in memory: only the built-in front end can match it");
}

QueryMatches MatchSource::MatchFeatures(const Query& query, const Features&) const {
  throw InputError("the features of " + query.name +
                   " are in memory: only the built-in front end can match them");
}

QueryMatches MatchSource::MatchWithin(const SearchRegions&, const Query& query,
                                      std::span<const PosedImage>) const {
  return Match(query);
}

QueryMatches MatchSource::MatchReference(const Query& reference) const {
  throw std::logic_error("this source does not match the reference " + reference.name);
}

void MatchSource::Join(const PosedImage& localized_query) {
  throw std::logic_error("this source of matches was not opened for " + localized_query.name);
}

namespace {

FrontEndOptions FrontEndOf(const Scene& scene, const MatchingOptions& options) {
  FrontEndOptions front_end = options.front_end;
  front_end.reference_images = scene.images;
  front_end.top_k = options.top_k;
  front_end.max_joined = options.max_joined;
  return front_end;
}

}  // namespace

bool StandAlone(const std::filesystem::path& matches) {
  return IsColmapDatabase(matches) || IsFolder(matches);
}

std::unique_ptr<MatchSource> OpenMatches(const Scene& scene, std::span<const Query> queries,
                                         const MatchingOptions& options) {
  if (options.hloc) {
    JoiningQueries joining;
    if (options.max_joined) joining = {queries, *options.max_joined};
    if (IsColmapDatabase(options.hloc->matches)) {
      return OpenDatabaseMatches(options.hloc->matches, options.hloc->pairs, scene.references,
                                 options.top_k, joining);
    }
    if (std::filesystem::is_directory(options.hloc->matches)) {
      return OpenPairMatches(options.hloc->matches, options.hloc->pairs, scene.references,
                             options.top_k, joining, options.reading);
    }
    return OpenHlocMatches(*options.hloc, scene.references, options.top_k, joining,
                           options.reading);
  }
  FrontEndOptions front_end = FrontEndOf(scene, options);
  if (options.retrieval && options.retrieval->method != RetrievalMethod::kVlad) {
    RetrievalOptions how = *options.retrieval;
    how.top_k = options.top_k;
    if (how.mesh == nullptr) how.mesh = scene.Surface();
    if (how.method == RetrievalMethod::kOverlap && how.mesh == nullptr) {
      throw InputError(
          "references are retrieved by overlap, but the scene has no mesh, point cloud or splats");
    }
    if (how.covisibility == nullptr) how.covisibility = scene.covisibility;
    Retrieval retrieval = RetrieveReferences(queries, scene.references.images, how);
    front_end.retrieved = std::move(retrieval.lists);
    front_end.retrieval_warnings = std::move(retrieval.warnings);
  }
  return MakeFrontEndMatches(front_end, scene.references, {queries.begin(), queries.end()});
}

FeatureCount PrepareMatches(const Scene& scene, std::span<const Query> queries,
                            const MatchingOptions& options, const Shard& shard) {
  if (options.hloc) return {};
  const bool for_vlad = !options.retrieval || options.retrieval->method == RetrievalMethod::kVlad;
  return PrepareFrontEnd(FrontEndOf(scene, options), scene.references,
                         {queries.begin(), queries.end()}, shard, for_vlad);
}

}  // namespace raylift
