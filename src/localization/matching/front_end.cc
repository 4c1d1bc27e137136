// Matches made here: RootSIFT, retrieval by VLAD unless it is given, mutual nearest neighbors.

#include <algorithm>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <span>
#include <string>
#include <utility>

#include "io/map/packed_map.h"
#include "localization/fields.h"
#include "localization/matching/feature_store.h"
#include "localization/matching/file_matches.h"
#include "localization/matching/pixel_matches.h"
#include "localization/retrieval/retrieval.h"
#include "localization/retrieval/vlad_index.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"
#include "raylift/features/local_features.h"
#include "raylift/io/hloc_files.h"
#include "raylift/io/image_file.h"
#include "raylift/jobs/shard.h"
#include "raylift/localization/match_source.h"
#include "raylift/localization/scene.h"
#include "raylift/scene/keypoints.h"

namespace raylift {

std::vector<Field> FieldsOf(FrontEndOptions& options) {
  return {
      {"max_features", options.max_features, "RootSIFT features per image, the strongest",
       kAtLeastOne},
      {"max_ratio",
       options.max_ratio,
       "Ratio test of RootSIFT matches",
       {.says = "must be above 0 and at most 1", .least = 0, .most = 1, .without_least = true}}};
}

namespace {

// Returns all images whose features are not known, each once.
std::vector<ImageFile> ImagesOf(const FrontEndOptions& options, const ReferenceSet& references,
                                std::span<const Query> queries) {
  std::vector<ImageFile> files;
  const auto want = [&](const std::string& name, const std::filesystem::path& folder) {
    if (!options.features.contains(name)) files.push_back({name, folder / name});
  };
  std::set<std::string> reference_names;
  for (const PosedImage& image : references.images) {
    want(image.name, options.reference_images);
    reference_names.insert(image.name);
  }
  for (const Query& query : queries) {
    if (reference_names.contains(query.name)) {
      if (options.among_references) continue;
      throw InputError(fmt::format("the query \"{}\" is also a reference of the model {}",
                                   query.name, references.model.string()));
    }
    want(query.name, options.query_images);
  }
  return files;
}

using MapPointer = std::shared_ptr<const PackedMap>;

// Returns the features that stand in a packed map for photographs; null without a map.
std::shared_ptr<const FeatureFile> FeaturesIn(const MapPointer& map,
                                              const FrontEndOptions& options) {
  if (map == nullptr) return nullptr;
  const std::string& features = map->header().features;
  if (!options.extractor && features != kRootSift) {
    throw InputError(map->file(),
                     fmt::format("its features are of {}, those of queries are RootSIFT here: "
                                 "matches must be given",
                                 features));
  }
  return std::make_shared<const FeatureFile>(map);
}

FeatureCacheOptions CacheOf(const FrontEndOptions& options, const MapPointer& map = nullptr) {
  return {.folder = options.cache,
          .max_features = options.max_features,
          .extractor = options.extractor,
          .extractor_name = options.extractor_name,
          .threads = options.threads,
          .show_progress = options.show_progress,
          .packed = FeaturesIn(map, options)};
}

// Returns the vectors of these references in their packed map; nullopt where it has none.
std::optional<VladVectors> VectorsIn(const PackedMap& map,
                                     std::span<const std::string> references) {
  auto retrieval = map.ReadRetrieval();
  if (!retrieval) return std::nullopt;
  VladVectors vectors{{std::move(retrieval->words)}, {}};
  vectors.of_references.resize(retrieval->vectors.rows(),
                               static_cast<Eigen::Index>(references.size()));
  for (size_t i = 0; i < references.size(); ++i) {
    vectors.of_references.col(static_cast<Eigen::Index>(i)) =
        retrieval->vectors.col(static_cast<Eigen::Index>(map.IndexOf(references[i])));
  }
  return vectors;
}

// Returns a column for each photograph.
Eigen::MatrixXf Describe(std::span<const ImageFile> photographs, const FrontEndOptions& options) {
  std::vector<Eigen::VectorXf> vectors(photographs.size());
  ParallelFor(photographs.size(), options.threads, [&](size_t i) {
    vectors[i] = options.descriptor(ReadImage(photographs[i].path, ImageChannels::kRgb));
  });
  Eigen::MatrixXf columns(vectors.empty() ? 0 : vectors.front().size(), std::ssize(vectors));
  for (size_t i = 0; i < vectors.size(); ++i) {
    if (vectors[i].size() != columns.rows()) {
      throw InputError(photographs[i].path,
                       fmt::format("expected a global descriptor of {} numbers, found {}",
                                   columns.rows(), vectors[i].size()));
    }
    columns.col(static_cast<Eigen::Index>(i)) = vectors[i];
  }
  return columns;
}

VladIndex IndexOf(const MapPointer& map, const std::vector<PosedImage>& references,
                  const FeatureStore& features, const FrontEndOptions& options) {
  std::vector<std::string> names = NamesOf(references);
  if (options.descriptor) {
    std::vector<ImageFile> files;
    for (const std::string& name : names) files.push_back({name, options.reference_images / name});
    return {std::move(names), {.vocabulary = {}, .of_references = Describe(files, options)}};
  }
  auto vectors = map ? VectorsIn(*map, names) : std::nullopt;
  if (!vectors) {
    vectors =
        ComputeOrReadVladVectors(names, features, options.cache, options.seed, options.threads);
  }
  return {std::move(names), *std::move(vectors)};
}

// The references' vectors, by which the references similar to a query are retrieved.
class ReferenceVectors {
 public:
  // `options` and `references` must outlive it; `map` is null where they are of no packed map.
  ReferenceVectors(const FrontEndOptions& options, MapPointer map,
                   const std::vector<PosedImage>& references,
                   std::shared_ptr<const FeatureStore> features)
      : options_(options),
        map_(std::move(map)),
        references_(references),
        features_(std::move(features)) {}

  // Makes the index when it is first wanted: other ways to retrieve need none.
  const std::shared_ptr<const VladIndex>& Index() const {
    std::call_once(index_is_made_, [this] {
      index_ = std::make_shared<const VladIndex>(
          ReadOpened([this] { return IndexOf(map_, references_, *features_, options_); }));
    });
    return index_;
  }

  // `photograph` is null where only the features are there.
  Eigen::VectorXf VectorOf(const std::string& query, const Image* photograph,
                           const Features& features) const {
    if (!options_.descriptor) return Index()->VectorOf(features);
    if (photograph == nullptr) {
      throw InputError("the features of " + query +
                       " are in memory: the global descriptor takes photographs");
    }
    return options_.descriptor(*photograph);
  }

  RetrievedLists BestOf(std::span<const ImageFile> queries) const {
    std::vector<std::string> names;
    for (const ImageFile& query : queries) names.push_back(query.name);
    if (!options_.descriptor) {
      return RetrieveByVlad(*Index(), names, *features_, options_.top_k, options_.threads);
    }
    return Index()->Best(names, ReadOpened([&] { return Describe(queries, options_); }),
                         options_.top_k, options_.threads);
  }

 private:
  const FrontEndOptions& options_;
  const MapPointer map_;
  const std::vector<PosedImage>& references_;
  const std::shared_ptr<const FeatureStore> features_;
  mutable std::once_flag index_is_made_;
  mutable std::shared_ptr<const VladIndex> index_;
};

class FrontEndMatches final : public MatchSource {
 public:
  FrontEndMatches(const FrontEndOptions& options, const ReferenceSet& references,
                  const std::vector<Query>& queries)
      : options_(options), references_(references.images) {
    for (size_t i = 0; i < references_.size(); ++i) {
      index_of_reference_.emplace(references_[i].name, static_cast<int>(i));
    }
    features_ =
        ExtractOrReadFeatures(ImagesOf(options, references, queries),
                              CacheOf(options, references.map), std::move(options_.features));
    for (const Query& query : queries) {
      RequireSizeOf(query.camera, query.name, features_->SizeOf(query.name),
                    options_.query_images / query.name);
    }
    vectors_ =
        std::make_unique<const ReferenceVectors>(options_, references.map, references_, features_);
    Retrieve(queries);
    if (options.max_joined) joined_ = std::make_unique<JoinedRetrieval>(vectors_->Index());
  }

  QueryMatches Match(const Query& query) const override {
    const auto retrieved = retrieved_.find(query.name);
    if (retrieved == retrieved_.end()) {
      throw InputError(fmt::format(
          "the query \"{}\" is not among those that the features were extracted of", query.name));
    }
    return MatchRetrieved(query, nullptr, *features_->Get(query.name), retrieved->second);
  }

  QueryMatches MatchWithin(const SearchRegions& regions, const Query& query,
                           std::span<const PosedImage> references) const override {
    QueryMatches result;
    result.references.assign(references.begin(), references.end());
    for (const PosedImage& reference : references) {
      CheckSizeOfReference(index_of_reference_.at(reference.name));
    }
    if (options_.matcher) {
      MatchPixels(query, nullptr, &result);
      return result;
    }
    const auto of_query = features_->Get(query.name);
    double area = 0;
    for (size_t rank = 0; rank < references.size(); ++rank) {
      const auto of_reference = features_->Get(references[rank].name);
      const auto within = regions(references[rank], of_reference->features.keypoints_px);
      const std::vector<FeatureMatch> matches = raylift::MatchWithin(
          within, of_query->features, of_reference->features, {.max_ratio = options_.max_ratio});
      for (const FeatureMatch& match : matches) {
        area += within[static_cast<size_t>(match.reference_index)]->AreaPx2();
      }
      AddMatches(matches, *of_query, *of_reference, static_cast<int>(rank), result);
    }
    if (!result.matches.empty()) {
      result.search_area_px2 = area / static_cast<double>(result.matches.size());
    }
    return result;
  }

  QueryMatches MatchPhotograph(const Query& query, const Image& photograph) const override {
    return MatchInMemory(query, &photograph, ExtractAsStored(photograph, CacheOf(options_)));
  }

  QueryMatches MatchFeatures(const Query& query, const Features& features) const override {
    if (options_.matcher) {
      throw InputError("the features of " + query.name +
                       " are in memory: the matcher takes photographs");
    }
    return MatchInMemory(query, nullptr, features);
  }

  bool MatchesReferences() const override { return true; }

  // References are retrieved by their vectors, in whatever way the queries' are.
  QueryMatches MatchReference(const Query& reference) const override {
    return MatchRetrieved(
        reference, nullptr, *features_->Get(reference.name),
        MostAlike(reference.name, vectors_->Index()->VectorOfReference(reference.name)));
  }

  void Join(const PosedImage& localized_query) override {
    RAYLIFT_CHECK(joined_ != nullptr);
    joined_->Join(localized_query, features_->Get(localized_query.name)->features);
  }

  std::vector<std::string> Warnings() const override {
    std::vector<std::string> all = options_.retrieval_warnings;
    for (std::string& warning : warnings_.All()) all.push_back(std::move(warning));
    return all;
  }

 private:
  QueryMatches MatchInMemory(const Query& query, const Image* photograph,
                             const Features& features) const {
    if (features.image_width_px > 0) {
      RequireSizeOf(query.camera, query.name, {features.image_width_px, features.image_height_px},
                    query.name);
    }
    return MatchRetrieved(
        query, photograph, {features, CanonicalKeypoints(features.keypoints_px)},
        MostAlike(query.name, vectors_->VectorOf(query.name, photograph, features)));
  }

  std::vector<int> MostAlike(const std::string& query, const Eigen::MatrixXf& vector) const {
    const std::string name[] = {query};
    const RetrievedLists best = vectors_->Index()->Best(name, vector, options_.top_k, 1);
    std::vector<int> retrieved;
    for (const RetrievedReference& r : best.front()) {
      CheckSizeOfReference(r.reference_index);
      retrieved.push_back(r.reference_index);
    }
    return retrieved;
  }

  // `photograph` is null where it is in its file.
  QueryMatches MatchRetrieved(const Query& query, const Image* photograph,
                              const ImageFeatures& of_query,
                              const std::vector<int>& retrieved) const {
    QueryMatches result;
    for (const int index : retrieved) {
      result.references.push_back(references_[static_cast<size_t>(index)]);
    }
    if (joined_) {
      result.references = joined_->Merge(query.name, of_query.features, result.references,
                                         static_cast<size_t>(options_.top_k),
                                         static_cast<size_t>(*options_.max_joined));
    }
    if (options_.matcher) {
      MatchPixels(query, photograph, &result);
    } else {
      MatchFeaturesOf(of_query, &result);
    }
    return result;
  }

  void MatchPixels(const Query& query, const Image* photograph, QueryMatches* result) const {
    std::vector<Photograph> references;
    for (const PosedImage& image : result->references) references.push_back(InFile(image.name));
    Photograph asked = InFile(query.name);
    asked.pixels = photograph;
    const std::vector<PixelMatches> found = options_.matcher(asked, references);
    RAYLIFT_CHECK_EQ(found.size(), references.size());
    QueryPixels pixels(query, options_.reading);
    for (size_t rank = 0; rank < found.size(); ++rank) {
      const PosedImage& image = result->references[rank];
      const InsideMatches inside =
          pixels.Inside(found[rank], image.name, image.camera, "the matcher");
      if (inside.outside > 0) {
        warnings_.Add("the matcher: matches outside of their images are left out");
      }
      pixels.Add(inside.matches, static_cast<int>(rank), result);
    }
  }

  // Queries that have joined the references stay in their folder.
  Photograph InFile(const std::string& name) const {
    const bool is_reference = index_of_reference_.contains(name);
    return {name, (is_reference ? options_.reference_images : options_.query_images) / name};
  }

  void MatchFeaturesOf(const ImageFeatures& of_query, QueryMatches* result) const {
    std::vector<std::shared_ptr<const ImageFeatures>> of_references(result->references.size());
    std::vector<std::vector<FeatureMatch>> matches(result->references.size());
    // Where queries follow each other, the references of one are matched side by side.
    ParallelFor(matches.size(), joined_ ? options_.threads : 1, [&](size_t i) {
      of_references[i] = features_->Get(result->references[i].name);
      matches[i] = MatchMutualNearest(of_query.features, of_references[i]->features,
                                      {.max_ratio = options_.max_ratio});
    });
    for (size_t rank = 0; rank < matches.size(); ++rank) {
      AddMatches(matches[rank], of_query, *of_references[rank], static_cast<int>(rank), *result);
    }
  }

  static void AddMatches(const std::vector<FeatureMatch>& matches, const ImageFeatures& of_query,
                         const ImageFeatures& of_reference, int reference, QueryMatches& result) {
    for (const FeatureMatch& match : matches) {
      const auto query_index = static_cast<size_t>(match.query_index);
      const auto reference_index = static_cast<size_t>(match.reference_index);
      result.matches.push_back({.reference = reference,
                                .query_px = of_query.features.keypoints_px[query_index],
                                .reference_px = of_reference.features.keypoints_px[reference_index],
                                .query_keypoint = of_query.keypoints[query_index],
                                .reference_keypoint = of_reference.keypoints[reference_index]});
    }
  }

  void CheckSizeOfReference(int index) const {
    const PosedImage& image = references_[static_cast<size_t>(index)];
    ReadOpened([&] {
      RequireSizeOf(image.camera, image.name, features_->SizeOf(image.name),
                    options_.reference_images / image.name);
    });
  }

  void Retrieve(const std::vector<Query>& queries) {
    if (queries.empty()) return;
    const std::vector<std::string> query_names = NamesOf(queries);
    const auto by_vectors = [&] {
      std::vector<ImageFile> files;
      for (const std::string& name : query_names) files.push_back({name, InFile(name).file});
      return vectors_->BestOf(files);
    };
    const RetrievedLists ranks = options_.retrieved ? *options_.retrieved : by_vectors();
    RAYLIFT_CHECK_EQ(ranks.size(), queries.size());
    std::set<int> all_retrieved;
    std::vector<std::pair<std::string, std::string>> pairs;
    for (size_t i = 0; i < queries.size(); ++i) {
      std::vector<int>& indices = retrieved_[query_names[i]];
      for (const RetrievedReference& r : ranks[i]) {
        indices.push_back(r.reference_index);
        all_retrieved.insert(r.reference_index);
        pairs.emplace_back(query_names[i],
                           references_[static_cast<size_t>(r.reference_index)].name);
      }
    }
    for (const int index : all_retrieved) CheckSizeOfReference(index);
    if (!options_.cache.empty()) WritePairs(options_.cache / "pairs.txt", pairs);
  }

  FrontEndOptions options_;
  std::vector<PosedImage> references_;
  std::map<std::string, int> index_of_reference_;
  WarningSet warnings_;
  std::shared_ptr<const FeatureStore> features_;
  std::unique_ptr<const ReferenceVectors> vectors_;
  std::map<std::string, std::vector<int>> retrieved_;  // indices into references_, best first
  std::unique_ptr<JoinedRetrieval> joined_;            // null: no query becomes a reference
};

}  // namespace

RetrievedLists RetrieveByVlad(std::span<const Query> queries, const ReferenceSet& references,
                              const FrontEndOptions& options) {
  const auto features = ExtractOrReadFeatures(ImagesOf(options, references, queries),
                                              CacheOf(options, references.map));
  return RetrieveByVlad(IndexOf(references.map, references.images, *features, options),
                        NamesOf(queries), *features, options.top_k, options.threads);
}

FeatureCount PrepareFrontEnd(const FrontEndOptions& options, const ReferenceSet& references,
                             const std::vector<Query>& queries, const Shard& shard, bool for_vlad) {
  const FeatureCacheOptions cache = CacheOf(options, references.map);
  const FeatureCount count = PrepareFeatures(ImagesOf(options, references, queries), shard, cache);
  if (count.missing > 0 || !for_vlad) return count;
  const auto features = ExtractOrReadFeatures(ImagesOf(options, references, {}), cache);
  IndexOf(references.map, references.images, *features, options);  // keeps its vectors
  return count;
}

std::unique_ptr<MatchSource> MakeFrontEndMatches(const FrontEndOptions& options,
                                                 const ReferenceSet& references,
                                                 const std::vector<Query>& queries) {
  return std::make_unique<FrontEndMatches>(options, references, queries);
}

}  // namespace raylift
