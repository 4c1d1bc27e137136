#include <algorithm>
#include <cmath>

#include "base/rng.h"
#include "support/matchers.h"
#include <opencv2/core/utility.hpp>

#include "raylift/base/parallel.h"
#include "raylift/features/local_features.h"

namespace raylift {
namespace {

Image GrayImage(int width_px, int height_px, uint8_t value) {
  Image image{.width_px = width_px, .height_px = height_px, .channels = 1, .data = {}};
  image.data.assign(static_cast<size_t>(width_px) * height_px, value);
  return image;
}

// Adds a bright Gaussian blob; the center is in our pixels (the first pixel's center is (0.5,
// 0.5)).
void AddBlob(const Eigen::Vector2d& center_px, double sigma_px, double height, Image& image) {
  const double radius_px = 5 * sigma_px;
  const auto first = [&](double c) { return std::max(0, static_cast<int>(c - radius_px)); };
  const int last_x = std::min(image.width_px - 1, static_cast<int>(center_px.x() + radius_px));
  const int last_y = std::min(image.height_px - 1, static_cast<int>(center_px.y() + radius_px));
  for (int y = first(center_px.y()); y <= last_y; ++y) {
    for (int x = first(center_px.x()); x <= last_x; ++x) {
      const double squared_distance = (Eigen::Vector2d(x + 0.5, y + 0.5) - center_px).squaredNorm();
      const double value =
          *image.Pixel(x, y) + height * std::exp(-0.5 * squared_distance / (sigma_px * sigma_px));
      *image.Pixel(x, y) = static_cast<uint8_t>(std::clamp(std::lround(value), 0l, 255l));
    }
  }
}

// Blobs of random sizes all over: a picture with a few hundred features.
Image RandomPicture(Rng& rng, int width_px, int height_px) {
  Image image = GrayImage(width_px, height_px, 90);
  const int num_blobs = width_px * height_px / 300;
  for (int i = 0; i < num_blobs; ++i) {
    const Eigen::Vector2d center_px(rng.Uniform(0, width_px), rng.Uniform(0, height_px));
    AddBlob(center_px, rng.Uniform(1, 5), rng.Uniform(-80, 120), image);
  }
  return image;
}

struct Localization {
  Eigen::Vector2d mean_error_px = Eigen::Vector2d::Zero();
  int found = 0;
  int blobs = 0;
};

// The mean distance of the features from the blobs they show, for a grid of separate blobs at
// random places between the pixels.
Localization LocalizeBlobs(Rng& rng, double sigma_px, int width_px, int height_px,
                           const RootSiftOptions& options) {
  Image image = GrayImage(width_px, height_px, 60);
  std::vector<Eigen::Vector2d> centers_px;
  const int step_px = static_cast<int>(8 * sigma_px) + 12;
  for (int y = step_px; y < height_px - step_px; y += step_px) {
    for (int x = step_px; x < width_px - step_px; x += step_px) {
      centers_px.emplace_back(x + rng.Uniform(0, 1), y + rng.Uniform(0, 1));
      AddBlob(centers_px.back(), sigma_px, 150, image);
    }
  }
  Localization result;
  result.blobs = static_cast<int>(centers_px.size());
  const Features features = ExtractRootSift(image, options);
  for (const Eigen::Vector2d& center_px : centers_px) {
    // The strongest nearby; its other orientations are at the same place.
    for (const Eigen::Vector2d& keypoint_px : features.keypoints_px) {
      if ((keypoint_px - center_px).norm() < sigma_px) {
        result.mean_error_px += keypoint_px - center_px;
        ++result.found;
        break;
      }
    }
  }
  result.mean_error_px /= std::max(1, result.found);
  return result;
}

TEST(RootSift, KeypointsHaveNoBias) {
  Rng rng = TestRng();
  for (const double sigma_px : {1.2, 1.6, 2.0, 2.5, 3.0, 4.0}) {
    const Localization result = LocalizeBlobs(rng, sigma_px, 640, 480, {});
    EXPECT_GT(result.found, 0.95 * result.blobs) << sigma_px;
    // Single blobs are found to 0.02 px; the means are of 100 or more. OpenCV's own shift is 0.25.
    EXPECT_LT(result.mean_error_px.cwiseAbs().maxCoeff(), 0.01) << sigma_px;
  }
}

TEST(RootSift, KeypointsOfShrunkImagesHaveNoBias) {
  Rng rng = TestRng();
  // 1001 x 777 becomes 600 x 466: neither ratio is round, and they differ.
  const Localization result = LocalizeBlobs(rng, 4, 1001, 777, {.max_image_side_px = 600});
  EXPECT_GT(result.found, 0.95 * result.blobs);
  EXPECT_LT(result.mean_error_px.cwiseAbs().maxCoeff(), 0.03);
}

TEST(RootSift, DescriptorsHaveUnitLength) {
  Rng rng = TestRng();
  const Features features = ExtractRootSift(RandomPicture(rng, 320, 240));
  ASSERT_GT(features.keypoints_px.size(), 50u);
  EXPECT_EQ(features.descriptors.rows(), 128);
  EXPECT_EQ(features.descriptors.cols(), static_cast<int>(features.keypoints_px.size()));
  EXPECT_EQ(features.scores.size(), features.keypoints_px.size());
  EXPECT_EQ(features.image_width_px, 320);
  EXPECT_EQ(features.image_height_px, 240);
  EXPECT_GE(features.descriptors.minCoeff(), 0);
  for (const auto descriptor : features.descriptors.colwise()) {
    EXPECT_NEAR(descriptor.norm(), 1, 1e-5);
  }
}

TEST(RootSift, KeepsTheStrongest) {
  Rng rng = TestRng();
  const Image picture = RandomPicture(rng, 320, 240);
  const Features all = ExtractRootSift(picture);
  EXPECT_TRUE(std::is_sorted(all.scores.rbegin(), all.scores.rend()));
  const Features few = ExtractRootSift(picture, {.max_features = 20});
  ASSERT_EQ(few.keypoints_px.size(), 20u);
  for (size_t i = 0; i < 20; ++i) {
    EXPECT_EQ(few.keypoints_px[i], all.keypoints_px[i]);
    EXPECT_EQ(few.descriptors.col(i), all.descriptors.col(i));
  }
}

TEST(RootSift, GivesTheSameForAnyThreadCount) {
  Rng rng = TestRng();
  std::vector<Image> pictures;
  for (int i = 0; i < 6; ++i) pictures.push_back(RandomPicture(rng, 200, 160));
  const auto extract = [&](int threads) {
    std::vector<Features> features(pictures.size());
    ParallelFor(pictures.size(), threads,
                [&](size_t i) { features[i] = ExtractRootSift(pictures[i]); });
    return features;
  };
  const std::vector<Features> one = extract(1);
  const std::vector<Features> four = extract(4);
  for (size_t i = 0; i < pictures.size(); ++i) {
    EXPECT_EQ(one[i].keypoints_px, four[i].keypoints_px);
    EXPECT_EQ(one[i].scores, four[i].scores);
    EXPECT_EQ(one[i].descriptors, four[i].descriptors);
  }
}

TEST(RootSift, NeitherNeedsNorSetsOpenCvsThreads) {
  Rng rng = TestRng();
  const Image picture = RandomPicture(rng, 640, 480);
  const int before = cv::getNumThreads();
  cv::setNumThreads(1);
  const Features one = ExtractRootSift(picture);
  cv::setNumThreads(3);
  const Features three = ExtractRootSift(picture);
  EXPECT_EQ(cv::getNumThreads(), 3);
  cv::setNumThreads(before);
  EXPECT_EQ(one.keypoints_px, three.keypoints_px);
  EXPECT_EQ(one.scores, three.scores);
  EXPECT_EQ(one.descriptors, three.descriptors);
}

TEST(RootSift, FindsNothingInEmptyFlatOrTinyImages) {
  EXPECT_TRUE(ExtractRootSift(Image{}).keypoints_px.empty());
  EXPECT_TRUE(ExtractRootSift(GrayImage(100, 80, 128)).keypoints_px.empty());
  Rng rng = TestRng();
  for (int width_px = 1; width_px <= 24; ++width_px) {
    for (const int height_px : {1, 2, 7, 8, 9, 100}) {
      Image noise = GrayImage(width_px, height_px, 0);
      for (uint8_t& value : noise.data) value = static_cast<uint8_t>(rng.UniformIndex(256));
      const Features features = ExtractRootSift(noise);
      EXPECT_EQ(features.descriptors.cols(), static_cast<int>(features.keypoints_px.size()));
    }
  }
  EXPECT_TRUE(ExtractRootSift(RandomPicture(rng, 100, 100), {.max_features = 0}).scores.empty());
}

TEST(RootSift, ShrinksAVeryLongImageToNothingWithoutFailing) {
  EXPECT_TRUE(ExtractRootSift(GrayImage(20000, 10, 7)).keypoints_px.empty());
}

}  // namespace
}  // namespace raylift
