// A scene in one file, to be given to those who localize in it: references with their poses, depth
// in 16 bits of its logarithm, features, what references are retrieved by, and what is known of the
// scene. Wherever a scene file is taken, such a map is, too.
//
//   PackMap("town.raymap", {scene.references.images, depth_of, features_of}, {});
//   Scene scene = OpenScene(SceneOptionsOf(ReadSceneFile("town.raymap")));
//
// What references are retrieved by depends on all of them and is made anew by each call, from the
// features as they are packed. All else stays as it is: a map that grew and a map that was made at
// once of the same references, with the same options, are equal by bytes.

#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>

#include "raylift/scene/features.h"
#include "raylift/scene/image.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// Both functions are called from several threads.
struct ReferencesToPack {
  std::span<const PosedImage> images;
  // Returns the depth of an image, z as in memory; nullopt where there is none of it.
  std::function<std::optional<DepthMap>(const PosedImage& image)> depth;
  std::function<Features(const PosedImage& image)> features;
};

struct MapOptions {
  DescriptorPrecision descriptors = DescriptorPrecision::kBytes;
  // What the features are; those of the built-in front end are "rootsift".
  std::string features = "rootsift";
  uint64_t seed = 0;  // of the vocabulary that references are retrieved by, at most 2^53
  // What a specification of this depth says beside its path, as ",first_sample_px=0,near=0.1".
  std::string depth_keys = {};
  std::string crs = {};          // what the world's coordinates are, as --crs takes it
  std::string calibration = {};  // JSON of the scene's calibration (FormatSceneCalibration)
};

struct PackingHooks {
  int threads = 0;                               // 0: all
  std::function<void()> on_reference = nullptr;  // is packed; from several threads
};

// Writes a map. Throws InputError where a name stands twice or cannot stand in a list, or a depth map
// has a side of more than 16383 pixels.
void PackMap(const std::filesystem::path& file, const ReferencesToPack& references,
             const MapOptions& options, const PackingHooks& hooks = {});

// Adds the references that the map has not yet and returns how many these are; descriptors are kept
// as its others are. A calibration, if there is one, takes the former one's place.
size_t AddToMap(const std::filesystem::path& file, const ReferencesToPack& references,
                const std::string& calibration = {}, const PackingHooks& hooks = {});

// Throws InputError where the map has no reference of a name, or would have none left.
void RemoveFromMap(const std::filesystem::path& file, std::span<const std::string> names,
                   const PackingHooks& hooks = {});

}  // namespace raylift
