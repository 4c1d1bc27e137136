// The vectors by which references are retrieved, kept beside their features: learning a vocabulary
// means to read the features of all references.

#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>

#include "localization/feature_store.h"
#include "localization/vlad_index.h"

namespace raylift {

// As ComputeVladVectors() has them: read from `folder`/vlad, in hloc's layout of global features, where
// they were made from the same features of the same references with the same seed, else computed
// and written there. Of runs that begin at once one computes, and the others wait. Nothing is kept
// without a folder, or where features are known that are in no file.
VladVectors ComputeOrReadVladVectors(std::span<const std::string> references,
                                     const FeatureStore& features,
                                     const std::filesystem::path& folder, uint64_t seed,
                                     int threads);

}  // namespace raylift
