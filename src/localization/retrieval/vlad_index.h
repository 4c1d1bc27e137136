// Retrieves references by their VLAD vectors.

#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "localization/matching/feature_store.h"
#include <Eigen/Core>

#include "raylift/features/vlad.h"
#include "raylift/scene/features.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// The vocabulary and the vectors by which references are retrieved.
struct VladVectors {
  Vocabulary vocabulary;
  Eigen::MatrixXf of_references;  // a column each
};

// Computes the vectors. The vocabulary is learned from the references alone, so that a query's
// references do not depend on the other queries. All references must be in `features`.
VladVectors ComputeVladVectors(std::span<const std::string> references,
                               const FeatureStore& features, uint64_t seed, int threads);

class VladIndex {
 public:
  // Takes one vector for each reference.
  VladIndex(std::vector<std::string> references, VladVectors vectors);

  const Vocabulary& vocabulary() const { return vectors_.vocabulary; }
  Eigen::VectorXf VectorOf(const Features& features) const;
  Eigen::VectorXf VectorOfReference(const std::string& name) const;

  // Returns of each query, whose vector is a column, the `top_k` most alike; none is its own
  // reference.
  RetrievedLists Best(std::span<const std::string> queries, const Eigen::MatrixXf& vectors,
                      int top_k, int threads) const;

 private:
  std::vector<std::string> references_;
  VladVectors vectors_;
  std::map<std::string, Eigen::Index> index_of_name_;
};

// Retrieves for queries whose features are in the same store.
RetrievedLists RetrieveByVlad(const VladIndex& index, std::span<const std::string> queries,
                              const FeatureStore& features, int top_k, int threads);

// Keeps the vectors by which references are retrieved beside their features: learning a vocabulary
// requires reading the features of all references.

// Returns the vectors of ComputeVladVectors(): read from `folder`/vlad, in hloc's layout of global
// features, where they were made from the same features of the same references with the same seed,
// else computed and written there. Of runs that begin at once one computes, and the others wait.
// Nothing is kept without a folder, or where features are known that are in no file.
VladVectors ComputeOrReadVladVectors(std::span<const std::string> references,
                                     const FeatureStore& features,
                                     const std::filesystem::path& folder, uint64_t seed,
                                     int threads);

// Retrieves among references that grow: localized queries are ranked among the references that were
// retrieved for a query, by the cosines of their VLAD vectors.

class JoinedRetrieval {
 public:
  explicit JoinedRetrieval(std::shared_ptr<const VladIndex> references)
      : references_(std::move(references)) {}

  void Join(const PosedImage& image, const Features& features);

  // Returns the `top_k` best of the retrieved references, which keep their order, and of up to
  // `max_joined` joined queries: each stands before the first reference that is less similar to the
  // query.
  std::vector<PosedImage> Merge(const std::string& query, const Features& query_features,
                                const std::vector<PosedImage>& retrieved, size_t top_k,
                                size_t max_joined) const;

 private:
  std::shared_ptr<const VladIndex> references_;
  struct Joined {
    PosedImage image;
    Eigen::VectorXf vector;
  };
  std::vector<Joined> joined_;
};

}  // namespace raylift
