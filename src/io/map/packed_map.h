// A packed map is a scene in one file, for localization elsewhere: references with their poses,
// their depth and features, the vectors for retrieval, and the scene's calibration.
//
// The file is a ZIP archive of stored entries that is mapped into memory; an entry is read, against
// its checksum, when it is asked for:
//
//   map.json          format "raylift-map/1", how descriptors are kept, how depth is sampled
//   references.txt    name qw qx qy qz tx ty tz MODEL width height params..., sorted by name
//   calibration.json  of the scene (scene_calibration.h), where it was known
//   retrieval         a vocabulary and each reference's VLAD vector
//   depth/NAME        z in 16 bits of its logarithm
//   features/NAME     keypoints and descriptors
//
// The same contents have the same bytes, whatever way they came together.

#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "raylift/scene/features.h"
#include "raylift/scene/image.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// The data for retrieval: a D x K vocabulary, whose words are columns, and a vector for each
// reference, in their order.
struct PackedRetrieval {
  Eigen::MatrixXf words;
  Eigen::MatrixXf vectors;
};

// The largest seed, up to which JSON's numbers are exact.
inline constexpr uint64_t kMaxMapSeed = uint64_t{1} << 53;

// The name of the built-in front end's features.
inline constexpr const char* kRootSift = "rootsift";

struct MapHeader {
  DescriptorPrecision descriptors = DescriptorPrecision::kBytes;
  std::string features = kRootSift;  // or what else they are
  uint64_t seed = 0;                 // of the vocabulary
  // Keys of the depth's specification on its sampling, as ",first_sample_px=0"; may be empty.
  std::string depth_keys = {};
  std::string crs = {};  // as --crs takes it; may be empty
};

// Returns whether a file is a packed map, by its first bytes.
bool IsPackedMap(const std::filesystem::path& file);

// Reads a packed map; any thread may call its functions.
class PackedMap {
 public:
  // Throws InputError where it is no packed map, or damaged.
  explicit PackedMap(const std::filesystem::path& file);
  ~PackedMap();
  PackedMap(PackedMap&&) noexcept;
  PackedMap& operator=(PackedMap&&) noexcept;

  const std::filesystem::path& file() const;
  const MapHeader& header() const;
  const std::vector<PosedImage>& references() const;  // sorted by name

  // Throw InputError where there is none of that name, or it is damaged.
  size_t IndexOf(const std::string& reference) const;
  DepthMap ReadDepth(const std::string& reference) const;
  Features ReadFeatures(const std::string& reference) const;
  bool HasDepth(const std::string& reference) const;
  bool HasFeatures(const std::string& reference) const;
  // Returns the data for retrieval; nullopt where no reference has features.
  std::optional<PackedRetrieval> ReadRetrieval() const;
  // Returns the JSON of the scene's calibration; empty where there is none.
  std::string ReadCalibration() const;

  // Return a reference's entries as they are, to be copied; empty where it has none.
  std::string DepthBytes(const std::string& reference) const;
  std::string FeatureBytes(const std::string& reference) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Returns the map; null where a file is none.
std::shared_ptr<const PackedMap> OpenPackedMap(const std::filesystem::path& file);

// The contents of a map to be written. Entries are asked for one after the other.
struct MapContents {
  MapHeader header;
  std::vector<PosedImage> references = {};  // sorted by name
  std::string calibration = {};             // may be empty
  // Return the entries of a reference, encoded (map_codec.h); the flags tell whether it has them.
  std::vector<bool> has_depth = {};
  std::vector<bool> has_features = {};
  std::function<std::string(size_t reference)> depth = nullptr;
  std::function<std::string(size_t reference)> features = nullptr;
  std::optional<PackedRetrieval> retrieval = std::nullopt;
};

// Writes a map. The file appears complete or not at all; a process that reads the former one goes
// on reading it.
void WritePackedMap(const std::filesystem::path& file, const MapContents& contents);

}  // namespace raylift
