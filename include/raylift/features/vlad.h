// Retrieves the references that probably show what a query shows, before any matching: an image's
// local features are summed up in one vector, and images of the same place have similar vectors.
// VLAD (Jegou et al. 2010): descriptors are assigned to the nearest word of a vocabulary, and for
// each word their differences from it are summed. Normalized as in Arandjelovic and Zisserman
// (2013): each word's sum by itself (intra-normalization, so that repeated structure does not
// dominate), then signed square roots, then the whole.

#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "raylift/scene/features.h"

namespace raylift {

// A D x K matrix: a word is a column, the mean of unit descriptors. It has no columns where there
// were no descriptors to learn from.
struct Vocabulary {
  Eigen::MatrixXf words;
};

struct VocabularyOptions {
  int num_words = 64;
  // The words are learned from a random choice of at most so many of all descriptors.
  int max_descriptors = 100000;
  int max_iterations = 20;
  uint64_t seed = 0;
  int threads = 0;  // 0: all
};

// Learns the words by k-means (k-means++ initialization, Lloyd's iterations) on descriptors of the
// references; they are fewer than num_words where there are fewer different descriptors. The result
// is the same on every machine and for any number of threads. Throws InputError if descriptors
// differ in size.
Vocabulary TrainVocabulary(std::span<const Features> images, const VocabularyOptions& options = {});

// Does the same where the images' features do not fit into memory together: `visit` is called for
// each image in order, twice, and calls `look` with the image's features.
using FeaturesVisit =
    std::function<void(size_t image, const std::function<void(const Features& features)>& look)>;
Vocabulary TrainVocabulary(size_t num_images, const FeaturesVisit& visit,
                           const VocabularyOptions& options = {});

// Returns the image's vector (D * K values) of unit length; zero for an image without features.
// Throws InputError if the descriptors' size is not the vocabulary's.
Eigen::VectorXf ComputeVlad(const Features& features, const Vocabulary& vocabulary);

// Returns for each query (a column) the k references (columns) of the largest cosine, best first,
// the lower index first among equals. The vectors must have unit length (or zero). The search is
// exact.
RetrievedLists RetrieveTopK(const Eigen::MatrixXf& query_vectors,
                            const Eigen::MatrixXf& reference_vectors, int k, int threads = 0);

}  // namespace raylift
