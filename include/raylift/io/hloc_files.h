// hloc's files: local features (features.h5), global descriptors (global-feats*.h5), matches of
// pairs of images (matches.h5), and lists of the pairs to match.
//
// hloc's keypoints put the first pixel's center at (0, 0), ours are COLMAP's (0.5, 0.5): they are
// converted here.

#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "raylift/scene/features.h"
#include "raylift/scene/image.h"

namespace raylift {

class PackedMap;

// Reads features.h5, which holds one (nested) group per image name, or the features of a packed
// map.
class FeatureFile {
 public:
  // Opens for reading; throws InputError where it is missing or neither of these.
  explicit FeatureFile(const std::filesystem::path& path);
  explicit FeatureFile(std::shared_ptr<const PackedMap> map);  // not null
  ~FeatureFile();
  FeatureFile(FeatureFile&&) noexcept;
  FeatureFile& operator=(FeatureFile&&) noexcept;

  std::vector<std::string> ImageNames() const;  // sorted
  bool Contains(const std::string& image_name) const;
  // Reads an image's features. Only the keypoints must be there; without `image_size` the image's
  // sides are 0. Throws InputError naming file and image where it is absent or malformed (a wrong
  // shape, a number that is not finite). Thread safe (HDF5 itself is serialized inside).
  Features Read(const std::string& image_name) const;
  // Reads the image's size alone; its sides are 0 where the file does not tell it.
  PlaneSize ReadImageSize(const std::string& image_name) const;
  // Returns the warnings so far, e.g. float16 keypoints of an image so wide that they lose
  // precision.
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
// Writes such a file image by image: `features_of` is asked for one image after the other, so that
// they need not be in memory together.
void WriteFeatureFile(const std::filesystem::path& path, std::span<const std::string> image_names,
                      const std::function<Features(const std::string& image_name)>& features_of,
                      bool half_descriptors);

// Returns the features as they are read back from a file that they were written to.
Features AsStored(Features features, bool half_descriptors);

// Reads global-feats*.h5 as descriptors are asked for: 100,000 of them need not be in memory at
// once.
class GlobalFeatureFile {
 public:
  explicit GlobalFeatureFile(const std::filesystem::path& path);
  ~GlobalFeatureFile();
  GlobalFeatureFile(GlobalFeatureFile&&) noexcept;
  GlobalFeatureFile& operator=(GlobalFeatureFile&&) noexcept;

  std::vector<std::string> ImageNames() const;  // sorted; walks the whole file
  // Returns a column for each image. Throws InputError naming file and data set where an image is
  // absent, its descriptor is no vector, of another size than the first that was read, or not
  // finite. Thread safe.
  Eigen::MatrixXf Read(std::span<const std::string> image_names) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Writes such a file from a column for each image.
void WriteGlobalDescriptors(const std::filesystem::path& path,
                            std::span<const std::string> image_names,
                            const Eigen::MatrixXf& descriptors);

// Reads matches.h5.
class MatchFile {
 public:
  explicit MatchFile(const std::filesystem::path& path);
  ~MatchFile();
  MatchFile(MatchFile&&) noexcept;
  MatchFile& operator=(MatchFile&&) noexcept;

  // Returns the matches of a pair in whichever order and naming (new or old) it is stored; nullopt
  // where the pair is not in the file. The caller has to check that the indices fit the keypoints.
  // Thread safe.
  std::optional<std::vector<FeatureMatch>> Read(const std::string& query_name,
                                                const std::string& reference_name) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Reads lines `query reference`. The order of a query's lines is the rank; of a reference that
// stands twice the better rank counts. Also takes the comma separated forms of MeshLoc and kapture
// (query, reference, score).
using RetrievalPairs = std::map<std::string, std::vector<std::string>>;
RetrievalPairs ReadPairs(const std::filesystem::path& path);
void WritePairs(const std::filesystem::path& path,
                std::span<const std::pair<std::string, std::string>> pairs);

}  // namespace raylift
