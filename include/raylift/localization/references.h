// The references of a scene: photographs whose cameras and poses are known.

#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "raylift/geometry/rigid3.h"
#include "raylift/localization/covisibility.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// Those in use, and the names that exist but are thinned out, which a retrieval list may name
// without being wrong.
struct ReferenceSet {
  std::filesystem::path model;  // for messages
  std::vector<PosedImage> images;
  std::vector<std::string> thinned_out;
};

struct LoadedReferences {
  ReferenceSet references;
  Covisibility covisibility;
  std::vector<std::string> warnings;
};

// The images of a COLMAP model whose poses may be in another convention, thinned out. Cameras of
// equal parameters count as one. InputError where no image is left, or where thinning per camera
// drops none as each image has a camera of its own.
LoadedReferences LoadReferences(const std::filesystem::path& model, const Thinning& thinning,
                                PoseConvention poses = PoseConvention::kCamFromWorld);
// Every `every`-th from the first on.
LoadedReferences LoadReferences(const std::filesystem::path& model, int every,
                                PoseConvention poses = PoseConvention::kCamFromWorld);

// The references as queries, to be localized by the others: whatever matches them leaves out the
// one that has the query's name.
std::vector<Query> QueriesOf(const ReferenceSet& references);
std::map<std::string, Rigid3> PosesOf(const ReferenceSet& references);

}  // namespace raylift
