// Holds the features of a scene's images. Those in files are read when they are asked for, and
// those asked for last stay in memory: a city's do not fit into it.

#pragma once

#include <cstddef>
#include <filesystem>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "raylift/io/hloc_files.h"
#include "raylift/jobs/shard.h"
#include "raylift/localization/match_source.h"
#include "raylift/scene/features.h"
#include "raylift/scene/image.h"

namespace raylift {

struct ImageFeatures {
  Features features;
  std::vector<int> keypoints;  // canonical (CanonicalKeypoints), one per feature
};

class FeatureStore {
 public:
  // This is enough for about a thousand images with 4096 features each.
  static constexpr size_t kMostBytes = size_t{2} << 30;

  // Keeps at most so many bytes of what it reads, besides what callers hold, but always the last.
  explicit FeatureStore(size_t most_bytes = kMostBytes) : most_bytes_(most_bytes) {}

  // Adds an image's features; an image of a name that is there already is left out. `stamp` tells
  // features of other contents apart; empty where it is not known.
  void Add(const std::string& image, Features features);
  void Add(const std::string& image, std::shared_ptr<const FeatureFile> file, std::string stamp);

  // Returns an image's features. The image must have been added. Thread safe; throws LostFile where
  // the file does not give them.
  std::shared_ptr<const ImageFeatures> Get(const std::string& image) const;
  PlaneSize SizeOf(const std::string& image) const;  // without reading the features
  const std::string& StampOf(const std::string& image) const;

 private:
  struct Entry {
    std::shared_ptr<const FeatureFile> file;  // null: it is in memory for good
    std::string stamp;
    std::shared_ptr<const ImageFeatures> held;  // null: not in memory
    size_t bytes = 0;
    std::list<Entry*>::iterator recency;
  };

  void Keep(Entry* entry, const std::shared_ptr<const ImageFeatures>& features) const;

  size_t most_bytes_;
  mutable std::mutex mutex_;
  mutable std::map<std::string, Entry> entries_;
  mutable std::list<Entry*> recent_;  // of those that were read and are held, the last first
  mutable size_t bytes_ = 0;          // of these
};

// Does the front end's work on single images, kept on disk in hloc's layout.

// An image and the path of its file.
struct ImageFile {
  std::string name;
  std::filesystem::path path;
};

struct FeatureCacheOptions {
  std::filesystem::path folder;
  int max_features;
  FeatureExtractor extractor = nullptr;  // RootSIFT
  std::string extractor_name = {};
  int threads;
  bool show_progress;
  // Features that are read from here in place of photographs, where it has them.
  std::shared_ptr<const FeatureFile> packed = nullptr;
};

// Returns the features of all images except those that are `known`: read from `folder`/features.h5
// where that was made from the same files (by size and time of change) with the same options, else
// extracted and written there. In both cases they are the file's, so that a second run sees the
// same numbers as the first. What is extracted is kept as it comes: a run that ends early loses the
// few images in hand. Without a folder they are extracted, to the same numbers.
std::shared_ptr<const FeatureStore> ExtractOrReadFeatures(
    const std::vector<ImageFile>& images, const FeatureCacheOptions& options,
    std::map<std::string, Features> known = {});

// Returns the features of a photograph, rounded as a cache would store them.
Features ExtractAsStored(const Image& photograph, const FeatureCacheOptions& options);

// Extracts what is not kept in the folder yet of a shard's images. The last shard to end writes
// features.h5; until then the folder holds the parts.
FeatureCount PrepareFeatures(const std::vector<ImageFile>& images, const Shard& shard,
                             const FeatureCacheOptions& options);

}  // namespace raylift
