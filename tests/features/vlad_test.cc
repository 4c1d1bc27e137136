#include "raylift/features/vlad.h"

#include <cmath>

#include "support/matchers.h"

namespace raylift {
namespace {

constexpr int kDimension = 32;

Eigen::VectorXf RandomDirection(Rng& rng) {
  Eigen::VectorXf direction(kDimension);
  for (float& value : direction) value = static_cast<float>(std::abs(rng.Normal()));
  return direction.normalized();
}

Eigen::VectorXf Disturbed(Rng& rng, const Eigen::VectorXf& direction, double noise) {
  Eigen::VectorXf result = direction;
  for (float& value : result) value += static_cast<float>(noise * rng.Normal());
  return result.normalized();
}

Features FeaturesWith(const Eigen::MatrixXf& descriptors) {
  Features features;
  features.descriptors = descriptors;
  features.keypoints_px.resize(descriptors.cols(), Eigen::Vector2d::Zero());
  return features;
}

// Descriptors around `centers`, by turns.
Features FeaturesAround(Rng& rng, const Eigen::MatrixXf& centers, int count, double noise) {
  Eigen::MatrixXf descriptors(kDimension, count);
  for (int i = 0; i < count; ++i) {
    descriptors.col(i) = Disturbed(rng, centers.col(i % centers.cols()), noise);
  }
  return FeaturesWith(descriptors);
}

Eigen::MatrixXf RandomDirections(Rng& rng, int count) {
  Eigen::MatrixXf directions(kDimension, count);
  for (auto direction : directions.colwise()) direction = RandomDirection(rng);
  return directions;
}

TEST(TrainVocabulary, FindsTheMeansOfSeparateClusters) {
  Rng rng = TestRng();
  const Eigen::MatrixXf centers = RandomDirections(rng, 8);
  const Features features = FeaturesAround(rng, centers, 4000, 0.01);
  const Vocabulary vocabulary = TrainVocabulary(std::span(&features, 1), {.num_words = 8});
  ASSERT_EQ(vocabulary.words.cols(), 8);
  for (int c = 0; c < 8; ++c) {
    Eigen::VectorXf mean = Eigen::VectorXf::Zero(kDimension);
    for (int i = c; i < 4000; i += 8) mean += features.descriptors.col(i) / 500.0f;
    const float nearest = (vocabulary.words.colwise() - mean).colwise().norm().minCoeff();
    // Words are rounded to 1/32767 in each of 32 values.
    EXPECT_LT(nearest, 2e-4);
  }
}

TEST(TrainVocabulary, GivesTheSameForAnyThreadCount) {
  Rng rng = TestRng();
  std::vector<Features> images;
  for (int i = 0; i < 5; ++i) {
    images.push_back(FeaturesAround(rng, RandomDirections(rng, 30), 700, 0.1));
  }
  const VocabularyOptions options{.num_words = 20, .max_descriptors = 2000, .threads = 1};
  VocabularyOptions four_threads = options;
  four_threads.threads = 4;
  EXPECT_EQ(TrainVocabulary(images, options).words, TrainVocabulary(images, four_threads).words);
  VocabularyOptions another_seed = options;
  another_seed.seed = 1;
  EXPECT_NE(TrainVocabulary(images, options).words, TrainVocabulary(images, another_seed).words);
}

TEST(TrainVocabulary, HasNoMoreWordsThanDifferentDescriptors) {
  Rng rng = TestRng();
  const Eigen::MatrixXf three = RandomDirections(rng, 3);
  const Features features = FeaturesWith(three.replicate(1, 10));
  EXPECT_EQ(TrainVocabulary(std::span(&features, 1)).words.cols(), 3);
  EXPECT_EQ(TrainVocabulary({}).words.cols(), 0);
  const Features none;
  EXPECT_EQ(TrainVocabulary(std::span(&none, 1)).words.cols(), 0);
}

TEST(TrainVocabulary, RejectsDescriptorsOfDifferentSizes) {
  const std::vector<Features> images = {FeaturesWith(Eigen::MatrixXf::Ones(128, 2)),
                                        FeaturesWith(Eigen::MatrixXf::Ones(256, 2))};
  EXPECT_TRUE(FailsWithInputError([&] { TrainVocabulary(images); }, {"128", "256"}));
}

// The formula, written down once more in double precision.
TEST(ComputeVlad, AgreesWithTheDefinition) {
  Rng rng = TestRng();
  const Vocabulary vocabulary{RandomDirections(rng, 6)};
  const Features features = FeaturesAround(rng, RandomDirections(rng, 50), 200, 0.05);
  Eigen::MatrixXd sums = Eigen::MatrixXd::Zero(kDimension, 6);
  for (const auto descriptor : features.descriptors.colwise()) {
    Eigen::Index word = 0;
    (vocabulary.words.colwise() - descriptor).colwise().squaredNorm().minCoeff(&word);
    sums.col(word) += (descriptor - vocabulary.words.col(word)).cast<double>();
  }
  sums.colwise().normalize();
  for (double& value : sums.reshaped()) {
    value = std::copysign(std::sqrt(std::abs(value)), value);
  }
  const Eigen::VectorXd expected = sums.reshaped().normalized();
  const Eigen::VectorXf vlad = ComputeVlad(features, vocabulary);
  EXPECT_NEAR(vlad.norm(), 1, 1e-5);
  // The square root enlarges the rounding of small sums.
  EXPECT_LT((vlad.cast<double>() - expected).norm(), 1e-2);
}

TEST(ComputeVlad, IsZeroWithoutFeatures) {
  Rng rng = TestRng();
  const Vocabulary vocabulary{RandomDirections(rng, 6)};
  EXPECT_EQ(ComputeVlad(Features{}, vocabulary),
            Eigen::VectorXf::Zero(Eigen::Index{6} * kDimension));
  const Features features = FeaturesAround(rng, RandomDirections(rng, 2), 3, 0);
  EXPECT_EQ(ComputeVlad(features, Vocabulary{}).size(), 0);
}

TEST(ComputeVlad, RejectsDescriptorsOfAnotherSize) {
  Rng rng = TestRng();
  const Vocabulary vocabulary{RandomDirections(rng, 6)};
  const Features features = FeaturesWith(Eigen::MatrixXf::Ones(128, 2));
  EXPECT_TRUE(FailsWithInputError([&] { ComputeVlad(features, vocabulary); }, {"32", "128"}));
}

// Places have descriptors of their own beside some that all places share; a query sees half of what
// its place has.
TEST(RetrieveTopK, FindsThePlace) {
  Rng rng = TestRng();
  constexpr int kPlaces = 20;
  const Eigen::MatrixXf shared = RandomDirections(rng, 40);
  std::vector<Features> references, queries;
  for (int place = 0; place < kPlaces; ++place) {
    Eigen::MatrixXf centers(kDimension, 100);
    centers << shared, RandomDirections(rng, 60);
    references.push_back(FeaturesAround(rng, centers, 200, 0.03));
    queries.push_back(FeaturesAround(rng, centers.middleCols(20, 50), 100, 0.03));
  }
  const Vocabulary vocabulary = TrainVocabulary(references, {.num_words = 32});
  Eigen::MatrixXf reference_vectors(32 * kDimension, kPlaces);
  Eigen::MatrixXf query_vectors(32 * kDimension, kPlaces);
  for (int place = 0; place < kPlaces; ++place) {
    reference_vectors.col(place) = ComputeVlad(references[place], vocabulary);
    query_vectors.col(place) = ComputeVlad(queries[place], vocabulary);
  }
  const auto results = RetrieveTopK(query_vectors, reference_vectors, 5, 2);
  ASSERT_EQ(results.size(), static_cast<size_t>(kPlaces));
  for (int place = 0; place < kPlaces; ++place) {
    ASSERT_EQ(results[place].size(), 5u);
    EXPECT_EQ(results[place][0].reference_index, place);
    for (int rank = 1; rank < 5; ++rank) {
      EXPECT_LE(results[place][rank].score, results[place][rank - 1].score);
    }
  }
}

TEST(RetrieveTopK, BreaksTiesByIndex) {
  const Eigen::MatrixXf query = Eigen::MatrixXf::Identity(3, 1);
  Eigen::MatrixXf references = Eigen::MatrixXf::Zero(3, 5);
  references(0, 3) = 1;
  references(1, 1) = 1;
  const auto results = RetrieveTopK(query, references, 10);
  ASSERT_EQ(results.size(), 1u);
  const std::vector<RetrievedReference> expected = {{3, 1}, {0, 0}, {1, 0}, {2, 0}, {4, 0}};
  EXPECT_EQ(results[0], expected);
}

TEST(RetrieveTopK, TakesNoReferencesNoQueriesAndNoK) {
  const Eigen::MatrixXf one = Eigen::MatrixXf::Identity(3, 1);
  EXPECT_EQ(RetrieveTopK(one, Eigen::MatrixXf(), 5).at(0).size(), 0u);
  EXPECT_EQ(RetrieveTopK(Eigen::MatrixXf(), one, 5).size(), 0u);
  EXPECT_EQ(RetrieveTopK(one, one, 0).at(0).size(), 0u);
  EXPECT_EQ(RetrieveTopK(one, one, -1).at(0).size(), 0u);
}

}  // namespace
}  // namespace raylift
