// The files of hloc: features.h5, matches.h5, global-feats*.h5, pairs lists. All conventions are
// converted here: hloc's keypoints put the first pixel's centre at (0, 0), ours are COLMAP's
// (0.5, 0.5).

#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "raylift/scene/features.h"

namespace raylift {

// hloc's local features file: one (nested) group per image name.
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

// The features as they are read back from a file that they were written to.
Features AsStored(Features features, bool half_descriptors);

// hloc's matches file.
class MatchFile {
 public:
  explicit MatchFile(const std::filesystem::path& path);
  ~MatchFile();
  MatchFile(MatchFile&&) noexcept;
  MatchFile& operator=(MatchFile&&) noexcept;

  // The matches of a pair whichever way round and in whichever naming (new or old) it is stored;
  // none where the pair is not in the file. Whether the indices fit the keypoints is the caller's
  // to check. Safe to call from several threads.
  std::optional<std::vector<FeatureMatch>> Read(const std::string& query_name,
                                                const std::string& reference_name) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

struct PairMatches {
  std::string query_name;
  std::string reference_name;
  size_t num_query_keypoints;
  std::vector<FeatureMatch> matches;
};
// InputError where the format cannot hold the matches: two of one query keypoint, or two pairs
// whose names differ only by "/" and "-".
void WriteMatchFile(const std::filesystem::path& path, std::span<const PairMatches> pairs);

// hloc's global descriptors (global-feats*.h5), read as they are asked for: 100,000 of them need
// not be in memory at once.
class GlobalFeatureFile {
 public:
  explicit GlobalFeatureFile(const std::filesystem::path& path);
  ~GlobalFeatureFile();
  GlobalFeatureFile(GlobalFeatureFile&&) noexcept;
  GlobalFeatureFile& operator=(GlobalFeatureFile&&) noexcept;

  std::vector<std::string> ImageNames() const;  // sorted; walks the whole file
  // A column for each image. InputError naming file and data set where an image is absent, its
  // descriptor is no vector, of another size than the first that was read, or not finite. Thread
  // safe.
  Eigen::MatrixXf Read(std::span<const std::string> image_names) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// All of such a file at once: one row per image in the order of `names` (sorted when read).
struct GlobalDescriptors {
  std::vector<std::string> names;
  Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> descriptors;
};
GlobalDescriptors ReadGlobalDescriptors(const std::filesystem::path& path);
void WriteGlobalDescriptors(const std::filesystem::path& path, const GlobalDescriptors& global);

// `query reference` per line; the order of a query's lines is the rank; a reference that stands
// twice keeps its better one. Also takes the comma separated forms of MeshLoc and kapture (query,
// reference, score).
using RetrievalPairs = std::map<std::string, std::vector<std::string>>;
RetrievalPairs ReadPairs(const std::filesystem::path& path);
void WritePairs(const std::filesystem::path& path,
                std::span<const std::pair<std::string, std::string>> pairs);

}  // namespace raylift
