#include "raylift/lifting/lifter.h"

#include "raylift/base/error.h"

namespace raylift {

LiftResult LiftMatches(const GeometrySource& geometry, std::span<const PosedImage> references,
                       std::span<const Match2D2D> matches) {
  std::vector<std::vector<size_t>> matches_of_reference(references.size());
  for (size_t i = 0; i < matches.size(); ++i) {
    const int reference = matches[i].reference;
    RAYLIFT_CHECK(reference >= 0 && static_cast<size_t>(reference) < references.size());
    matches_of_reference[static_cast<size_t>(reference)].push_back(i);
  }
  std::vector<std::optional<SurfacePoint>> surface(matches.size());
  for (size_t r = 0; r < references.size(); ++r) {
    std::vector<Eigen::Vector2d> pixels;
    for (const size_t i : matches_of_reference[r]) pixels.push_back(matches[i].reference_px);
    if (pixels.empty()) continue;
    const auto points = geometry.Lift(references[r], pixels);
    RAYLIFT_CHECK_EQ(points.size(), pixels.size());
    for (size_t k = 0; k < points.size(); ++k) surface[matches_of_reference[r][k]] = points[k];
  }
  LiftResult result;
  result.counts.matches = matches.size();
  for (size_t i = 0; i < matches.size(); ++i) {
    if (!surface[i]) {
      ++result.counts.misses;
      continue;
    }
    ++result.counts.hits;
    result.counts.back_faces += surface[i]->back_face ? 1 : 0;
    const Match2D3D match{.query_px = matches[i].query_px,
                          .point_in_world = surface[i]->point_in_world,
                          .reference = matches[i].reference,
                          .point_sigma = std::nullopt};
    result.lifted.push_back({match, *surface[i], i});
  }
  return result;
}

std::vector<Match2D3D> Matches2D3D(const LiftResult& result) {
  std::vector<Match2D3D> matches;
  matches.reserve(result.lifted.size());
  for (const LiftedMatch& lifted : result.lifted) matches.push_back(lifted.match);
  return matches;
}

}  // namespace raylift
