#include "raylift/io/hloc_global_features.h"

#include <array>
#include <mutex>

#include "io/hloc/hdf5_checks.h"
#include "io/hloc/hdf5_file.h"
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

std::string DatasetOf(const std::string& image_name) { return image_name + "/global_descriptor"; }

// Of `size` values each, one after the other.
void WriteVectors(const std::filesystem::path& path, std::span<const std::string> image_names,
                  const float* values, size_t size) {
  Hdf5Writer file(path);
  for (size_t i = 0; i < image_names.size(); ++i) {
    file.WriteFloats(DatasetOf(image_names[i]), std::array{size}, {values + i * size, size},
                     Hdf5Kind::kFloat);
  }
  file.Commit();
}

}  // namespace

struct GlobalFeatureFile::Impl {
  explicit Impl(const std::filesystem::path& path) : file(path) {}

  Eigen::VectorXf Read(const std::string& image_name) {
    const std::string dataset = DatasetOf(image_name);
    const auto array = file.Read<float>(dataset);
    if (array.shape.size() != 1 || array.values.empty()) {
      file.Fail(dataset, fmt::format("expected a vector, found {}", ToString(array.shape)));
    }
    CheckFinite(file, dataset, array.values);
    CheckSize(dataset, image_name, array.values.size());
    return Eigen::Map<const Eigen::VectorXf>(array.values.data(),
                                             static_cast<Eigen::Index>(array.values.size()));
  }

  Hdf5Reader file;

 private:
  void CheckSize(const std::string& dataset, const std::string& image_name, size_t size) {
    const std::scoped_lock lock(mutex_);
    if (first_size_ == 0) {
      first_size_ = size;
      first_image_ = image_name;
    }
    if (size != first_size_) {
      file.Fail(dataset, fmt::format("expected {} numbers as in \"{}\", found {}", first_size_,
                                     first_image_, size));
    }
  }

  std::mutex mutex_;
  size_t first_size_ = 0;  // of the first that was read
  std::string first_image_;
};

GlobalFeatureFile::GlobalFeatureFile(const std::filesystem::path& path)
    : impl_(std::make_unique<Impl>(path)) {}
GlobalFeatureFile::~GlobalFeatureFile() = default;
GlobalFeatureFile::GlobalFeatureFile(GlobalFeatureFile&&) noexcept = default;
GlobalFeatureFile& GlobalFeatureFile::operator=(GlobalFeatureFile&&) noexcept = default;

std::vector<std::string> GlobalFeatureFile::ImageNames() const {
  return impl_->file.GroupsWith("global_descriptor");
}

Eigen::MatrixXf GlobalFeatureFile::Read(std::span<const std::string> image_names) const {
  Eigen::MatrixXf descriptors;
  for (size_t i = 0; i < image_names.size(); ++i) {
    const Eigen::VectorXf descriptor = impl_->Read(image_names[i]);
    if (i == 0) {
      descriptors.resize(descriptor.size(), static_cast<Eigen::Index>(image_names.size()));
    }
    descriptors.col(static_cast<Eigen::Index>(i)) = descriptor;
  }
  return descriptors;
}

GlobalDescriptors ReadGlobalDescriptors(const std::filesystem::path& path) {
  const GlobalFeatureFile file(path);
  GlobalDescriptors global;
  global.names = file.ImageNames();
  global.descriptors = file.Read(global.names).transpose();
  return global;
}

void WriteGlobalDescriptors(const std::filesystem::path& path, const GlobalDescriptors& global) {
  RAYLIFT_CHECK_EQ(global.names.size(), static_cast<size_t>(global.descriptors.rows()));
  WriteVectors(path, global.names, global.descriptors.data(),
               static_cast<size_t>(global.descriptors.cols()));
}

void WriteGlobalDescriptors(const std::filesystem::path& path,
                            std::span<const std::string> image_names,
                            const Eigen::MatrixXf& descriptors) {
  RAYLIFT_CHECK_EQ(image_names.size(), static_cast<size_t>(descriptors.cols()));
  WriteVectors(path, image_names, descriptors.data(), static_cast<size_t>(descriptors.rows()));
}

}  // namespace raylift
