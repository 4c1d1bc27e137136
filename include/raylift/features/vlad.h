// Finds the references that probably show what a query shows, before any matching: an image's local
// features are summed up in one vector, and images of the same place have vectors that point the
// same way. VLAD (Jegou et al. 2010): descriptors are assigned to the nearest word of a vocabulary,
// and for each word their differences from it are summed. Normalized as in Arandjelovic and
// Zisserman (2013): each word's sum by itself (intra-normalization, so that repeated structure does
// not dominate), then signed square roots, then the whole.

#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "raylift/scene/features.h"

namespace raylift {

// D x K: a word is a column, the mean of unit descriptors. No columns where there was nothing to
// learn from.
struct Vocabulary {
  Eigen::MatrixXf words;
};

struct VocabularyOptions {
  int num_words = 64;
  // A random choice of so many of all descriptors is enough to learn from.
  int max_descriptors = 100000;
  int max_iterations = 20;
  uint64_t seed = 0;
  int threads = 0;  // 0: all
};

// The words by k-means (k-means++ initialization, Lloyd's iterations) on descriptors of the
// references; fewer than num_words where there are fewer different descriptors. The same on every
// machine and for any thread count. Throws InputError if descriptors differ in size.
Vocabulary TrainVocabulary(std::span<const Features> images, const VocabularyOptions& options = {});

// The same where the images' features are not in memory together: each is looked at by itself, in
// order, and twice. `visit` hands the features of an image to a function while they are there.
using FeaturesVisit =
    std::function<void(size_t image, const std::function<void(const Features& features)>& look)>;
Vocabulary TrainVocabulary(size_t num_images, const FeaturesVisit& visit,
                           const VocabularyOptions& options = {});

// The image's vector (D * K values) of unit length; zero for an image without features. Throws
// InputError if the descriptors' size is not the vocabulary's.
Eigen::VectorXf ComputeVlad(const Features& features, const Vocabulary& vocabulary);

// For each query (a column) the k references (columns) of the largest cosine, best first, the lower
// index first among equals. The vectors must have unit length (or zero). Exact.
RetrievedLists RetrieveTopK(const Eigen::MatrixXf& query_vectors,
                            const Eigen::MatrixXf& reference_vectors, int k, int threads = 0);

}  // namespace raylift
