#include "localization/scene_matches.h"

#include <algorithm>
#include <numeric>
#include <string>
#include <tuple>
#include <unordered_map>

#include "base/index_sets.h"

#include "raylift/base/parallel.h"

namespace raylift {
namespace {

auto KeyOf(const ReferenceMatch& m) {
  return std::tuple(m.reference_a, m.reference_b, m.a_px.x(), m.a_px.y(), m.b_px.x(), m.b_px.y());
}

// The same whichever of the two was the query.
ReferenceMatch MatchOf(int a, const Eigen::Vector2d& a_px, int b, const Eigen::Vector2d& b_px) {
  if (a < b) return {a, b, a_px, b_px};
  return {b, a, b_px, a_px};
}

void SortAndDropRepeated(std::vector<ReferenceMatch>& matches) {
  std::sort(matches.begin(), matches.end(),
            [](const ReferenceMatch& a, const ReferenceMatch& b) { return KeyOf(a) < KeyOf(b); });
  const auto end = std::unique(
      matches.begin(), matches.end(),
      [](const ReferenceMatch& a, const ReferenceMatch& b) { return KeyOf(a) == KeyOf(b); });
  matches.erase(end, matches.end());
}

}  // namespace

std::vector<size_t> SampleByName(std::span<const Query> queries, size_t count) {
  std::vector<size_t> sorted(queries.size());
  std::iota(sorted.begin(), sorted.end(), size_t{0});
  std::sort(sorted.begin(), sorted.end(),
            [&](size_t a, size_t b) { return queries[a].name < queries[b].name; });
  std::vector<size_t> sample;
  for (const size_t i : EvenlySpaced(sorted.size(), count)) sample.push_back(sorted[i]);
  return sample;
}

std::vector<ReferenceMatch> CollectReferenceMatches(std::span<const Query> queries,
                                                    const MatchSource& match_source,
                                                    const ReferenceSet& references, int threads,
                                                    size_t enough) {
  std::unordered_map<std::string, int> index_of_name;
  for (size_t i = 0; i < references.images.size(); ++i) {
    index_of_name.emplace(references.images[i].name, static_cast<int>(i));
  }
  std::vector<size_t> count(references.images.size(), 0);
  std::vector<ReferenceMatch> collected;
  // Queries in batches: matched in parallel, taken in order.
  constexpr size_t kBatch = 64;
  for (size_t begin = 0; begin < queries.size(); begin += kBatch) {
    const auto batch = queries.subspan(begin, std::min(kBatch, queries.size() - begin));
    std::vector<std::vector<ReferenceMatch>> found(batch.size());
    ParallelFor(batch.size(), threads, [&](size_t i) {
      const QueryMatches matches = match_source.Match(batch[i]);
      const auto index_of = [&](int reference) {
        return index_of_name.at(matches.references[static_cast<size_t>(reference)].name);
      };
      if (const auto query = index_of_name.find(batch[i].name); query != index_of_name.end()) {
        for (const Match2D2D& m : matches.matches) {
          const int reference = index_of(m.reference);
          if (reference == query->second) continue;
          found[i].push_back(MatchOf(query->second, m.query_px, reference, m.reference_px));
        }
        return;
      }
      found[i] = TransitiveMatches(matches.matches);
      for (ReferenceMatch& m : found[i]) {
        m.reference_a = index_of(m.reference_a);
        m.reference_b = index_of(m.reference_b);
      }
      std::erase_if(found[i],
                    [](const ReferenceMatch& m) { return m.reference_a == m.reference_b; });
    });
    for (const auto& of_query : found) {
      const std::vector<size_t> before = count;
      for (const ReferenceMatch& m : of_query) {
        const auto a = static_cast<size_t>(m.reference_a);
        const auto b = static_cast<size_t>(m.reference_b);
        if (before[a] >= enough && before[b] >= enough) continue;
        collected.push_back(m);
        ++count[a];
        ++count[b];
      }
    }
  }
  SortAndDropRepeated(collected);
  return collected;
}

}  // namespace raylift
