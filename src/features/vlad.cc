#include "raylift/features/vlad.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>

#include "base/rng.h"
#include "features/dot_products.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"

namespace raylift {
namespace {

constexpr Eigen::Index kBlockRows = 256;

int64_t SquaredNorm(const QuantizedDescriptors& descriptors, Eigen::Index i) {
  return descriptors.values.col(i).cast<int64_t>().squaredNorm();
}

// Calls visit(i, products of descriptor i with the words) for all descriptors, in parallel.
template <typename Visit>
void ForEachRowOfDots(const QuantizedDescriptors& descriptors, const QuantizedDescriptors& words,
                      int threads, const Visit& visit) {
  const auto num_blocks = static_cast<size_t>((descriptors.count + kBlockRows - 1) / kBlockRows);
  const DotColumns columns(words);
  const Eigen::Index stride = columns.stride();
  ParallelFor(num_blocks, threads, [&](size_t block) {
    const auto first = static_cast<Eigen::Index>(block) * kBlockRows;
    const Eigen::Index num_rows = std::min(kBlockRows, descriptors.count - first);
    std::vector<int32_t> dots(kBlockRows * stride);
    columns.ComputeDots(descriptors, first, num_rows, dots);
    for (Eigen::Index i = 0; i < num_rows; ++i) {
      visit(first + i, std::span<int32_t>(dots.data() + i * stride, words.count));
    }
  });
}

// Returns an index drawn with probability proportional to its weight; the total is positive.
Eigen::Index DrawByWeight(const std::vector<int64_t>& weights, double total, Rng& rng) {
  double rest = rng.Uniform() * total;
  Eigen::Index last_possible = 0;
  for (size_t i = 0; i < weights.size(); ++i) {
    if (weights[i] == 0) {
      continue;
    }
    last_possible = static_cast<Eigen::Index>(i);
    rest -= static_cast<double>(weights[i]);
    if (rest < 0) {
      break;
    }
  }
  return last_possible;
}

// Returns the first words by k-means++ (Arthur and Vassilvitskii 2007): each next word is a
// descriptor drawn with probability proportional to its squared distance to the nearest word so
// far.
QuantizedDescriptors InitialWords(const QuantizedDescriptors& descriptors, int num_words,
                                  int threads, Rng& rng) {
  std::vector<Eigen::Index> chosen;
  std::vector<int64_t> squared_norms(descriptors.count);
  for (Eigen::Index i = 0; i < descriptors.count; ++i) {
    squared_norms[i] = SquaredNorm(descriptors, i);
  }
  // Equal, and larger than any distance, before the first word.
  std::vector<int64_t> squared_distances(descriptors.count, 8 * kQuantizedOneSquared);
  while (static_cast<int>(chosen.size()) < num_words) {
    double total = 0;
    for (const int64_t squared_distance : squared_distances) {
      total += static_cast<double>(squared_distance);
    }
    if (total == 0) {
      break;
    }
    chosen.push_back(DrawByWeight(squared_distances, total, rng));
    QuantizedDescriptors newest(descriptors.dimension, 1);
    newest.values.col(0) = descriptors.values.col(chosen.back());
    const int64_t newest_squared_norm = squared_norms[chosen.back()];
    ForEachRowOfDots(descriptors, newest, threads,
                     [&](Eigen::Index i, std::span<const int32_t> dots) {
                       const int64_t squared_distance =
                           squared_norms[i] + newest_squared_norm - 2 * int64_t{dots[0]};
                       squared_distances[i] = std::min(squared_distances[i], squared_distance);
                     });
  }
  QuantizedDescriptors words(descriptors.dimension, static_cast<Eigen::Index>(chosen.size()));
  for (size_t k = 0; k < chosen.size(); ++k) {
    words.values.col(static_cast<Eigen::Index>(k)) = descriptors.values.col(chosen[k]);
  }
  return words;
}

// Moves each word to the rounded mean of its descriptors; a word without any stays.
void MoveToMeans(const QuantizedDescriptors& descriptors, const std::vector<int>& word_of,
                 QuantizedDescriptors& words) {
  using Sums = Eigen::Matrix<int64_t, Eigen::Dynamic, Eigen::Dynamic>;
  Sums sums = Sums::Zero(words.values.rows(), words.count);
  std::vector<int64_t> counts(words.count, 0);
  for (Eigen::Index i = 0; i < descriptors.count; ++i) {
    sums.col(word_of[i]) += descriptors.values.col(i).cast<int64_t>();
    ++counts[word_of[i]];
  }
  for (Eigen::Index k = 0; k < words.count; ++k) {
    if (counts[k] == 0) {
      continue;
    }
    for (Eigen::Index d = 0; d < words.dimension; ++d) {
      words.values(d, k) = static_cast<int16_t>(
          std::lround(static_cast<double>(sums(d, k)) / static_cast<double>(counts[k])));
    }
  }
}

// Rounds words (means of unit descriptors, hence at most of unit length) without normalizing them.
QuantizedDescriptors QuantizeWords(const Eigen::MatrixXf& words) {
  QuantizedDescriptors quantized(words.rows(), words.cols());
  for (Eigen::Index k = 0; k < words.cols(); ++k) {
    for (Eigen::Index d = 0; d < words.rows(); ++d) {
      quantized.values(d, k) =
          static_cast<int16_t>(std::lround(std::clamp(words(d, k), -1.0f, 1.0f) * kQuantizedOne));
    }
  }
  return quantized;
}

// Returns the nearest word of each descriptor, the first among equals; there must be a word.
std::vector<int> AssignToWords(const QuantizedDescriptors& descriptors,
                               const QuantizedDescriptors& words, int threads) {
  // The nearest word maximizes dot - |word|^2 / 2.
  std::vector<int32_t> half_squared_norms(words.count);
  for (Eigen::Index k = 0; k < words.count; ++k) {
    half_squared_norms[k] = static_cast<int32_t>(SquaredNorm(words, k) / 2);
  }
  std::vector<int> word_of(descriptors.count);
  ForEachRowOfDots(descriptors, words, threads, [&](Eigen::Index i, std::span<int32_t> dots) {
    for (size_t k = 0; k < dots.size(); ++k) {
      dots[k] -= half_squared_norms[k];
    }
    word_of[i] = static_cast<int>(IndexOfMax(dots));
  });
  return word_of;
}

// Returns the means of at most num_words clusters by k-means; none without descriptors. All
// decisions are by integers, so that the words are the same on every machine and for any number of
// threads.
QuantizedDescriptors ClusterDescriptors(const QuantizedDescriptors& descriptors, int num_words,
                                        int max_iterations, int threads, Rng& rng) {
  QuantizedDescriptors words = InitialWords(descriptors, num_words, threads, rng);
  if (words.count == 0) {
    return words;
  }
  std::vector<int> word_of;
  for (int iteration = 0; iteration < max_iterations; ++iteration) {
    std::vector<int> nearest = AssignToWords(descriptors, words, threads);
    if (nearest == word_of) {
      break;
    }
    word_of = std::move(nearest);
    MoveToMeans(descriptors, word_of, words);
  }
  return words;
}

void CheckDimension(Eigen::Index expected, Eigen::Index found) {
  if (expected != found) {
    throw InputError(fmt::format("expected descriptors of {} values, found {}", expected, found));
  }
}

// Draws max_descriptors of all descriptors; every choice is equally likely (Knuth's selection
// sampling).
Eigen::MatrixXf SampleDescriptors(size_t num_images, const FeaturesVisit& visit,
                                  int max_descriptors, Rng& rng) {
  int64_t total = 0;
  Eigen::Index dimension = 0;
  const auto count_descriptors = [&](const Features& image) {
    if (image.descriptors.cols() == 0) {
      return;
    }
    if (dimension > 0) {
      CheckDimension(dimension, image.descriptors.rows());
    }
    dimension = image.descriptors.rows();
    total += image.descriptors.cols();
  };
  for (size_t i = 0; i < num_images; ++i) {
    visit(i, count_descriptors);
  }
  const int64_t count = std::min<int64_t>(total, std::max(0, max_descriptors));
  Eigen::MatrixXf sample(dimension, static_cast<Eigen::Index>(count));
  int64_t seen = 0;
  int64_t taken = 0;
  const auto take_descriptors = [&](const Features& image) {
    for (const auto descriptor : image.descriptors.colwise()) {
      if (rng.Uniform() * static_cast<double>(total - seen) < static_cast<double>(count - taken)) {
        sample.col(taken) = descriptor;
        ++taken;
      }
      ++seen;
    }
  };
  for (size_t i = 0; i < num_images; ++i) {
    visit(i, take_descriptors);
  }
  return sample;
}

// Scales columns to unit length; zero columns stay.
void NormalizeColumns(Eigen::Ref<Eigen::MatrixXf> matrix) {
  for (auto column : matrix.colwise()) {
    const float norm = column.norm();
    if (norm > 0) {
      column /= norm;
    }
  }
}

}  // namespace

Vocabulary TrainVocabulary(std::span<const Features> images, const VocabularyOptions& options) {
  return TrainVocabulary(
      images.size(), [&](size_t i, const auto& look) { look(images[i]); }, options);
}

Vocabulary TrainVocabulary(size_t num_images, const FeaturesVisit& visit,
                           const VocabularyOptions& options) {
  Rng rng(StreamSeed(options.seed, "vocabulary", "k-means"));
  const QuantizedDescriptors descriptors =
      QuantizeDirections(SampleDescriptors(num_images, visit, options.max_descriptors, rng));
  const QuantizedDescriptors words = ClusterDescriptors(
      descriptors, options.num_words, options.max_iterations, options.threads, rng);
  Vocabulary vocabulary;
  vocabulary.words =
      words.values.topLeftCorner(words.dimension, words.count).cast<float>() / kQuantizedOne;
  return vocabulary;
}

Eigen::VectorXf ComputeVlad(const Features& features, const Vocabulary& vocabulary) {
  const Eigen::MatrixXf& words = vocabulary.words;
  Eigen::MatrixXf sums = Eigen::MatrixXf::Zero(words.rows(), words.cols());
  if (words.cols() > 0 && features.descriptors.cols() > 0) {
    CheckDimension(words.rows(), features.descriptors.rows());
    const QuantizedDescriptors descriptors = QuantizeDirections(features.descriptors);
    const std::vector<int> word_of = AssignToWords(descriptors, QuantizeWords(words), 1);
    for (Eigen::Index i = 0; i < descriptors.count; ++i) {
      sums.col(word_of[i]) +=
          descriptors.values.col(i).head(words.rows()).cast<float>() / kQuantizedOne -
          words.col(word_of[i]);
    }
  }
  NormalizeColumns(sums);
  sums = sums.array().sign() * sums.array().abs().sqrt();
  Eigen::VectorXf vlad = sums.reshaped();
  NormalizeColumns(vlad);
  return vlad;
}

RetrievedLists RetrieveTopK(const Eigen::MatrixXf& query_vectors,
                            const Eigen::MatrixXf& reference_vectors, int k, int threads) {
  DotProductSearch search(query_vectors, k);
  search.Add(reference_vectors, threads);
  return search.Best();
}

}  // namespace raylift
