// hloc's global descriptors, global-feats*.h5.

#pragma once

#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

namespace raylift {

// Reads them as they are asked for: 100,000 of them need not be in memory at once.
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
// A column for each image.
void WriteGlobalDescriptors(const std::filesystem::path& path,
                            std::span<const std::string> image_names,
                            const Eigen::MatrixXf& descriptors);

}  // namespace raylift
