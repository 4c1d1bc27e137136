#include "localization/retrieval/vlad_index.h"

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "base/hash.h"
#include "jobs/manifest_file.h"
#include "localization/retrieval/retrieval.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"
#include "raylift/io/hloc_files.h"

namespace raylift {

namespace {

Eigen::MatrixXf VectorsOf(std::span<const std::string> images, const FeatureStore& features,
                          const Vocabulary& vocabulary, int threads) {
  Eigen::MatrixXf vectors(vocabulary.words.size(), static_cast<Eigen::Index>(images.size()));
  ParallelFor(images.size(), threads, [&](size_t i) {
    vectors.col(static_cast<Eigen::Index>(i)) =
        ComputeVlad(features.Get(images[i])->features, vocabulary);
  });
  return vectors;
}

}  // namespace

VladVectors ComputeVladVectors(std::span<const std::string> references,
                               const FeatureStore& features, uint64_t seed, int threads) {
  VladVectors vectors;
  vectors.vocabulary = TrainVocabulary(
      references.size(),
      [&](size_t i, const auto& look) { look(features.Get(references[i])->features); },
      {.seed = seed, .threads = threads});
  vectors.of_references = VectorsOf(references, features, vectors.vocabulary, threads);
  return vectors;
}

VladIndex::VladIndex(std::vector<std::string> references, VladVectors vectors)
    : references_(std::move(references)), vectors_(std::move(vectors)) {
  RAYLIFT_CHECK_EQ(static_cast<size_t>(vectors_.of_references.cols()), references_.size());
  for (const std::string& name : references_) {
    index_of_name_.emplace(name, static_cast<Eigen::Index>(index_of_name_.size()));
  }
}

Eigen::VectorXf VladIndex::VectorOf(const Features& features) const {
  return ComputeVlad(features, vectors_.vocabulary);
}

Eigen::VectorXf VladIndex::VectorOfReference(const std::string& name) const {
  return vectors_.of_references.col(index_of_name_.at(name));
}

RetrievedLists VladIndex::Best(std::span<const std::string> queries, const Eigen::MatrixXf& vectors,
                               int top_k, int threads) const {
  RetrievedLists lists = RetrieveTopK(vectors, vectors_.of_references, top_k + 1, threads);
  DropOwn(queries, references_, top_k, &lists);
  return lists;
}

RetrievedLists RetrieveByVlad(const VladIndex& index, std::span<const std::string> queries,
                              const FeatureStore& features, int top_k, int threads) {
  return index.Best(queries, VectorsOf(queries, features, index.vocabulary(), threads), top_k,
                    threads);
}

namespace {

using std::filesystem::path;

// Changes whenever the vectors of the same features do.
constexpr int kVladVersion = 1;

// Returns what the vectors depend on; nullopt where that is not known.
std::optional<std::string> KeyOf(std::span<const std::string> references,
                                 const FeatureStore& features, uint64_t seed) {
  std::string key = fmt::format("vlad version {} seed {}\n", kVladVersion, seed);
  for (const std::string& name : references) {
    const std::string& stamp = features.StampOf(name);
    if (stamp.empty()) return std::nullopt;
    key += stamp + "\n";
  }
  return key;
}

// Returns names for words: a vocabulary is kept as if its words were images.
std::vector<std::string> WordNames(size_t count) {
  std::vector<std::string> names;
  for (size_t i = 0; i < count; ++i) names.push_back(fmt::format("word/{:04}", i));
  return names;
}

struct Files {
  path words;
  path vectors;  // written last
};

std::optional<VladVectors> Read(const Files& files, std::span<const std::string> references) {
  std::error_code error;
  if (!std::filesystem::exists(files.vectors, error)) return std::nullopt;
  const GlobalFeatureFile words(files.words);
  return VladVectors{{words.Read(words.ImageNames())},
                     GlobalFeatureFile(files.vectors).Read(references)};
}

void Write(const Files& files, std::span<const std::string> references,
           const VladVectors& vectors) {
  const Eigen::MatrixXf& words = vectors.vocabulary.words;
  WriteGlobalDescriptors(files.words, WordNames(static_cast<size_t>(words.cols())), words);
  WriteGlobalDescriptors(files.vectors, references, vectors.of_references);
}

}  // namespace

VladVectors ComputeOrReadVladVectors(std::span<const std::string> references,
                                     const FeatureStore& features, const path& folder,
                                     uint64_t seed, int threads) {
  std::optional<std::string> key;
  if (!folder.empty()) key = KeyOf(references, features, seed);
  if (!key) return ComputeVladVectors(references, features, seed, threads);
  const std::string hash = HexText(HashBytes64(*key));
  const Files files{folder / "vlad" / (hash + ".words.h5"), folder / "vlad" / (hash + ".h5")};
  const FolderLock lock(folder, FolderLock::Mode::kExclusive, FolderLock::IfHeld::kWait);
  if (auto kept = Read(files, references)) return *std::move(kept);
  VladVectors vectors = ComputeVladVectors(references, features, seed, threads);
  // Where no reference has a feature there is nothing to keep.
  if (vectors.of_references.size() > 0) Write(files, references, vectors);
  return vectors;
}

namespace {

double Cosine(const Eigen::VectorXf& a, const Eigen::VectorXf& b) {
  return a.cast<double>().dot(b.cast<double>());
}

}  // namespace

void JoinedRetrieval::Join(const PosedImage& image, const Features& features) {
  joined_.push_back({image, references_->VectorOf(features)});
}

std::vector<PosedImage> JoinedRetrieval::Merge(const std::string& query,
                                               const Features& query_features,
                                               const std::vector<PosedImage>& retrieved,
                                               size_t top_k, size_t max_joined) const {
  const Eigen::VectorXf query_vector = references_->VectorOf(query_features);
  struct Ranked {
    double cosine;
    const PosedImage* image;
  };
  std::vector<Ranked> ranked;
  for (const Joined& joined : joined_) {
    if (joined.image.name == query) continue;
    ranked.push_back({Cosine(query_vector, joined.vector), &joined.image});
  }
  std::stable_sort(ranked.begin(), ranked.end(),
                   [](const Ranked& a, const Ranked& b) { return a.cosine > b.cosine; });
  ranked.resize(std::min(ranked.size(), max_joined));

  std::vector<PosedImage> merged;
  auto next = ranked.begin();
  for (const PosedImage& image : retrieved) {
    const double cosine = Cosine(query_vector, references_->VectorOfReference(image.name));
    while (next != ranked.end() && next->cosine > cosine) merged.push_back(*(next++)->image);
    merged.push_back(image);
  }
  while (next != ranked.end()) merged.push_back(*(next++)->image);
  merged.resize(std::min(merged.size(), top_k));
  return merged;
}

}  // namespace raylift
