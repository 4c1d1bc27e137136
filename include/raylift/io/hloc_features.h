// hloc's local features, features.h5. Their keypoints put the first pixel's center at (0, 0), ours
// are COLMAP's (0.5, 0.5): they are converted here.

#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "raylift/scene/features.h"
#include "raylift/scene/image.h"

namespace raylift {

// One (nested) group per image name.
class FeatureFile {
 public:
  // Opens for reading; InputError where it is missing or no HDF5 file.
  explicit FeatureFile(const std::filesystem::path& path);
  ~FeatureFile();
  FeatureFile(FeatureFile&&) noexcept;
  FeatureFile& operator=(FeatureFile&&) noexcept;

  std::vector<std::string> ImageNames() const;  // sorted
  bool Contains(const std::string& image_name) const;
  // Only the keypoints must be there; without `image_size` the image's sides are 0. InputError
  // naming file and image where it is absent or malformed (a wrong shape, a number that is not
  // finite). Safe to call from several threads (HDF5 itself is serialized inside).
  Features Read(const std::string& image_name) const;
  // The image's size alone; sides of 0 where the file does not tell.
  PlaneSize ReadImageSize(const std::string& image_name) const;
  // Warnings met so far, e.g. float16 keypoints of an image so wide that they lose precision.
  std::vector<std::string> Warnings() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Writes such a file at once; float32 keypoints and scores, float16 descriptors as hloc does where
// `half_descriptors`.
void WriteFeatureFile(const std::filesystem::path& path,
                      const std::map<std::string, Features>& features_by_image,
                      bool half_descriptors);
// The same of images whose features are asked for one after the other and need not be in memory
// together.
void WriteFeatureFile(const std::filesystem::path& path, std::span<const std::string> image_names,
                      const std::function<Features(const std::string& image_name)>& features_of,
                      bool half_descriptors);

// The features as they are read back from a file that they were written to.
Features AsStored(Features features, bool half_descriptors);

}  // namespace raylift
