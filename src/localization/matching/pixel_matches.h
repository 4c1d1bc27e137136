// Matches of a query that are pixels of pairs of images, whose features nobody knows: of files, or
// of a matcher of one's own.

#pragma once

#include <filesystem>
#include <string>

#include "raylift/geometry/camera.h"
#include "raylift/localization/match_source.h"
#include "raylift/scene/image.h"
#include "raylift/scene/keypoints.h"

namespace raylift {

// Returns whether an image of this size has the pixel, or one that rounding moved out of it.
bool Shows(PlaneSize size, const Eigen::Vector2d& pixel);

struct InsideMatches {
  PixelMatches matches;  // pixels are COLMAP's
  size_t outside = 0;
};

class QueryPixels {
 public:
  QueryPixels(const Query& query, const MatchReading& reading) : query_(query), reading_(reading) {}

  // Returns the matches whose score is high enough and which lie inside of both images. Throws
  // InputError that names `source` where most lie outside, as those of resized images do.
  InsideMatches Inside(const PixelMatches& given, const std::string& reference,
                       const Camera& reference_camera, const std::filesystem::path& source) const;

  // Adds the matches with the reference of this rank to the result. Equal pixels of the query are
  // one keypoint, whatever reference they are matched with, or those in one cell.
  void Add(const PixelMatches& matches, int rank, QueryMatches* result);

 private:
  Eigen::Vector2d PlaceOf(const Eigen::Vector2d& query_px) const;

  const Query& query_;
  const MatchReading& reading_;
  KeypointsByPixel keypoints_;
  int next_keypoint_ = 0;
};

}  // namespace raylift
