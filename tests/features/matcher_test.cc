#include <algorithm>
#include <cmath>
#include <limits>

#include "support/matchers.h"

#include "raylift/features/local_features.h"

namespace raylift {
namespace {

// Random non-negative unit descriptors, as RootSIFT's, at random places.
Features RandomFeatures(Rng& rng, int count, int dimension = 128) {
  Features features;
  features.image_width_px = 640;
  features.image_height_px = 480;
  features.descriptors.resize(dimension, count);
  for (int i = 0; i < count; ++i) {
    features.keypoints_px.emplace_back(rng.Uniform(0, 640), rng.Uniform(0, 480));
    for (int k = 0; k < dimension; ++k) {
      features.descriptors(k, i) = static_cast<float>(std::abs(rng.Normal()));
    }
    features.descriptors.col(i).normalize();
  }
  return features;
}

// The same features in reverse order, descriptors disturbed by various amounts.
Features DisturbedAndReversed(Rng& rng, const Features& features) {
  Features result = features;
  const auto count = static_cast<int>(features.keypoints_px.size());
  for (int i = 0; i < count; ++i) {
    const double noise = rng.Uniform(0, 0.12);
    result.keypoints_px[i] = features.keypoints_px[count - 1 - i];
    for (int k = 0; k < features.descriptors.rows(); ++k) {
      result.descriptors(k, i) =
          features.descriptors(k, count - 1 - i) + static_cast<float>(noise * rng.Normal());
    }
    result.descriptors.col(i).normalize();
  }
  return result;
}

struct Nearest {
  int index = -1;
  double distance = std::numeric_limits<double>::infinity();
  double second_distance = std::numeric_limits<double>::infinity();  // at another place
};

// The definition, in double precision and by distances, not products.
Nearest FindNearest(const Eigen::VectorXf& descriptor, const Features& others) {
  constexpr double kSamePlacePx = 2;
  Eigen::VectorXd distances(others.descriptors.cols());
  for (int j = 0; j < distances.size(); ++j) {
    distances[j] = (descriptor.cast<double>() - others.descriptors.col(j).cast<double>()).norm();
  }
  Nearest nearest;
  nearest.distance = distances.minCoeff(&nearest.index);
  for (int j = 0; j < distances.size(); ++j) {
    const double apart_px = (others.keypoints_px[j] - others.keypoints_px[nearest.index]).norm();
    if (j != nearest.index && apart_px > kSamePlacePx) {
      nearest.second_distance = std::min(nearest.second_distance, distances[j]);
    }
  }
  return nearest;
}

std::vector<FeatureMatch> MatchByDefinition(const Features& query, const Features& reference,
                                            const MatchOptions& options) {
  std::vector<FeatureMatch> matches;
  for (int i = 0; i < query.descriptors.cols(); ++i) {
    const Nearest nearest = FindNearest(query.descriptors.col(i), reference);
    const Nearest back = FindNearest(reference.descriptors.col(nearest.index), query);
    const bool distinct =
        options.max_ratio >= 1 || nearest.distance < options.max_ratio * nearest.second_distance;
    if (back.index == i && distinct) {
      const double cosine = query.descriptors.col(i).cast<double>().dot(
          reference.descriptors.col(nearest.index).cast<double>());
      matches.push_back({i, nearest.index, static_cast<float>(0.5 * (1 + cosine))});
    }
  }
  return matches;
}

void ExpectSameMatches(const std::vector<FeatureMatch>& actual,
                       const std::vector<FeatureMatch>& expected) {
  ASSERT_EQ(actual.size(), expected.size());
  for (size_t i = 0; i < actual.size(); ++i) {
    EXPECT_EQ(actual[i].query_index, expected[i].query_index);
    EXPECT_EQ(actual[i].reference_index, expected[i].reference_index);
    // Rounding to 16 bits moves a cosine by about 1e-5.
    EXPECT_NEAR(actual[i].score, expected[i].score, 3e-5);
  }
}

// Random descriptors have no ties within the rounding, so the sets must be equal.
TEST(MatchMutualNearest, AgreesWithTheDefinition) {
  Rng rng = TestRng();
  for (const int dimension : {8, 33, 64, 128, 200, 256}) {
    const Features query = RandomFeatures(rng, 300, dimension);
    const Features reference = DisturbedAndReversed(rng, query);
    for (const double max_ratio : {0.6, 0.8, 1.0}) {
      const MatchOptions options{.max_ratio = max_ratio};
      const auto matches = MatchMutualNearest(query, reference, options);
      EXPECT_GT(matches.size(), 10u);
      ExpectSameMatches(matches, MatchByDefinition(query, reference, options));
    }
  }
}

TEST(MatchMutualNearest, TakesAnyNumbersOfFeatures) {
  Rng rng = TestRng();
  for (const int num_query : {1, 2, 3, 31, 33, 64}) {
    for (const int num_reference : {1, 2, 3, 4, 5, 70}) {
      const Features query = RandomFeatures(rng, num_query);
      const Features reference = RandomFeatures(rng, num_reference);
      ExpectSameMatches(MatchMutualNearest(query, reference),
                        MatchByDefinition(query, reference, {}));
    }
  }
}

TEST(MatchMutualNearest, ASingleFeatureMatchesASingleFeature) {
  Rng rng = TestRng();
  const auto matches = MatchMutualNearest(RandomFeatures(rng, 1), RandomFeatures(rng, 1));
  ASSERT_EQ(matches.size(), 1u);
  EXPECT_EQ(matches[0].query_index, 0);
  EXPECT_EQ(matches[0].reference_index, 0);
}

TEST(MatchMutualNearest, FindsNothingWithoutFeatures) {
  Rng rng = TestRng();
  const Features some = RandomFeatures(rng, 5);
  Features without_descriptors = some;
  without_descriptors.descriptors.resize(0, 0);
  for (const Features& none : {Features{}, RandomFeatures(rng, 0), without_descriptors}) {
    EXPECT_TRUE(MatchMutualNearest(none, some).empty());
    EXPECT_TRUE(MatchMutualNearest(some, none).empty());
    EXPECT_TRUE(MatchMutualNearest(none, none).empty());
  }
}

TEST(MatchMutualNearest, TheSamePlaceAgainIsNotAmbiguous) {
  Rng rng = TestRng();
  const Features query = RandomFeatures(rng, 1);
  Features reference = RandomFeatures(rng, 3);
  reference.descriptors.col(0) = query.descriptors.col(0);
  reference.descriptors(3, 0) += 0.10f;
  reference.descriptors.col(1) = query.descriptors.col(0);
  reference.descriptors(5, 1) += 0.11f;
  reference.keypoints_px[1] = reference.keypoints_px[0] + Eigen::Vector2d(1.9, 0);
  EXPECT_EQ(MatchMutualNearest(query, reference).size(), 1u);
  reference.keypoints_px[1] = reference.keypoints_px[0] + Eigen::Vector2d(2.1, 0);
  EXPECT_TRUE(MatchMutualNearest(query, reference).empty());
}

TEST(MatchMutualNearest, JoinsTheSameTwoPixelsOnce) {
  Rng rng = TestRng();
  Features query = RandomFeatures(rng, 2);
  Features reference = query;
  query.descriptors(0, 0) += 0.1f;
  EXPECT_EQ(MatchMutualNearest(query, reference).size(), 2u);
  query.keypoints_px[1] = query.keypoints_px[0];
  reference.keypoints_px[1] = reference.keypoints_px[0];
  const auto matches = MatchMutualNearest(query, reference);
  ASSERT_EQ(matches.size(), 1u);
  EXPECT_EQ(matches[0].query_index, 1);
}

TEST(MatchMutualNearest, EqualDescriptorsAtTwoPlacesAreAmbiguous) {
  Rng rng = TestRng();
  const Features query = RandomFeatures(rng, 1);
  Features reference = RandomFeatures(rng, 2);
  reference.descriptors.col(0) = query.descriptors.col(0);
  reference.descriptors.col(1) = query.descriptors.col(0);
  EXPECT_TRUE(MatchMutualNearest(query, reference).empty());
}

TEST(MatchMutualNearest, DescriptorsWithoutADirectionDoNoHarm) {
  Rng rng = TestRng();
  const Features query = RandomFeatures(rng, 20);
  Features reference = DisturbedAndReversed(rng, query);
  reference.descriptors.col(4).setZero();
  reference.descriptors.col(5).setConstant(std::numeric_limits<float>::quiet_NaN());
  reference.descriptors.col(6).setConstant(std::numeric_limits<float>::infinity());
  for (const FeatureMatch& match : MatchMutualNearest(query, reference)) {
    EXPECT_EQ(match.query_index, 19 - match.reference_index);
    EXPECT_TRUE(match.reference_index < 4 || match.reference_index > 6);
  }
}

TEST(MatchWithin, FindsInARegionWhatIsNotTheNearestOfAll) {
  Rng rng = TestRng();
  const Features reference = RandomFeatures(rng, 200, 32);
  Features query = reference;
  // Each of the query's features is at its place; a nearer one of each tenth lies elsewhere.
  for (size_t i = 0; i < 200; i += 10) {
    query.keypoints_px.push_back(reference.keypoints_px[i] + Eigen::Vector2d(5000, 0));
  }
  query.descriptors.conservativeResize(Eigen::NoChange, 220);
  for (Eigen::Index i = 0; i < 200; ++i) {
    if (i % 10 == 0) query.descriptors.col(200 + i / 10) = query.descriptors.col(i);
    for (Eigen::Index k = 0; k < 32; ++k) {
      query.descriptors(k, i) += static_cast<float>(0.05 * rng.Normal());
    }
  }
  std::vector<std::optional<SearchRegion>> regions;
  for (const Eigen::Vector2d& pixel : reference.keypoints_px) {
    regions.push_back(SearchRegion{pixel + Eigen::Vector2d(1, 1), 4 * Eigen::Matrix2d::Identity()});
  }
  regions[7].reset();
  size_t elsewhere = 0;
  for (const FeatureMatch& match : MatchMutualNearest(query, reference)) {
    elsewhere += match.query_index >= 200 ? 1 : 0;
  }
  EXPECT_EQ(elsewhere, 20U);
  const auto matches = MatchWithin(regions, query, reference);
  EXPECT_EQ(matches.size(), 199U);
  for (const FeatureMatch& match : matches) {
    EXPECT_EQ(match.query_index, match.reference_index);
    EXPECT_NE(match.reference_index, 7);
  }
}

// With descriptors that say nothing, one in twenty of the reference's has a match by chance.
TEST(MatchWithin, ChanceMakesFewMatches) {
  Rng rng = TestRng();
  const Features query = RandomFeatures(rng, 1000, 32), reference = RandomFeatures(rng, 1000, 32);
  std::vector<std::optional<SearchRegion>> regions;
  for (const Eigen::Vector2d& pixel : reference.keypoints_px) {
    regions.push_back(SearchRegion{pixel, 400 * Eigen::Matrix2d::Identity()});
  }
  EXPECT_LT(MatchWithin(regions, query, reference).size(), 70U);
}

TEST(SearchRegion, IsAnEllipseOfThreeDeviations) {
  const SearchRegion region{{0, 0}, Eigen::Vector2d(4, 25).asDiagonal()};
  EXPECT_NEAR(region.AreaPx2(), std::numbers::pi * 6 * 15, 1e-9);
}

TEST(MatchMutualNearest, RejectsDescriptorsOfDifferentSizes) {
  Rng rng = TestRng();
  const Features query = RandomFeatures(rng, 3, 128);
  const Features reference = RandomFeatures(rng, 3, 256);
  EXPECT_TRUE(FailsWithInputError([&] { MatchMutualNearest(query, reference); }, {"128", "256"}));
}

}  // namespace
}  // namespace raylift
