// k-means on quantized descriptors. Everything that decides is an integer, so the words are the
// same on every machine and for any thread count.

#pragma once

#include <vector>

#include "base/rng.h"
#include "quantized_descriptors.h"
#include <Eigen/Core>

namespace raylift {

// Words (means of unit descriptors, hence at most of unit length) rounded, not normalized.
QuantizedDescriptors QuantizeWords(const Eigen::MatrixXf& words);

// The nearest word of each descriptor, the first among equals; there must be a word.
std::vector<int> AssignToWords(const QuantizedDescriptors& descriptors,
                               const QuantizedDescriptors& words, int threads);

// The means of at most num_words clusters; none without descriptors.
QuantizedDescriptors ClusterDescriptors(const QuantizedDescriptors& descriptors, int num_words,
                                        int max_iterations, int threads, Rng& rng);

}  // namespace raylift
