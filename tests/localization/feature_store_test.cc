#include "localization/matching/feature_store.h"

#include <atomic>
#include <thread>

#include "base/rng.h"
#include "localization/retrieval/vlad_index.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

Features RandomFeatures(uint64_t seed, int count) {
  Rng rng(seed);
  Features features;
  features.image_width_px = 64;
  features.image_height_px = 48;
  features.descriptors.resize(8, count);
  for (float& value : features.descriptors.reshaped()) value = static_cast<float>(rng.Uniform());
  features.descriptors.colwise().normalize();
  for (int i = 0; i < count; ++i) {
    features.keypoints_px.emplace_back(1.5 + i - i % 2, 2.5);  // two at each place
    features.scores.push_back(0.5f);
  }
  return features;
}

class StoredFeatures : public ::testing::Test {
 protected:
  StoredFeatures() {
    for (int i = 0; i < 12; ++i) {
      names_.push_back("image" + std::to_string(i));
      written_.emplace(names_.back(), RandomFeatures(static_cast<uint64_t>(i), 100));
    }
    WriteFeatureFile(folder_ / "features.h5", written_, false);
    WriteFeatureFile(folder_ / "none.h5", {}, false);
  }

  std::unique_ptr<FeatureStore> Store(size_t most_bytes = FeatureStore::kMostBytes) const {
    return StoreOf("features.h5", most_bytes);
  }
  // Of the same stamps; the file holds none.
  std::unique_ptr<FeatureStore> StoreThatCannotRead() const {
    return StoreOf("none.h5", FeatureStore::kMostBytes);
  }

  VladVectors Vectors(const FeatureStore& features, uint64_t seed = 0) const {
    return ComputeOrReadVladVectors(names_, features, folder_, seed, 1);
  }

  fs::path folder_ = TestFolder();
  std::vector<std::string> names_;
  std::map<std::string, Features> written_;

 private:
  std::unique_ptr<FeatureStore> StoreOf(const std::string& name, size_t most_bytes) const {
    const auto file = std::make_shared<const FeatureFile>(folder_ / name);
    auto store = std::make_unique<FeatureStore>(most_bytes);
    for (const std::string& image : names_) store->Add(image, file, "stamp of " + image);
    return store;
  }
};

TEST_F(StoredFeatures, AreThoseOfTheFileHoweverFewFitIntoMemory) {
  const auto store = Store(1);
  for (int round = 0; round < 2; ++round) {
    for (const std::string& name : names_) {
      const auto image = store->Get(name);
      EXPECT_EQ(image->features.keypoints_px, written_.at(name).keypoints_px);
      EXPECT_EQ(image->features.descriptors, written_.at(name).descriptors);
      EXPECT_EQ(image->keypoints[3], 2);
      EXPECT_EQ(store->SizeOf(name), (PlaneSize{64, 48}));
    }
  }
}

TEST_F(StoredFeatures, ThoseAskedForLastStay) {
  constexpr size_t kFeatures = 100, kBytesEach = 16 + 8 * 4 + 4 + 4;
  const size_t two = 2 * kFeatures * kBytesEach;
  const auto store = Store(two);
  const auto first = store->Get(names_[0]);
  EXPECT_EQ(store->Get(names_[0]), first);
  store->Get(names_[1]);
  EXPECT_EQ(store->Get(names_[0]), first);
  store->Get(names_[2]);  // instead of the second
  EXPECT_EQ(store->Get(names_[0]), first);
  store->Get(names_[3]);
  store->Get(names_[4]);
  EXPECT_NE(store->Get(names_[0]), first);
  EXPECT_EQ(store->Get(names_[0])->features.descriptors, first->features.descriptors);
}

TEST_F(StoredFeatures, ThoseThatAreInNoFileStayAndComeFirst) {
  FeatureStore store(1);
  store.Add("known", RandomFeatures(99, 5));
  store.Add("known", RandomFeatures(98, 6));
  EXPECT_EQ(store.Get("known")->features.keypoints_px.size(), 5u);
  EXPECT_EQ(store.SizeOf("known"), (PlaneSize{64, 48}));
  EXPECT_EQ(store.StampOf("known"), "");
}

TEST_F(StoredFeatures, AreReadByManyThreads) {
  const auto store = Store(1);
  std::vector<std::thread> threads;
  std::atomic<int> wrong = 0;
  for (size_t t = 0; t < 4; ++t) {
    threads.emplace_back([&, t] {
      for (size_t i = 0; i < 100; ++i) {
        const std::string& name = names_[(i * (t + 1)) % names_.size()];
        if (store->Get(name)->features.descriptors != written_.at(name).descriptors) ++wrong;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(wrong, 0);
}

TEST_F(StoredFeatures, VectorsForRetrievalAreLearnedOnce) {
  const VladVectors computed = ComputeVladVectors(names_, *Store(), 0, 1);
  const VladVectors first = Vectors(*Store(1));
  EXPECT_EQ(first.vocabulary.words, computed.vocabulary.words);
  EXPECT_EQ(first.of_references, computed.of_references);
  const VladVectors kept = Vectors(*StoreThatCannotRead());
  EXPECT_EQ(kept.vocabulary.words, computed.vocabulary.words);
  EXPECT_EQ(kept.of_references, computed.of_references);
}

TEST_F(StoredFeatures, VectorsOfOtherSeedsReferencesAndFeaturesAreLearnedAnew) {
  Vectors(*Store());
  EXPECT_THROW(Vectors(*StoreThatCannotRead(), 1), InputError);
  std::swap(names_[0], names_[1]);
  EXPECT_THROW(Vectors(*StoreThatCannotRead()), InputError);
  std::swap(names_[0], names_[1]);
  FeatureStore others;
  const auto file = std::make_shared<const FeatureFile>(folder_ / "none.h5");
  for (const std::string& name : names_) others.Add(name, file, "another stamp of " + name);
  EXPECT_THROW(Vectors(others), InputError);
}

TEST_F(StoredFeatures, VectorsOfFeaturesInMemoryAreNotKept) {
  FeatureStore store;
  for (const auto& [name, features] : written_) store.Add(name, features);
  EXPECT_EQ(Vectors(store).of_references.cols(), 12);
  EXPECT_FALSE(fs::exists(folder_ / "vlad"));
}

}  // namespace
}  // namespace raylift
