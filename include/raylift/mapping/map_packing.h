// Packs a scene into one file, a map for those who localize in it: references with their poses,
// depth as 16 bits of its logarithm, features, the vectors for retrieval, and the scene's
// calibration. A map may stand wherever a scene file may.
//
//   PackMap("town.raymap", {scene.references.images, depth_of, features_of}, {});
//   Scene scene = OpenScene(SceneOptionsOf(ReadSceneFile("town.raymap")));
//
// The vectors for retrieval depend on all references and are computed anew by each call, from the
// features as they are packed. All else stays as it is: a map that grew and a map that was made at
// once from the same references, with the same options, have the same bytes.

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
  // The kind of the features; those of the built-in front end are "rootsift".
  std::string features = "rootsift";
  uint64_t seed = 0;  // of the vocabulary that references are retrieved by, at most 2^53
  // Keys of the depth's specification, beside its path, as ",first_sample_px=0,near=0.1".
  std::string depth_keys = {};
  std::string crs = {};          // what the world's coordinates are, as --crs takes it
  std::string calibration = {};  // JSON of the scene's calibration (FormatSceneCalibration)
};

struct PackingHooks {
  int threads = 0;                               // 0: all
  std::function<void()> on_reference = nullptr;  // is packed; from several threads
};

// Writes a map. Throws InputError where a name stands twice or cannot stand in a list, or a depth
// map has a side of more than 16383 pixels.
void PackMap(const std::filesystem::path& file, const ReferencesToPack& references,
             const MapOptions& options, const PackingHooks& hooks = {});

// Adds the references that the map does not hold yet and returns their number; descriptors are kept
// in the map's precision. A calibration, if given, replaces the former one.
size_t AddToMap(const std::filesystem::path& file, const ReferencesToPack& references,
                const std::string& calibration = {}, const PackingHooks& hooks = {});

// Removes references. Throws InputError where the map has no reference of a name, or would have
// none left.
void RemoveFromMap(const std::filesystem::path& file, std::span<const std::string> names,
                   const PackingHooks& hooks = {});

}  // namespace raylift
