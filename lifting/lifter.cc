#include "raylift/lifting/lifter.h"

#include "raylift/base/error.h"

namespace raylift {
namespace {

// One per match; none where the source has no surface, or where the match was not asked for.
using PointPerMatch = std::vector<std::optional<SurfacePoint>>;

std::vector<std::vector<size_t>> GroupByReference(std::span<const Match2D2D> matches,
                                                  size_t num_references) {
  std::vector<std::vector<size_t>> groups(num_references);
  for (size_t i = 0; i < matches.size(); ++i) {
    const int reference = matches[i].reference;
    RAYLIFT_CHECK(reference >= 0 && static_cast<size_t>(reference) < num_references);
    groups[static_cast<size_t>(reference)].push_back(i);
  }
  return groups;
}

// Lifts those of the matches, all of one reference, that are asked for.
void LiftReference(const GeometrySource& source, const PosedImage& reference,
                   std::span<const Match2D2D> matches, const std::vector<size_t>& asked,
                   PointPerMatch& points) {
  if (asked.empty()) return;
  std::vector<Eigen::Vector2d> pixels;
  pixels.reserve(asked.size());
  for (const size_t i : asked) pixels.push_back(matches[i].reference_px);
  const auto lifted = source.Lift(reference, pixels);
  RAYLIFT_CHECK_EQ(lifted.size(), pixels.size());
  for (size_t k = 0; k < asked.size(); ++k) points[asked[k]] = lifted[k];
}

std::vector<PointPerMatch> LiftBySource(std::span<const GeometrySource* const> sources,
                                        GeometryMode mode, std::span<const PosedImage> references,
                                        std::span<const Match2D2D> matches) {
  std::vector<std::vector<size_t>> asked = GroupByReference(matches, references.size());
  std::vector<PointPerMatch> points_of_source;
  for (const GeometrySource* source : sources) {
    PointPerMatch& points = points_of_source.emplace_back(matches.size());
    for (size_t r = 0; r < references.size(); ++r) {
      LiftReference(*source, references[r], matches, asked[r], points);
      if (mode == GeometryMode::kFirst) {
        std::erase_if(asked[r], [&points](size_t i) { return points[i].has_value(); });
      }
    }
  }
  return points_of_source;
}

}  // namespace

LiftResult LiftMatches(std::span<const GeometrySource* const> sources, GeometryMode mode,
                       std::span<const PosedImage> references, std::span<const Match2D2D> matches) {
  const auto points_of_source = LiftBySource(sources, mode, references, matches);
  LiftResult result;
  result.counts.matches = matches.size();
  result.counts.points_of_source.assign(sources.size(), 0);
  for (size_t i = 0; i < matches.size(); ++i) {
    const size_t before = result.lifted.size();
    for (size_t s = 0; s < sources.size(); ++s) {
      const auto& surface = points_of_source[s][i];
      if (!surface) continue;
      ++result.counts.points_of_source[s];
      result.counts.back_faces += surface->back_face ? 1 : 0;
      const Match2D3D match{.query_px = matches[i].query_px,
                            .point_in_world = surface->point_in_world,
                            .reference = matches[i].reference,
                            .point_sigma = surface->point_sigma,
                            .query_keypoint = matches[i].query_keypoint,
                            .match_2d2d = i,
                            .camera = matches[i].camera};
      result.lifted.push_back({match, *surface, s});
    }
    ++(result.lifted.size() > before ? result.counts.hits : result.counts.misses);
  }
  return result;
}

LiftResult LiftMatches(const GeometrySource& source, std::span<const PosedImage> references,
                       std::span<const Match2D2D> matches) {
  const GeometrySource* const sources[] = {&source};
  return LiftMatches(sources, GeometryMode::kFirst, references, matches);
}

std::vector<Match2D3D> Matches2D3D(const LiftResult& result) {
  std::vector<Match2D3D> matches;
  matches.reserve(result.lifted.size());
  for (const LiftedMatch& lifted : result.lifted) matches.push_back(lifted.match);
  return matches;
}

}  // namespace raylift
