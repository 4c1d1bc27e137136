// The depth maps of the references of a scene, found, loaded and converted when they are needed.

#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "raylift/lifting/depth_convention.h"
#include "raylift/scene/image.h"
#include "raylift/scene/photographs.h"

namespace raylift {

class DepthFolder {
 public:
  // Finds the maps of these references. InputError where there is none at all. One is read, so
  // that a wrong format is noticed at once.
  DepthFolder(std::filesystem::path folder, DepthConvention convention,
              std::span<const PosedImage> references, size_t max_cache_bytes = size_t{1} << 29);
  ~DepthFolder();

  // The converted map of a reference; null where there is none. Maps are kept while the cache has
  // room. Thread safe: a map is read once even where many threads ask for it.
  std::shared_ptr<const DepthMap> Load(const PosedImage& reference) const;

  // What was understood of the files ("PNG uint16 640 x 480, z, 1 is 0.001").
  const std::string& understood() const { return understood_; }
  // Of the first reference's map, as it lies in the image.
  PlaneSize size_px() const { return size_px_; }
  // What a stored 1 is in scene units (of kInverse: in 1 / scene units), the scale included; of the
  // first reference's map.
  double unit() const { return unit_; }
  const DepthConvention& convention() const;
  // What the user should know: references without a map, a unit that was guessed.
  const std::vector<std::string>& warnings() const { return warnings_; }

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
  std::string understood_;
  PlaneSize size_px_;
  double unit_ = 1;
  std::vector<std::string> warnings_;
};

}  // namespace raylift
