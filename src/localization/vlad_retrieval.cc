// Retrieval by VLAD from photographs on disk.

#include <set>
#include <string>
#include <utility>
#include <vector>

#include "localization/feature_cache.h"
#include "localization/vlad_cache.h"
#include "localization/vlad_index.h"

#include "raylift/localization/retrieval.h"

namespace raylift {

RetrievedLists RetrieveByVlad(std::span<const Query> queries,
                              std::span<const PosedImage> references,
                              const FrontEndOptions& options) {
  std::vector<ImageFile> files;
  std::vector<std::string> query_names, reference_names;
  for (const PosedImage& image : references) {
    reference_names.push_back(image.name);
    files.push_back({image.name, options.reference_images / image.name});
  }
  const std::set<std::string> known(reference_names.begin(), reference_names.end());
  for (const Query& query : queries) {
    query_names.push_back(query.name);
    if (!known.contains(query.name)) {
      files.push_back({query.name, options.query_images / query.name});
    }
  }
  const auto features = ExtractOrReadFeatures(files, {.folder = options.cache,
                                                      .max_features = options.max_features,
                                                      .threads = options.threads,
                                                      .show_progress = options.show_progress});
  VladVectors vectors = ComputeOrReadVladVectors(reference_names, *features, options.cache,
                                                 options.seed, options.threads);
  const VladIndex index(std::move(reference_names), std::move(vectors));
  return RetrieveByVlad(index, query_names, *features, options.top_k, options.threads);
}

}  // namespace raylift
