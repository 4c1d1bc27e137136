// The front end's work on single images, kept on disk in hloc's layout.

#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "localization/feature_store.h"

#include "raylift/jobs/shard.h"
#include "raylift/localization/front_end.h"
#include "raylift/scene/features.h"

namespace raylift {

// An image and where its file is.
struct ImageFile {
  std::string name;
  std::filesystem::path path;
};

struct FeatureCacheOptions {
  std::filesystem::path folder;
  int max_features;
  int threads;
  bool show_progress;
};

// The RootSIFT features of all images beside those that are `known`: read from `folder`/features.h5 where that was made from the
// same files (by size and time of change) with the same options, else extracted and written there.
// In both cases they are the file's, so that a second run sees the same numbers as the first.
// What is extracted is kept as it comes: a run that ends early loses the few images in hand.
// Without a folder they are extracted, to the same numbers.
std::shared_ptr<const FeatureStore> ExtractOrReadFeatures(
    const std::vector<ImageFile>& images, const FeatureCacheOptions& options,
    std::map<std::string, Features> known = {});

// Extracts what is not kept in the folder yet of a shard's images. The last shard to end writes
// features.h5; until then the folder holds the parts.
FeatureCount PrepareFeatures(const std::vector<ImageFile>& images, const Shard& shard,
                             const FeatureCacheOptions& options);

}  // namespace raylift
