#include "raylift/features/vlad.h"

#include <algorithm>
#include <cmath>

#include "base/rng.h"
#include "quantized_descriptors.h"
#include "vocabulary_kmeans.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/features/dot_product_search.h"

namespace raylift {
namespace {

void CheckDimension(Eigen::Index expected, Eigen::Index found) {
  if (expected != found) {
    throw InputError(fmt::format("expected descriptors of {} values, found {}", expected, found));
  }
}

// Every choice of max_descriptors is equally likely (Knuth's selection sampling).
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

// Columns to unit length; zero columns stay.
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
