#include "localization/matching/pixel_matches.h"

#include <algorithm>

#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {

bool Shows(PlaneSize size, const Eigen::Vector2d& pixel) {
  constexpr double kRoundingPx = 1;
  return pixel.x() >= -kRoundingPx && pixel.x() <= size.width_px + kRoundingPx &&
         pixel.y() >= -kRoundingPx && pixel.y() <= size.height_px + kRoundingPx;
}

InsideMatches QueryPixels::Inside(const PixelMatches& given, const std::string& reference,
                                  const Camera& reference_camera,
                                  const std::filesystem::path& source) const {
  const Eigen::Vector2d shift = Eigen::Vector2d::Constant(0.5 - reading_.first_pixel);
  const PlaneSize query_size{query_.camera.width_px(), query_.camera.height_px()};
  const PlaneSize reference_size{reference_camera.width_px(), reference_camera.height_px()};
  InsideMatches result;
  for (size_t i = 0; i < given.query_px.size(); ++i) {
    const double score = given.scores.empty() ? 1 : given.scores[i];
    if (reading_.min_score && !(score >= *reading_.min_score)) continue;
    const Eigen::Vector2d query_px = given.query_px[i] + shift;
    const Eigen::Vector2d reference_px = given.reference_px[i] + shift;
    if (!Shows(query_size, query_px) || !Shows(reference_size, reference_px)) {
      ++result.outside;
      continue;
    }
    result.matches.query_px.push_back(query_px);
    result.matches.reference_px.push_back(reference_px);
  }
  // A matcher may see things in the margin that it put round an image, but not everything.
  const size_t inside = result.matches.query_px.size();
  if (result.outside > inside) {
    throw InputError(
        source, fmt::format("{} of {} matches lie outside of {} ({} x {}) or {} ({} x {}): are "
                            "their pixels those of resized images?",
                            result.outside, result.outside + inside, query_.name,
                            query_size.width_px, query_size.height_px, reference,
                            reference_size.width_px, reference_size.height_px));
  }
  return result;
}

void QueryPixels::Add(const PixelMatches& matches, int rank, QueryMatches* result) {
  KeypointsByPixel reference_keypoints;
  for (size_t i = 0; i < matches.query_px.size(); ++i) {
    const int keypoint = keypoints_.FindOrAdd(PlaceOf(matches.query_px[i]), next_keypoint_);
    next_keypoint_ = std::max(next_keypoint_, keypoint + 1);
    result->matches.push_back({.reference = rank,
                               .query_px = matches.query_px[i],
                               .reference_px = matches.reference_px[i],
                               .query_keypoint = keypoint,
                               .reference_keypoint = reference_keypoints.FindOrAdd(
                                   matches.reference_px[i], static_cast<int>(i))});
  }
}

// Returns what a keypoint is told from others by.
Eigen::Vector2d QueryPixels::PlaceOf(const Eigen::Vector2d& query_px) const {
  if (reading_.cell_px == 0) return query_px;
  return (query_px / reading_.cell_px).array().floor();
}

}  // namespace raylift
