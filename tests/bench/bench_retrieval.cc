// Retrieval by dot products against the bare matrix products of the same blocks (Eigen, compiled
// alike), which rank nothing. One thread, CPU time, interleaved; medians of rounds.
//   bench_retrieval [references = 20000] [queries = 500] [dimension = 4096] [top k = 50] [rounds =
//   3]

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <vector>

#include "base/rng.h"
#include "base/statistics.h"
#include "features/dot_products.h"
#include <Eigen/Core>

namespace raylift {
namespace {

constexpr Eigen::Index kBlock = 1024;

double CpuSeconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

Eigen::MatrixXf RandomDirections(Eigen::Index dimension, Eigen::Index count, uint64_t seed) {
  Rng rng(seed);
  Eigen::MatrixXf vectors(dimension, count);
  for (float& value : vectors.reshaped()) value = static_cast<float>(rng.Uniform() - 0.5);
  vectors.colwise().normalize();
  return vectors;
}

struct Data {
  Eigen::MatrixXf queries;
  std::vector<Eigen::MatrixXf> blocks;
};

double BareProducts(const Data& data) {
  const double start = CpuSeconds();
  float sum = 0;
  Eigen::MatrixXf scores;
  for (const Eigen::MatrixXf& block : data.blocks) {
    scores.noalias() = block.transpose() * data.queries;
    sum += scores(0, 0);
  }
  if (sum == 12345) std::abort();  // keeps the products
  return CpuSeconds() - start;
}

double Search(const Data& data, int top_k, RetrievedLists* lists) {
  const double start = CpuSeconds();
  DotProductSearch search(data.queries, top_k);
  for (const Eigen::MatrixXf& block : data.blocks) search.Add(block, 1);
  *lists = search.Best();
  return CpuSeconds() - start;
}

// Of the first queries, against all products in double.
bool AreExact(const Data& data, const RetrievedLists& lists) {
  for (Eigen::Index q = 0; q < std::min<Eigen::Index>(20, data.queries.cols()); ++q) {
    std::vector<std::pair<double, int>> all;
    int index = 0;
    for (const Eigen::MatrixXf& block : data.blocks) {
      const Eigen::VectorXd scores =
          block.cast<double>().transpose() * data.queries.col(q).cast<double>();
      for (const double score : scores) all.emplace_back(-score, index++);
    }
    std::sort(all.begin(), all.end());
    const auto& list = lists[static_cast<size_t>(q)];
    for (size_t rank = 0; rank < list.size(); ++rank) {
      if (list[rank].reference_index != all[rank].second) return false;
    }
  }
  return true;
}

void Run(Eigen::Index references, Eigen::Index queries, Eigen::Index dimension, int top_k,
         int rounds) {
  Data data{RandomDirections(dimension, queries, 1), {}};
  for (Eigen::Index first = 0; first < references; first += kBlock) {
    data.blocks.push_back(RandomDirections(dimension, std::min(kBlock, references - first),
                                           static_cast<uint64_t>(first) + 2));
  }
  RetrievedLists lists;
  std::vector<double> bare, search, ratios;
  for (int round = 0; round < rounds; ++round) {
    bare.push_back(BareProducts(data));
    search.push_back(Search(data, top_k, &lists));
    ratios.push_back(search.back() / bare.back());
  }
  const double operations = 2e-9 * static_cast<double>(references) * static_cast<double>(queries) *
                            static_cast<double>(dimension);
  std::printf("%td references x %td queries x %td numbers, the best %d, %d rounds, one thread\n",
              references, queries, dimension, top_k, rounds);
  std::printf("%-24s %8s %10s\n", "", "CPU s", "GFLOP/s");
  std::printf("%-24s %8.2f %10.1f\n", "bare products", UpperMedianOr(bare, 0),
              operations / UpperMedianOr(bare, 0));
  std::printf("%-24s %8.2f %10.1f\n", "Raylift, ranked", UpperMedianOr(search, 0),
              operations / UpperMedianOr(search, 0));
  std::printf("ratio %.3f; agrees with products in double: %s\n", UpperMedianOr(ratios, 0),
              AreExact(data, lists) ? "yes" : "NO");
}

}  // namespace
}  // namespace raylift

int main(int argc, char** argv) {
  const auto argument = [&](int i, int value) { return argc > i ? std::atoi(argv[i]) : value; };
  raylift::Run(argument(1, 20000), argument(2, 500), argument(3, 4096), argument(4, 50),
               argument(5, 3));
}
