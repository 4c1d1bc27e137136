#include "support/room_scene.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/io/hloc_files.h"
#include "raylift/io/image_file.h"
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
                                          LoadReferences(scene.model()).references, queries);
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

// A matcher of one's own sees the files of what was retrieved, and pixels where they are in memory.
TEST(FrontEndMatches, OwnMatchersMatchWhatIsRetrieved) {
  const RoomScene scene = WriteRoomScene(TestFolder(), {.matches = false, .pictures = true});
  const std::vector<Query> queries = ReadQueryList(scene.query_list());
  std::vector<std::string> in_memory;
  FrontEndOptions options{.reference_images = scene.images(),
                          .query_images = scene.images(),
                          .top_k = 2,
                          .max_features = 300};
  options.matcher = [&](const Photograph& query, std::span<const Photograph> references) {
    if (query.pixels != nullptr) in_memory.push_back(query.name);
    EXPECT_EQ(query.file, scene.images() / query.name);
    std::vector<PixelMatches> matches;
    for (const Photograph& reference : references) {
      EXPECT_TRUE(std::filesystem::exists(reference.file)) << reference.file;
      const auto x = static_cast<double>(matches.size());
      matches.push_back({.query_px = {{7, 8}, {x, 9}, {3, 4}},
                         .reference_px = {{x, 1}, {x, 2}, {x, 3}},
                         .scores = {.9, .8, .1}});
    }
    return matches;
  };
  options.reading = {.min_score = .5, .first_pixel = .25};
  const auto source =
      MakeFrontEndMatches(options, LoadReferences(scene.model()).references, queries);
  const QueryMatches matches = source->Match(queries[0]);
  ASSERT_EQ(matches.references.size(), 2u);
  ASSERT_EQ(matches.matches.size(), 4u);
  EXPECT_EQ(matches.matches[0].query_px, Eigen::Vector2d(7.25, 8.25));
  EXPECT_EQ(matches.matches[3].reference_px, Eigen::Vector2d(1.25, 2.25));
  EXPECT_EQ(matches.matches[0].query_keypoint, matches.matches[2].query_keypoint);
  EXPECT_NE(matches.matches[0].query_keypoint, matches.matches[3].query_keypoint);
  EXPECT_TRUE(in_memory.empty());
  const Image photograph = ReadImage(scene.images() / queries[0].name, ImageChannels::kRgb);
  EXPECT_EQ(source->MatchPhotograph(queries[0], photograph).matches.size(), 4u);
  EXPECT_EQ(in_memory, std::vector<std::string>{queries[0].name});
}

}  // namespace
}  // namespace raylift
