#include "localization/continuous/continuous_localizer.h"
#include "support/matchers.h"
#include <gtest/gtest.h>

namespace raylift {
namespace {

std::vector<Query> QueriesNamed(const std::vector<std::string>& names) {
  std::vector<Query> queries;
  for (const std::string& name : names) queries.push_back({name, Camera()});
  return queries;
}

std::vector<PosedImage> ReferencesNamed(const std::vector<std::string>& names) {
  std::vector<PosedImage> references;
  for (const std::string& name : names) references.push_back({name, Camera(), Rigid3()});
  return references;
}

std::vector<std::string> InOrder(const std::vector<Query>& queries,
                                 const std::vector<size_t>& order) {
  std::vector<std::string> names;
  for (const size_t i : order) names.push_back(queries[i].name);
  return names;
}

using Names = std::vector<std::string>;

TEST(ContinuousOrder, OlderQueriesGoBackwardsInTimeAndThenTheOthersForwards) {
  const auto queries = QueriesNamed({"at50", "at5", "at15", "at8", "at31", "at1"});
  const auto references = ReferencesNamed({"ref30", "ref10", "ref20"});
  const CaptureTimes times = {{"at50", 50},  {"at5", 5},    {"at15", 15},
                              {"at8", 8},    {"at31", 31},  {"at1", 1},
                              {"ref10", 10}, {"ref20", 20}, {"ref30", 30}};
  EXPECT_EQ(InOrder(queries, OrderByTime(queries, references, times, "times.txt")),
            (Names{"at8", "at5", "at1", "at15", "at31", "at50"}));
}

TEST(ContinuousOrder, WithoutTimesOfReferencesQueriesGoForwards) {
  const auto queries = QueriesNamed({"b", "c", "a"});
  const CaptureTimes times = {{"a", -3}, {"b", 2.5}, {"c", 1}, {"thinned out", -9}};
  EXPECT_EQ(InOrder(queries, OrderByTime(queries, ReferencesNamed({"ref"}), times, "times.txt")),
            (Names{"a", "c", "b"}));
}

TEST(ContinuousOrder, QueriesOfOneTimeGoByName) {
  const auto queries = QueriesNamed({"c", "a", "d", "b"});
  const CaptureTimes times = {{"a", 1}, {"b", 1}, {"c", 1}, {"d", 0}, {"ref", 5}};
  EXPECT_EQ(InOrder(queries, OrderByTime(queries, ReferencesNamed({"ref"}), times, "times.txt")),
            (Names{"a", "b", "c", "d"}));
}

TEST(ContinuousOrder, AnOrderByNameNeedsNoTimes) {
  const auto queries = QueriesNamed({"q/10", "q/02", "p/30"});
  EXPECT_EQ(InOrder(queries, OrderByName(queries)), (Names{"p/30", "q/02", "q/10"}));
}

TEST(ContinuousOrder, AQueryWithoutATimeIsNamed) {
  EXPECT_TRUE(FailsWithInputError(
      [] {
        OrderByTime(QueriesNamed({"a"}), {}, {{"b", 1}}, "times.txt");
      },
      {"times.txt", "\"a\""}));
}

}  // namespace
}  // namespace raylift
