#include "comparison/view_consistency.h"

#include <cmath>

#include "comparison/compared_room.h"
#include <gtest/gtest.h>

namespace raylift {
namespace {

std::vector<ImageConsistency> MeasureAll(const GeometrySource& source, const ComparedRoom& room) {
  const auto overlaps = FindOverlaps(room.truth, room.images, 4, 1);
  std::vector<ImageConsistency> all;
  for (size_t i = 0; i < room.images.size(); ++i) {
    all.push_back(MeasureConsistency(source, room.images, i, overlaps[i]));
  }
  return all;
}

TEST(ViewConsistency, TheTruthAgreesWithItself) {
  const ComparedRoom room;
  for (const ImageConsistency& image : MeasureAll(room.truth, room)) {
    ASSERT_GT(image.count, 500u);
    EXPECT_LT(image.contradicted_percent, 0.5);
    // The rest is hidden behind the boxes.
    EXPECT_GT(image.within_percent[0] + image.behind_percent, 97);
  }
}

TEST(ViewConsistency, ImagesGetTheirScalesUpToTheMean) {
  const ComparedRoom room;
  const std::vector<double> planted = {0.05, -0.03, 0, 0.02, -0.06, 0.02};  // mean 0
  const MapSource source([&](const PosedImage& image) {
    const size_t index = static_cast<size_t>(image.name.back() - '0');
    return PerturbDepth(RenderDepth(*room.caster, image.camera, image.cam_from_world, 1),
                        {.scale = std::exp(planted[index])}, image.name);
  });
  const auto scales = RelativeLogScales(MeasureAll(source, room));
  for (size_t i = 0; i < planted.size(); ++i) {
    ASSERT_TRUE(scales[i].has_value());
    // A wrong scale shows other pixels, too: it is read only to first order.
    EXPECT_NEAR(*scales[i], planted[i], 0.025) << i;
  }
}

TEST(ViewConsistency, TheCommonScaleIsThatWithWhichImagesAgree) {
  const ComparedRoom room;
  for (const double factor : {0.9, 1.0, 1.1}) {
    const MapSource source = room.Perturbed({.scale = factor});
    const auto scale = CommonLogScale(MeasureAll(source, room));
    ASSERT_TRUE(scale.has_value()) << factor;
    EXPECT_NEAR(std::exp(*scale), factor, 0.02);
  }
}

TEST(ViewConsistency, OverlapsAreImagesThatSeeTheSame) {
  ComparedRoom room(3);
  room.images.push_back({"away", room.images[0].camera, LookAt({0, 0, -2}, {0, 0, -4})});
  const auto overlaps = FindOverlaps(room.truth, room.images, 3, 2);
  EXPECT_EQ(overlaps[0].size(), 2u);
  EXPECT_TRUE(overlaps[3].empty());
}

}  // namespace
}  // namespace raylift
