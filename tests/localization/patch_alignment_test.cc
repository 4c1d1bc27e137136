#include <cmath>

#include "localization/rerender.h"
#include <gtest/gtest.h>

namespace raylift {
namespace {

// A smooth texture without repetition, moved and at any contrast.
Image Texture(int width_px, int height_px, double scale, const Eigen::Vector2d& shift_px,
              double contrast) {
  Image image{.width_px = width_px, .height_px = height_px, .channels = 1, .data = {}};
  for (int y = 0; y < height_px; ++y) {
    for (int x = 0; x < width_px; ++x) {
      const double u = (x + 0.5) / scale - shift_px.x();
      const double v = (y + 0.5) / scale - shift_px.y();
      const double value = std::sin(0.31 * u + 2 * std::sin(0.07 * v)) +
                           std::sin(0.29 * v + 2 * std::sin(0.05 * u)) +
                           std::sin(0.011 * u * v / 9 + 0.17 * (u + v));
      image.data.push_back(NearestByte(128 + contrast * value));
    }
  }
  return image;
}

Image Everything(int width_px, int height_px) {
  const size_t count = static_cast<size_t>(width_px) * static_cast<size_t>(height_px);
  return {width_px, height_px, 1, std::vector<uint8_t>(count, 255)};
}

double RootMeanSquare(const std::vector<PatchMatch>& matches, const Eigen::Vector2d& shift_px) {
  double sum = 0;
  for (const PatchMatch& match : matches) {
    sum += (match.photograph_px - match.rendering_px - shift_px).squaredNorm();
  }
  return std::sqrt(sum / static_cast<double>(matches.size()));
}

TEST(PatchAlignment, TellsFractionsOfAPixelAtAnyContrast) {
  const Image rendering = Texture(320, 240, 1, {0, 0}, 20);
  const Eigen::Vector2d shift_px(2.3, -1.6);
  const auto matches =
      AlignPatches(Texture(320, 240, 1, shift_px, 40), rendering, Everything(320, 240));
  EXPECT_GT(matches.size(), 50u);
  // A quadratic is not the peak's true shape.
  EXPECT_LT(RootMeanSquare(matches, shift_px), 0.1);
}

TEST(PatchAlignment, GivesPixelsOfTheLargerPhotograph) {
  const Image rendering = Texture(320, 240, 1, {0, 0}, 40);
  const auto matches =
      AlignPatches(Texture(640, 480, 2, {1, 0.5}, 40), rendering, Everything(320, 240));
  ASSERT_GT(matches.size(), 50u);
  for (const PatchMatch& match : matches) {
    const Eigen::Vector2d expected = 2 * (match.rendering_px + Eigen::Vector2d(1, 0.5));
    EXPECT_LT((match.photograph_px - expected).norm(), 0.5);
  }
}

TEST(PatchAlignment, HoldsNoPixelOutsideTheMask) {
  const Image rendering = Texture(320, 240, 1, {0, 0}, 40);
  Image mask = Everything(320, 240);
  for (int y = 0; y < 240; ++y) {
    for (int x = 150; x < 170; ++x) *mask.Pixel(x, y) = 0;
  }
  const auto matches = AlignPatches(rendering, rendering, mask);
  ASSERT_GT(matches.size(), 30u);
  for (const PatchMatch& match : matches) {
    EXPECT_GT(std::abs(match.rendering_px.x() - 160), 10 + 320.0 / 40);
  }
}

TEST(PatchAlignment, FindsNothingInWhatIsElsewhere) {
  const Image rendering = Texture(320, 240, 1, {0, 0}, 40);
  // Further off than it is looked for, and without any texture.
  EXPECT_LT(
      AlignPatches(Texture(320, 240, 1, {500, 700}, 40), rendering, Everything(320, 240)).size(),
      AlignPatches(rendering, rendering, Everything(320, 240)).size() / 4);
  EXPECT_TRUE(AlignPatches(Everything(320, 240), rendering, Everything(320, 240)).empty());
  EXPECT_TRUE(AlignPatches(rendering, Everything(320, 240), Everything(320, 240)).empty());
}

}  // namespace
}  // namespace raylift
