#include <algorithm>
#include <array>
#include <cmath>
#include <mutex>
#include <optional>
#include <set>
#include <utility>

#include "io/hloc/hdf5_file.h"
#include "io/map/packed_map.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/io/hloc_files.h"

namespace raylift {
namespace {

// hloc puts the center of the first pixel at (0, 0), COLMAP at (0.5, 0.5).
constexpr double kPixelShift = 0.5;

// Float16 has steps of half a pixel and more from here on.
constexpr double kCoarseHalfPx = 512;

Hdf5Kind ReadKeypoints(const Hdf5Reader& file, const std::string& image, Features* features) {
  const std::string dataset = image + "/keypoints";
  const auto array = file.Read<double>(dataset);
  if (array.shape.size() != 2 || array.shape[1] != 2) {
    file.Fail(dataset, fmt::format("expected N x 2 numbers, found {}", ToString(array.shape)));
  }
  CheckFinite(file, dataset, array.values);
  features->keypoints_px.resize(array.shape[0]);
  for (size_t i = 0; i < features->keypoints_px.size(); ++i) {
    features->keypoints_px[i] = {array.values[2 * i] + kPixelShift,
                                 array.values[2 * i + 1] + kPixelShift};
  }
  const auto uncertainty = file.ReadAttribute(dataset, "uncertainty");
  if (uncertainty) {
    if (uncertainty->size() != 1 || !std::isfinite(uncertainty->front()) ||
        uncertainty->front() <= 0) {
      file.Fail(dataset, "attribute \"uncertainty\": expected a positive number");
    }
    features->uncertainty_px = static_cast<float>(uncertainty->front());
  }
  return array.kind_in_file;
}

void ReadDescriptors(const Hdf5Reader& file, const std::string& image, Features* features) {
  const std::string dataset = image + "/descriptors";
  if (!file.Has(dataset)) {
    return;
  }
  const auto array = file.Read<float>(dataset);
  const size_t num_keypoints = features->keypoints_px.size();
  if (array.shape.size() != 2 || array.shape[1] != num_keypoints) {
    file.Fail(dataset, fmt::format("expected D x {} numbers, one column per keypoint, found {}",
                                   num_keypoints, ToString(array.shape)));
  }
  CheckFinite(file, dataset, array.values);
  using RowMajor = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  features->descriptors =
      Eigen::Map<const RowMajor>(array.values.data(), static_cast<Eigen::Index>(array.shape[0]),
                                 static_cast<Eigen::Index>(num_keypoints));
}

void ReadScores(const Hdf5Reader& file, const std::string& image, Features* features) {
  // Semi-dense matchers write the singular.
  for (const char* name : {"/scores", "/score"}) {
    const std::string dataset = image + name;
    if (!file.Has(dataset)) {
      continue;
    }
    auto array = file.Read<float>(dataset);
    if (array.shape.size() != 1 || array.shape[0] != features->keypoints_px.size()) {
      file.Fail(dataset, fmt::format("expected {} numbers, found {}", features->keypoints_px.size(),
                                     ToString(array.shape)));
    }
    CheckFinite(file, dataset, array.values);
    features->scores = std::move(array.values);
    return;
  }
}

PlaneSize SizeOf(const Hdf5Reader& file, const std::string& image) {
  std::optional<std::vector<double>> size;
  const std::string dataset = image + "/image_size";
  if (file.Has(dataset)) {
    size = file.Read<double>(dataset).values;
  } else {
    size = file.ReadAttribute(image, "image_size");
  }
  if (!size) {
    return {};
  }
  const auto is_side = [](double side) { return side >= 1 && side <= 1 << 30; };
  if (size->size() != 2 || !std::all_of(size->begin(), size->end(), is_side)) {
    file.Fail(dataset, "expected width and height");
  }
  return {.width_px = static_cast<int>((*size)[0]), .height_px = static_cast<int>((*size)[1])};
}

void CheckHas(const Hdf5Reader& file, const std::string& image) {
  if (!file.Has(image)) {
    file.Fail(image, "the image is not in the file");
  }
}

double LargestCoordinate(const Features& features) {
  double largest = std::max(features.image_width_px, features.image_height_px);
  for (const Eigen::Vector2d& keypoint : features.keypoints_px) {
    largest = std::max(largest, keypoint.maxCoeff());
  }
  return largest;
}

Hdf5Kind KindOf(bool half_descriptors) {
  return half_descriptors ? Hdf5Kind::kHalf : Hdf5Kind::kFloat;
}

void WriteFeatures(const std::string& image, const Features& features, Hdf5Kind descriptor_kind,
                   Hdf5Writer* file) {
  const size_t n = features.keypoints_px.size();
  std::vector<float> keypoints;
  keypoints.reserve(2 * n);
  for (const Eigen::Vector2d& keypoint : features.keypoints_px) {
    keypoints.push_back(static_cast<float>(keypoint.x() - kPixelShift));
    keypoints.push_back(static_cast<float>(keypoint.y() - kPixelShift));
  }
  file->WriteFloats(image + "/keypoints", std::array{n, size_t{2}}, keypoints, Hdf5Kind::kFloat);
  file->WriteAttribute(image + "/keypoints", "uncertainty", features.uncertainty_px);
  if (features.descriptors.size() > 0) {
    RAYLIFT_CHECK_EQ(static_cast<size_t>(features.descriptors.cols()), n);
    const Eigen::MatrixXf transposed = features.descriptors.transpose();
    file->WriteFloats(image + "/descriptors",
                      std::array{static_cast<size_t>(features.descriptors.rows()), n},
                      {transposed.data(), static_cast<size_t>(transposed.size())}, descriptor_kind);
  }
  if (!features.scores.empty()) {
    RAYLIFT_CHECK_EQ(features.scores.size(), n);
    file->WriteFloats(image + "/scores", std::array{n}, features.scores, Hdf5Kind::kFloat);
  }
  if (features.image_width_px > 0) {
    const std::array<int64_t, 2> size{features.image_width_px, features.image_height_px};
    file->WriteIntegers(image + "/image_size", std::array{size_t{2}}, size, 8);
  }
}

std::string DatasetOf(const std::string& image_name) { return image_name + "/global_descriptor"; }

}  // namespace

struct FeatureFile::Impl {
  explicit Impl(const std::filesystem::path& path) : map(OpenPackedMap(path)) {
    if (!map) file.emplace(path);
  }
  explicit Impl(std::shared_ptr<const PackedMap> packed) : map(std::move(packed)) {}
  std::shared_ptr<const PackedMap> map;
  std::optional<Hdf5Reader> file;  // where it is no map
  mutable std::mutex mutex;
  std::set<std::string> coarse_images;
};

FeatureFile::FeatureFile(const std::filesystem::path& path) : impl_(std::make_unique<Impl>(path)) {}
FeatureFile::FeatureFile(std::shared_ptr<const PackedMap> map)
    : impl_(std::make_unique<Impl>(std::move(map))) {}
FeatureFile::~FeatureFile() = default;
FeatureFile::FeatureFile(FeatureFile&&) noexcept = default;
FeatureFile& FeatureFile::operator=(FeatureFile&&) noexcept = default;

std::vector<std::string> FeatureFile::ImageNames() const {
  if (!impl_->map) return impl_->file->GroupsWith("keypoints");
  std::vector<std::string> names;
  for (const PosedImage& image : impl_->map->references()) {
    if (impl_->map->HasFeatures(image.name)) names.push_back(image.name);
  }
  return names;
}

bool FeatureFile::Contains(const std::string& image_name) const {
  return impl_->map ? impl_->map->HasFeatures(image_name)
                    : impl_->file->Has(image_name + "/keypoints");
}

Features FeatureFile::Read(const std::string& image_name) const {
  if (impl_->map) return impl_->map->ReadFeatures(image_name);
  const Hdf5Reader& file = *impl_->file;
  CheckHas(file, image_name);
  Features features;
  const Hdf5Kind keypoint_kind = ReadKeypoints(file, image_name, &features);
  ReadDescriptors(file, image_name, &features);
  ReadScores(file, image_name, &features);
  const PlaneSize size = SizeOf(file, image_name);
  features.image_width_px = size.width_px;
  features.image_height_px = size.height_px;
  if (keypoint_kind == Hdf5Kind::kHalf && LargestCoordinate(features) > kCoarseHalfPx) {
    const std::scoped_lock lock(impl_->mutex);
    impl_->coarse_images.insert(image_name);
  }
  return features;
}

PlaneSize FeatureFile::ReadImageSize(const std::string& image_name) const {
  if (const auto& map = impl_->map) {
    const Camera& camera = map->references()[map->IndexOf(image_name)].camera;
    return {camera.width_px(), camera.height_px()};
  }
  CheckHas(*impl_->file, image_name);
  return SizeOf(*impl_->file, image_name);
}

std::vector<std::string> FeatureFile::Warnings() const {
  const std::scoped_lock lock(impl_->mutex);
  if (impl_->coarse_images.empty()) {
    return {};
  }
  return {fmt::format(
      "{}: the keypoints are float16, which rounds them to 0.5 px beyond 512 px "
      "and to 1 px beyond 1024 px: {} images are that large, e.g. \"{}\"",
      impl_->file->path().string(), impl_->coarse_images.size(), *impl_->coarse_images.begin())};
}

void WriteFeatureFile(const std::filesystem::path& path,
                      const std::map<std::string, Features>& features_by_image,
                      bool half_descriptors) {
  Hdf5Writer file(path);
  for (const auto& [image, features] : features_by_image) {
    WriteFeatures(image, features, KindOf(half_descriptors), &file);
  }
  file.Commit();
}

void WriteFeatureFile(const std::filesystem::path& path, std::span<const std::string> image_names,
                      const std::function<Features(const std::string& image_name)>& features_of,
                      bool half_descriptors) {
  Hdf5Writer file(path);
  for (const std::string& image : image_names) {
    WriteFeatures(image, features_of(image), KindOf(half_descriptors), &file);
  }
  file.Commit();
}

Features AsStored(Features features, bool half_descriptors) {
  const auto stored = [](double coordinate) {
    return static_cast<double>(static_cast<float>(coordinate - kPixelShift)) + kPixelShift;
  };
  for (Eigen::Vector2d& pixel : features.keypoints_px) {
    pixel = {stored(pixel.x()), stored(pixel.y())};
  }
  if (half_descriptors) {
    features.descriptors = features.descriptors.cast<Eigen::half>().cast<float>();
  }
  return features;
}

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

void WriteGlobalDescriptors(const std::filesystem::path& path,
                            std::span<const std::string> image_names,
                            const Eigen::MatrixXf& descriptors) {
  RAYLIFT_CHECK_EQ(image_names.size(), static_cast<size_t>(descriptors.cols()));
  const auto size = static_cast<size_t>(descriptors.rows());
  Hdf5Writer file(path);
  for (size_t i = 0; i < image_names.size(); ++i) {
    file.WriteFloats(DatasetOf(image_names[i]), std::array{size},
                     {descriptors.data() + i * size, size}, Hdf5Kind::kFloat);
  }
  file.Commit();
}

}  // namespace raylift
