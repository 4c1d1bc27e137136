#include <algorithm>
#include <cmath>

#include "features/dot_products.h"
#include "support/matchers.h"
#include <gtest/gtest.h>

namespace raylift {
namespace {

Eigen::MatrixXf RandomVectors(Rng& rng, int dimension, int count) {
  Eigen::MatrixXf vectors(dimension, count);
  for (float& value : vectors.reshaped()) value = static_cast<float>(rng.Normal());
  vectors.colwise().normalize();
  return vectors;
}

// All products in double, sorted.
RetrievedLists BruteForce(const Eigen::MatrixXf& queries, const Eigen::MatrixXf& references,
                          size_t k) {
  const Eigen::MatrixXd scores = references.cast<double>().transpose() * queries.cast<double>();
  RetrievedLists lists;
  for (Eigen::Index q = 0; q < queries.cols(); ++q) {
    std::vector<RetrievedReference> list;
    for (int i = 0; i < references.cols(); ++i) list.push_back({i, scores(i, q)});
    std::stable_sort(list.begin(), list.end(),
                     [](const auto& a, const auto& b) { return a.score > b.score; });
    list.resize(std::min(list.size(), k));
    lists.push_back(list);
  }
  return lists;
}

RetrievedLists SearchInBlocks(const Eigen::MatrixXf& queries, const Eigen::MatrixXf& references,
                              int k, Eigen::Index block, int threads) {
  DotProductSearch search(queries, k);
  for (Eigen::Index first = 0; first < references.cols(); first += block) {
    search.Add(references.middleCols(first, std::min(block, references.cols() - first)), threads);
  }
  return search.Best();
}

void ExpectSame(const RetrievedLists& actual, const RetrievedLists& expected) {
  ASSERT_EQ(actual.size(), expected.size());
  for (size_t q = 0; q < actual.size(); ++q) {
    ASSERT_EQ(actual[q].size(), expected[q].size());
    for (size_t rank = 0; rank < actual[q].size(); ++rank) {
      EXPECT_EQ(actual[q][rank].reference_index, expected[q][rank].reference_index);
      // Sums of doubles in another order.
      EXPECT_NEAR(actual[q][rank].score, expected[q][rank].score, 1e-13);
    }
  }
}

TEST(DotProductSearch, AgreesWithProductsInDouble) {
  Rng rng = TestRng();
  for (const int dimension : {1, 3, 17, 512}) {
    const Eigen::MatrixXf queries = RandomVectors(rng, dimension, 37);
    const Eigen::MatrixXf references = RandomVectors(rng, dimension, 701) * 3;
    const auto expected = BruteForce(queries, references, 20);
    // In one dimension all are equal: any rounding of theirs would show.
    ExpectSame(SearchInBlocks(queries, references, 20, 100, 2), expected);
  }
}

TEST(DotProductSearch, RanksWhatFloatCannotTellApart) {
  Rng rng = TestRng();
  constexpr int kDimension = 4096;
  const Eigen::MatrixXf query = RandomVectors(rng, kDimension, 1);
  // One value at a time is one unit in the last place larger or smaller: scores differ by 1e-9.
  Eigen::MatrixXf references = query.replicate(1, 300);
  for (int i = 0; i < references.cols(); ++i) {
    float& value = references(static_cast<Eigen::Index>(rng.UniformIndex(kDimension)), i);
    value = std::nextafter(value, rng.Uniform() < 0.5 ? 2.0f : -2.0f);
  }
  ExpectSame(SearchInBlocks(query, references, 10, 64, 2), BruteForce(query, references, 10));
}

TEST(DotProductSearch, NeitherBlocksNorThreadsChangeABit) {
  Rng rng = TestRng();
  const Eigen::MatrixXf queries = RandomVectors(rng, 300, 300);
  Eigen::MatrixXf references = RandomVectors(rng, 300, 600);
  references.rightCols(300) = references.leftCols(300);  // each stands twice
  const RetrievedLists once = SearchInBlocks(queries, references, 7, 600, 1);
  for (const int block : {1, 7, 256, 599}) {
    EXPECT_EQ(SearchInBlocks(queries, references, 7, block, 3), once) << block;
  }
  for (const auto& list : once) {
    for (size_t rank = 0; rank + 1 < list.size(); rank += 2) {
      EXPECT_EQ(list[rank].score, list[rank + 1].score);
      EXPECT_EQ(list[rank].reference_index + 300, list[rank + 1].reference_index);
    }
  }
}

TEST(DotProductSearch, ScoresThatOverflowInFloatAreStillRanked) {
  Eigen::MatrixXf references(2, 4);
  references << 1e30f, 3e30f, -1e30f, 2e30f,  //
      0, 0, 0, 0;
  const Eigen::MatrixXf query = Eigen::Vector2f(1e30f, 1);
  const RetrievedLists lists = SearchInBlocks(query, references, 3, 2, 1);
  ASSERT_EQ(lists[0].size(), 3u);
  EXPECT_EQ(lists[0][0].reference_index, 1);
  EXPECT_EQ(lists[0][1].reference_index, 3);
  EXPECT_EQ(lists[0][2].reference_index, 0);
}

TEST(DotProductSearch, TheNextBlockIsReadMeanwhile) {
  const Eigen::MatrixXf one = Eigen::MatrixXf::Identity(3, 1);
  for (const int threads : {1, 2}) {
    DotProductSearch search(one, 5);
    bool called = false;
    search.Add(one, threads, [&] { called = true; });
    EXPECT_TRUE(called);
    EXPECT_EQ(search.Best().at(0).size(), 1u);
  }
}

}  // namespace
}  // namespace raylift
