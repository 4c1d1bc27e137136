#include "raylift/lifting/reference_matches.h"

#include <algorithm>
#include <tuple>

namespace raylift {
namespace {

// Orders by query pixel, then by reference.
bool ByKeypoint(const Match2D2D& a, const Match2D2D& b) {
  return std::tuple(a.query_px.x(), a.query_px.y(), a.reference, a.reference_px.x(),
                    a.reference_px.y()) < std::tuple(b.query_px.x(), b.query_px.y(), b.reference,
                                                     b.reference_px.x(), b.reference_px.y());
}

}  // namespace

std::vector<ReferenceMatch> TransitiveMatches(std::span<const Match2D2D> matches) {
  std::vector<Match2D2D> sorted(matches.begin(), matches.end());
  std::sort(sorted.begin(), sorted.end(), ByKeypoint);
  std::vector<ReferenceMatch> pairs;
  for (size_t begin = 0, end = 0; begin < sorted.size(); begin = end) {
    while (end < sorted.size() && sorted[end].query_px == sorted[begin].query_px) ++end;
    for (size_t a = begin; a < end; ++a) {
      for (size_t b = a + 1; b < end; ++b) {
        if (sorted[a].reference == sorted[b].reference) continue;
        pairs.push_back({sorted[a].reference, sorted[b].reference, sorted[a].reference_px,
                         sorted[b].reference_px});
      }
    }
  }
  return pairs;
}

std::vector<std::vector<HalfMatch>> HalvesByReference(std::span<const ReferenceMatch> matches,
                                                      size_t num_references) {
  std::vector<std::vector<HalfMatch>> halves(num_references);
  for (const ReferenceMatch& m : matches) {
    halves[static_cast<size_t>(m.reference_a)].push_back({m.a_px, m.reference_b, m.b_px});
    halves[static_cast<size_t>(m.reference_b)].push_back({m.b_px, m.reference_a, m.a_px});
  }
  return halves;
}

}  // namespace raylift
