#include "localization/feature_store.h"

#include <utility>

#include "raylift/scene/keypoints.h"

namespace raylift {
namespace {

std::shared_ptr<const ImageFeatures> Indexed(Features features) {
  auto indexed = std::make_shared<ImageFeatures>();
  indexed->keypoints = CanonicalKeypoints(features.keypoints_px);
  indexed->features = std::move(features);
  return indexed;
}

size_t BytesOf(const ImageFeatures& image) {
  const Features& features = image.features;
  return features.keypoints_px.size() * sizeof(features.keypoints_px[0]) +
         static_cast<size_t>(features.descriptors.size()) * sizeof(float) +
         features.scores.size() * sizeof(float) + image.keypoints.size() * sizeof(int);
}

}  // namespace

void FeatureStore::Add(const std::string& image, Features features) {
  const auto [entry, is_new] = entries_.try_emplace(image);
  if (is_new) entry->second.held = Indexed(std::move(features));
}

void FeatureStore::Add(const std::string& image, std::shared_ptr<const FeatureFile> file,
                       std::string stamp) {
  const auto [entry, is_new] = entries_.try_emplace(image);
  if (!is_new) return;
  entry->second.file = std::move(file);
  entry->second.stamp = std::move(stamp);
}

std::shared_ptr<const ImageFeatures> FeatureStore::Get(const std::string& image) const {
  Entry& entry = entries_.at(image);
  {
    const std::scoped_lock lock(mutex_);
    if (entry.held != nullptr) {
      if (entry.file != nullptr) recent_.splice(recent_.begin(), recent_, entry.recency);
      return entry.held;
    }
  }
  // Two threads that want the same image may both read it.
  const auto features = Indexed(entry.file->Read(image));
  const std::scoped_lock lock(mutex_);
  if (entry.held == nullptr) Keep(&entry, features);
  return entry.held;
}

void FeatureStore::Keep(Entry* entry, const std::shared_ptr<const ImageFeatures>& features) const {
  entry->held = features;
  entry->bytes = BytesOf(*features);
  entry->recency = recent_.insert(recent_.begin(), entry);
  bytes_ += entry->bytes;
  while (bytes_ > most_bytes_ && recent_.size() > 1) {
    Entry& oldest = *recent_.back();
    bytes_ -= oldest.bytes;
    oldest.held = nullptr;
    recent_.pop_back();
  }
}

PlaneSize FeatureStore::SizeOf(const std::string& image) const {
  const Entry& entry = entries_.at(image);
  if (entry.file != nullptr) return entry.file->ReadImageSize(image);
  return {entry.held->features.image_width_px, entry.held->features.image_height_px};
}

const std::string& FeatureStore::StampOf(const std::string& image) const {
  return entries_.at(image).stamp;
}

}  // namespace raylift
