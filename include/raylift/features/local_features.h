// The built-in local features and their matcher.

#pragma once

#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "raylift/scene/features.h"
#include "raylift/scene/image.h"

namespace raylift {

// The built-in local features: SIFT keypoints (Lowe 2004) with RootSIFT descriptors (Arandjelovic
// and Zisserman 2012), that is descriptors divided by their sum, then the square root of each
// value. Their Euclidean distance is the Hellinger distance of the gradient histograms.

struct RootSiftOptions {
  // The features of the highest contrast are kept.
  int max_features = 4096;
  // A larger image is shrunk (by area averaging) until its longer side has this many pixels; the
  // keypoints are given in the original's pixels all the same.
  int max_image_side_px = 1600;
};

// Extracts the features of a gray image, the strongest first; a keypoint with several dominant
// orientations appears once for each. Scores are the contrasts. An empty or tiny image has none.
//
// The result does not depend on threads: run it for many images at once (ParallelFor). OpenCV uses
// threads of its own within each image unless the program tells it not to, once and for all, by
// cv::setNumThreads(1); that is faster where there are many images, as in the program `raylift`.
Features ExtractRootSift(const Image& gray, const RootSiftOptions& options = {});

// Matches the features of a query and a reference: those that are each other's nearest neighbors by
// descriptor, where the nearest is clearly nearer than the runner-up.

struct MatchOptions {
  // Lowe's ratio test: the distance from the query's descriptor to its nearest neighbor is below
  // this share of the distance to the second nearest. 1: no such test.
  double max_ratio = 0.8;
};

// Returns matches in the order of the query's features; features at equal pixels (one place with
// several orientations) give at most one match between the same two pixels. Descriptors are
// compared by their directions (their lengths do not matter); the score is (1 + cosine) / 2, as
// hloc's. There are none where either image has no descriptors. Throws InputError if the two have
// descriptors of different sizes.
//
// The result is the same on every machine: distances come from exact integer products of
// descriptors rounded to 16 bits. Runs on the calling thread alone; run pairs in parallel.
std::vector<FeatureMatch> MatchMutualNearest(const Features& query, const Features& reference,
                                             const MatchOptions& options = {});

// Where in a query a keypoint of a reference is looked for: within three standard deviations.
struct SearchRegion {
  Eigen::Vector2d center_px;
  Eigen::Matrix2d covariance_px2;

  double AreaPx2() const;
};

// Matches features where it is known where in the query each of the reference's is to be expected:
// of the matches above those that lie there, and besides each feature's nearest one in its region,
// where so few of all N of the query's features are nearer that chance would not have it: with n of
// them in the region and r nearer ones elsewhere, 1 - (1 - n / N)^(r + 1) < .05. A feature of the
// query has one such match at most; those of the reference without a region have none.
std::vector<FeatureMatch> MatchWithin(std::span<const std::optional<SearchRegion>> regions,
                                      const Features& query, const Features& reference,
                                      const MatchOptions& options = {});

}  // namespace raylift
