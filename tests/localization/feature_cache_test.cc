#include <algorithm>
#include <chrono>

#include "localization/matching/feature_store.h"
#include "support/matchers.h"
#include "support/room_scene.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/file.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

class FeatureCache : public ::testing::Test {
 protected:
  std::map<std::string, Features> Get(int max_features = 500, int threads = 1) const {
    const auto store = ExtractOrReadFeatures(images_, {.folder = scene_.folder / "cache",
                                                       .max_features = max_features,
                                                       .threads = threads,
                                                       .show_progress = false});
    std::map<std::string, Features> features;
    for (const ImageFile& image : images_) features[image.name] = store->Get(image.name)->features;
    return features;
  }
  FeatureCount Prepare(const Shard& shard) const {
    return PrepareFeatures(images_, shard,
                           {.folder = scene_.folder / "cache",
                            .max_features = 500,
                            .threads = 1,
                            .show_progress = false});
  }
  fs::path Parts() const { return scene_.folder / "cache" / "parts"; }
  fs::path File() const { return scene_.folder / "cache" / "features.h5"; }
  static bool Equal(const std::map<std::string, Features>& a,
                    const std::map<std::string, Features>& b) {
    return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const auto& x, const auto& y) {
      return x.first == y.first && x.second.keypoints_px == y.second.keypoints_px &&
             x.second.descriptors == y.second.descriptors && x.second.scores == y.second.scores;
    });
  }

  RoomScene scene_ = WriteRoomScene(TestFolder(), {.matches = false, .pictures = true});
  std::vector<ImageFile> images_ = {{"b", scene_.images() / "query/b.png"},
                                    {"ref/a", scene_.images() / "ref/00.png"}};
};

TEST_F(FeatureCache, SecondCallReadsWhatTheFirstOneMade) {
  const auto first = Get();
  ASSERT_EQ(first.size(), 2u);
  EXPECT_EQ(first.at("b").keypoints_px.size(), 500u);
  EXPECT_EQ(first.at("b").image_width_px, 320);
  const auto time = fs::last_write_time(File());
  EXPECT_TRUE(Equal(Get(), first));
  EXPECT_EQ(fs::last_write_time(File()), time);
}

TEST_F(FeatureCache, OrderOfImagesAndThreadsDoNotMatter) {
  const auto first = Get(500, 4);
  const auto time = fs::last_write_time(File());
  std::swap(images_[0], images_[1]);
  EXPECT_TRUE(Equal(Get(500, 1), first));
  EXPECT_EQ(fs::last_write_time(File()), time);
  fs::remove_all(File().parent_path());
  EXPECT_TRUE(Equal(Get(500, 1), first));
}

TEST_F(FeatureCache, ChangedOptionsFilesAndListsAreExtractedAgain) {
  Get();
  EXPECT_EQ(Get(100).at("b").keypoints_px.size(), 100u);
  EXPECT_EQ(Get(500).at("b").keypoints_px.size(), 500u);

  const auto before = Get();
  fs::remove(images_[0].path);
  fs::copy_file(images_[1].path, images_[0].path);
  const auto after = Get();
  EXPECT_EQ(after.at("b").keypoints_px, before.at("ref/a").keypoints_px);

  images_.push_back({"c", scene_.images() / "ref/01.png"});
  EXPECT_EQ(Get().size(), 3u);
}

TEST_F(FeatureCache, AMissingImageIsNamedEvenWhereFeaturesAreCached) {
  Get();
  fs::remove(images_[0].path);
  EXPECT_TRUE(FailsWithInputError([&] { Get(); }, {images_[0].path.string()}));
}

TEST_F(FeatureCache, WhatShardsHavePreparedIsWhatOneRunMakes) {
  const auto whole = Get();
  const std::string inputs = ReadFile(File().parent_path() / "features.inputs.txt");
  fs::remove_all(File().parent_path());

  const FeatureCount first = Prepare({0, 2});
  EXPECT_EQ(first.images, 2u);
  EXPECT_EQ(first.extracted, 1u);
  EXPECT_EQ(first.missing, 1u);
  EXPECT_FALSE(fs::exists(File()));
  EXPECT_EQ(Prepare({0, 2}).extracted, 0u);
  const FeatureCount second = Prepare({1, 2});
  EXPECT_EQ(second.extracted, 1u);
  EXPECT_EQ(second.missing, 0u);

  ASSERT_TRUE(fs::exists(File()));
  EXPECT_EQ(ReadFile(File().parent_path() / "features.inputs.txt"), inputs);
  EXPECT_FALSE(fs::exists(Parts()));
  EXPECT_TRUE(Equal(Get(), whole));
}

TEST_F(FeatureCache, PartsOfAShardThatNeverEndedAreTaken) {
  const auto whole = Get();
  fs::remove_all(File().parent_path());
  Prepare({0, 2});
  ASSERT_TRUE(fs::exists(Parts()));
  // Its photograph is not read again.
  const auto time = fs::last_write_time(images_[0].path);
  const auto size = fs::file_size(images_[0].path);
  WriteFile(images_[0].path, std::string(size, 'x'));
  fs::last_write_time(images_[0].path, time);
  EXPECT_TRUE(Equal(Get(), whole));
  EXPECT_FALSE(fs::exists(Parts()));
}

TEST_F(FeatureCache, PartsWithOtherOptionsOrWithoutTheirListAreNotTaken) {
  const auto whole = Get();
  Get(100);
  fs::remove_all(File().parent_path());
  Prepare({0, 2});
  EXPECT_EQ(Get(100).at("b").keypoints_px.size(), 100u);
  fs::remove_all(File().parent_path());
  Prepare({0, 2});
  for (const auto& entry : fs::directory_iterator(Parts())) {
    if (entry.path().extension() == ".txt") fs::remove(entry.path());
  }
  EXPECT_EQ(Prepare({0, 2}).extracted, 1u);
  EXPECT_TRUE(Equal(Get(), whole));
}

TEST_F(FeatureCache, FurtherImagesAreAddedToWhatIsThere) {
  Get();
  WriteFile(images_[0].path, ReadFile(images_[0].path));  // another time of change
  const std::vector<ImageFile> all = images_;
  images_ = {{"c", scene_.images() / "ref/01.png"}};
  Get();
  images_ = {all[1]};
  EXPECT_EQ(Prepare({}).extracted, 0u);
  images_ = {all[0]};
  EXPECT_EQ(Prepare({}).extracted, 1u);
  images_ = {{"c", scene_.images() / "ref/01.png"}, all[0], all[1]};
  EXPECT_EQ(Prepare({}).extracted, 0u);
}

// A run killed after it wrote features and before it wrote what they were made from.
TEST_F(FeatureCache, FeaturesAreNotTakenForThoseOfAnOlderList) {
  Get();
  const fs::path inputs = File().parent_path() / "features.inputs.txt";
  const std::string older = ReadFile(inputs);
  // Where the list cannot be written, that of the older run must not stay.
  fs::remove(inputs);
  fs::create_directory(inputs);
  images_[0].path = scene_.images() / "ref/02.png";
  EXPECT_THROW(Get(), std::exception);
  fs::remove_all(inputs);
  images_[0].path = scene_.images() / "query/b.png";
  const auto features = Get();
  EXPECT_EQ(ReadFile(inputs), older);
  EXPECT_EQ(features.at("b").keypoints_px.size(), 500u);
}

}  // namespace
}  // namespace raylift
