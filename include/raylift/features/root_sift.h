// The built-in local features: SIFT keypoints (Lowe 2004) with RootSIFT descriptors (Arandjelovic
// and Zisserman 2012), that is descriptors divided by their sum, then the square root of each
// value. Their Euclidean distance is the Hellinger distance of the gradient histograms.

#pragma once

#include "raylift/scene/features.h"
#include "raylift/scene/image.h"

namespace raylift {

struct RootSiftOptions {
  // The best by contrast are kept.
  int max_features = 4096;
  // A larger image is shrunk (by area averaging) until its longer side has this many pixels; the
  // keypoints are given in the original's pixels all the same.
  int max_image_side_px = 1600;
  // Least contrast of a keypoint as OpenCV counts it (default there 0.04; COLMAP's default is 0.02
  // in these units). Weak keypoints matter where texture is scarce: a pair of indoor photographs of
  // 640 x 480 got 117 correct matches against 67 with 0.04, for 76 % correct against 79 %.
  double contrast_threshold = 0.01;
};

// Features of a gray image, the strongest first; a keypoint with several dominant orientations
// appears once for each. Scores are the contrasts. No features in an empty or tiny image.
//
// The result does not depend on threads: run it for many images at once (ParallelFor). OpenCV uses
// threads of its own within each image unless the program tells it not to, once and for all, by
// cv::setNumThreads(1); that is faster where there are many images, as in the program `raylift`.
Features ExtractRootSift(const Image& gray, const RootSiftOptions& options = {});

}  // namespace raylift
