#include "support/room_scene.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/io/hloc_files.h"
#include "raylift/io/query_list.h"
#include "raylift/localization/match_source.h"
#include "raylift/localization/scene.h"
#include "raylift/scene/keypoints.h"

namespace raylift {
namespace {

TEST(FrontEndMatches, KeypointsAreTheFeaturesAndSeveralAtOnePlaceAreTheFirst) {
  const RoomScene scene = WriteRoomScene(TestFolder(), {.matches = false, .pictures = true});
  const std::vector<Query> queries = ReadQueryList(scene.query_list());
  const auto source = MakeFrontEndMatches({.reference_images = scene.images(),
                                           .query_images = scene.images(),
                                           .cache = scene.folder / "cache",
                                           .top_k = 3,
                                           .max_features = 800,
                                           .show_progress = false},
                                          LoadReferences(scene.model(), 1).references, queries);
  const FeatureFile features(scene.folder / "cache" / "features.h5");
  const QueryMatches matches = source->Match(queries[0]);
  ASSERT_EQ(matches.references.size(), 3u);
  ASSERT_GT(matches.matches.size(), 100u);
  const auto expect_keypoint = [](const Features& of_image, std::optional<int> keypoint,
                                  const Eigen::Vector2d& pixel) {
    ASSERT_TRUE(keypoint);
    EXPECT_EQ(of_image.keypoints_px.at(static_cast<size_t>(*keypoint)), pixel);
    EXPECT_EQ(CanonicalKeypoints(of_image.keypoints_px)[static_cast<size_t>(*keypoint)], *keypoint);
  };
  const Features of_query = features.Read(queries[0].name);
  std::vector<Features> of_references;
  for (const PosedImage& reference : matches.references) {
    of_references.push_back(features.Read(reference.name));
  }
  for (const Match2D2D& match : matches.matches) {
    expect_keypoint(of_query, match.query_keypoint, match.query_px);
    expect_keypoint(of_references[static_cast<size_t>(match.reference)], match.reference_keypoint,
                    match.reference_px);
  }
}

}  // namespace
}  // namespace raylift
