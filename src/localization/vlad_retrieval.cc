#include "localization/vlad_retrieval.h"

#include <set>
#include <vector>

#include "localization/feature_cache.h"
#include "localization/retrieved_lists.h"

#include "raylift/base/parallel.h"
#include "raylift/features/vlad.h"
#include "raylift/localization/retrieval.h"

namespace raylift {
namespace {

// The images' vectors, a column each.
Eigen::MatrixXf VladOf(std::span<const std::string> images,
                       const std::map<std::string, Features>& features,
                       const Vocabulary& vocabulary, int threads) {
  std::vector<Eigen::VectorXf> columns(images.size());
  ParallelFor(images.size(), threads,
              [&](size_t i) { columns[i] = ComputeVlad(features.at(images[i]), vocabulary); });
  Eigen::MatrixXf stacked(images.empty() ? 0 : columns[0].size(),
                          static_cast<Eigen::Index>(images.size()));
  for (size_t i = 0; i < images.size(); ++i) {
    stacked.col(static_cast<Eigen::Index>(i)) = columns[i];
  }
  return stacked;
}

}  // namespace

RetrievedLists RetrieveByVlad(std::span<const std::string> queries,
                              std::span<const std::string> references,
                              const std::map<std::string, Features>& features, int top_k,
                              uint64_t seed, int threads) {
  std::vector<Features> reference_features;
  for (const std::string& name : references) reference_features.push_back(features.at(name));
  const Vocabulary vocabulary =
      TrainVocabulary(reference_features, {.seed = seed, .threads = threads});
  RetrievedLists lists =
      RetrieveTopK(VladOf(queries, features, vocabulary, threads),
                   VladOf(references, features, vocabulary, threads), top_k + 1, threads);
  DropOwn(queries, references, top_k, &lists);
  return lists;
}

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
  return RetrieveByVlad(query_names, reference_names, features, options.top_k, options.seed,
                        options.threads);
}

}  // namespace raylift
