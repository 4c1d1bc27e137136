#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>
#include <vector>

#include "features/cv_image.h"
#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

#include "raylift/base/error.h"
#include "raylift/features/local_features.h"

namespace raylift {
namespace {

// Below this many pixels a side there is no room for a keypoint (OpenCV leaves 5 pixels at each
// border of the doubled image), and OpenCV's count of octaves gets down to zero.
constexpr int kMinImageSidePx = 8;
// Least contrast of a keypoint as OpenCV counts it (default there 0.04; COLMAP's default is 0.02
// in these units). Weak keypoints matter where texture is scarce: a pair of indoor photographs of
// 640 x 480 got 117 correct matches against 67 with 0.04, for 76 % correct against 79 %.
constexpr double kContrastThreshold = 0.01;

// OpenCV builds the first octave on the image doubled by cv::resize, for which pixel (0, 0) of the
// original lies at (0.5, 0.5) of the doubled one; before version 4.7 (enable_precise_upscale, later
// the only way) it halved the coordinates without taking that off again. So every keypoint is
// 0.25 px too far right and down, at all scales. Measured rather than looked up by version.
double MeasureUpscaleShift() {
  constexpr int kSize = 65;
  constexpr int kCenter = kSize / 2;
  constexpr double kSigma = 3;
  cv::Mat blob(kSize, kSize, CV_8UC1);
  for (int y = 0; y < kSize; ++y) {
    for (int x = 0; x < kSize; ++x) {
      const double squared_distance = (x - kCenter) * (x - kCenter) + (y - kCenter) * (y - kCenter);
      blob.at<uint8_t>(y, x) = static_cast<uint8_t>(
          std::lround(40 + 180 * std::exp(-0.5 * squared_distance / (kSigma * kSigma))));
    }
  }
  std::vector<cv::KeyPoint> keypoints;
  cv::SIFT::create(1)->detect(blob, keypoints);
  RAYLIFT_CHECK(!keypoints.empty());
  return keypoints[0].pt.x - kCenter > 0.125 ? 0.25 : 0;
}

cv::Mat ShrinkToSide(const Image& gray, int max_side_px) {
  cv::Mat full = AsMat(gray);
  const int side_px = std::max(gray.width_px, gray.height_px);
  if (side_px <= max_side_px) {
    return full;
  }
  const double factor = static_cast<double>(max_side_px) / side_px;
  const auto scaled = [&](int length_px) {
    return std::max(1, static_cast<int>(std::lround(length_px * factor)));
  };
  cv::Mat small;
  cv::resize(full, small, {scaled(full.cols), scaled(full.rows)}, 0, 0, cv::INTER_AREA);
  return small;
}

// Returns the features in a fixed order, the strongest first, as OpenCV promises none; further keys
// leave no ties.
std::vector<int> StrongestFirst(const std::vector<cv::KeyPoint>& keypoints) {
  std::vector<int> order(keypoints.size());
  std::iota(order.begin(), order.end(), 0);
  const auto key = [&](int i) {
    const cv::KeyPoint& k = keypoints[i];
    return std::tuple(-k.response, k.pt.y, k.pt.x, k.size, k.angle);
  };
  std::sort(order.begin(), order.end(), [&](int a, int b) { return key(a) < key(b); });
  return order;
}

Eigen::VectorXf RootSift(const cv::Mat& sift_row) {
  const Eigen::Map<const Eigen::VectorXf> sift(sift_row.ptr<float>(), sift_row.cols);
  // The sum of the squares of sqrt(v / sum) is 1: the result has unit length.
  return (sift / std::max(sift.sum(), 1e-12f)).cwiseSqrt();
}

}  // namespace

Features ExtractRootSift(const Image& gray, const RootSiftOptions& options) {
  RAYLIFT_CHECK(gray.channels == 1 || gray.data.empty());
  static const double upscale_shift_px = MeasureUpscaleShift();

  Features features;
  features.image_width_px = gray.width_px;
  features.image_height_px = gray.height_px;
  if (options.max_features <= 0 || std::min(gray.width_px, gray.height_px) < kMinImageSidePx) {
    return features;
  }
  const cv::Mat image = ShrinkToSide(gray, options.max_image_side_px);
  if (std::min(image.cols, image.rows) < kMinImageSidePx) {
    return features;
  }

  std::vector<cv::KeyPoint> keypoints;
  cv::Mat sift;
  cv::SIFT::create(options.max_features, 3, kContrastThreshold)
      ->detectAndCompute(image, cv::noArray(), keypoints, sift);

  const std::vector<int> order = StrongestFirst(keypoints);
  // OpenCV keeps more than asked where the last ones are equally strong.
  const size_t count = std::min(order.size(), static_cast<size_t>(options.max_features));
  const Eigen::Vector2d original_per_image(static_cast<double>(gray.width_px) / image.cols,
                                           static_cast<double>(gray.height_px) / image.rows);
  features.keypoints_px.resize(count);
  features.scores.resize(count);
  features.descriptors.resize(sift.cols, static_cast<Eigen::Index>(count));
  for (size_t i = 0; i < count; ++i) {
    const cv::KeyPoint& keypoint = keypoints[order[i]];
    // From OpenCV's pixels, the first one's center at (0, 0), to ours.
    const Eigen::Vector2d pixel =
        Eigen::Vector2d(keypoint.pt.x, keypoint.pt.y).array() + (0.5 - upscale_shift_px);
    features.keypoints_px[i] = pixel.cwiseProduct(original_per_image);
    features.scores[i] = keypoint.response;
    features.descriptors.col(static_cast<Eigen::Index>(i)) = RootSift(sift.row(order[i]));
  }
  return features;
}

}  // namespace raylift
