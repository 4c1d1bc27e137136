// Estimates the factor by which each map's depth is off, and its uncertainty, from the matches
// between references, and where these do not determine it, from the scene's other maps.
//
// Where the rays of a match meet says that the map's depth is off by r = ln(z met / z). If the log
// factor is a, the match lies d = g (1 - e^(r - a)) pixels from where the map has it, g being the
// pixels per unit of ln z, as inverse depth moves a projection evenly. With noise s of keypoints
// and t of a map's depths from place to place,
//
//   p(match | a) = w N(d; 0, s^2 + (g e^(r - a) t)^2) + (1 - w) / extent
//
// where w, the share of right matches, is unknown. Matches of one place of the map with one
// reference show one surface and count as one, their median. Those of a patch of some places have
// a drift u of the map's depth in common, and may be wrong together, as those of a facade with one
// like it are; they then agree on a factor that is anything:
//
//   p(patch | a) = (1 - e) mean over u of prod p(match | a + u)
//                  + e mean over b of prod p(match | b)
//
// u being N(0, t^2). Just so all patches of a pair of images may be wrong together:
//
//   p(pair | a) = (1 - e) prod p(patch | a) + e mean over b of prod p(patch | b)
//
// which bounds what one patch and one pair can say. The log factors of a scene's maps are
// N(m, o^2), of which m and o are averaged over by what the other maps say.

#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "raylift/geometry/camera.h"

namespace raylift {

// An image's side is divided into so many places, and that of a patch holds so many.
inline constexpr int kPlacesPerSide = 16;
inline constexpr int kPlacesPerPatchSide = 4;

// Returns the place of a map's image that a pixel is in, below kPlacesPerSide^2, row by row.
int PlaceOf(const Eigen::Vector2d& pixel, const Camera& camera);

struct FactorMatch {
  int other;          // reference
  int place;          // of the map's image, below kPlacesPerSide^2
  double log_factor;  // r
  double gain_px;     // g
};

struct MapMatches {
  std::vector<FactorMatch> matches;
  double extent_px = 1;  // of the other images: how far off a wrong match may lie
};

struct FactorBelief {
  double log_factor = 0;  // median, and deviation by the quartiles
  double sigma = 0;
  size_t num_independent = 0;  // matches that show different places and are not misled
  // The map's own matches determine its factor better than the other maps do, or as well as its
  // places agree.
  bool is_own = false;
  std::vector<int> misled;  // references whose matches are rather wrong together
};

struct FactorBeliefs {
  std::vector<FactorBelief> of_map;
  bool all_right = true;  // the matches are as likely if no map has a factor
};

// Estimates the factors. `keypoint_sigma_px` is the noise of matches across the epipolar lines.
FactorBeliefs BelieveFactors(std::span<const MapMatches> maps, double keypoint_sigma_px,
                             int threads);

}  // namespace raylift
