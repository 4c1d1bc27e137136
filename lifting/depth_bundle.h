// The depth maps of many images in one file, as networks write them: an array of N maps of depth or
// points, beside it perhaps confidences, and poses in a frame and scale of their own.

#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include "io/binary/array_file.h"
#include <Eigen/Core>

#include "raylift/io/depth_file.h"
#include "raylift/lifting/depth_source.h"

namespace raylift {

class DepthBundle {
 public:
  // Reads the file's arrays. Throws InputError naming file and array where one is absent or of a
  // shape that the convention does not mean.
  DepthBundle(const std::filesystem::path& file, const DepthConvention& convention);

  const std::filesystem::path& file() const { return file_; }
  bool Has(const std::string& image_name) const { return index_.contains(image_name); }
  // Return what is stored of an image that the bundle has; of points, their depth.
  StoredDepth Map(const PosedImage& image) const;
  std::optional<StoredDepth> Confidence(const PosedImage& image) const;
  bool has_confidences() const { return confidences_.has_value(); }
  // Says why the confidences that a preset knows are not used; empty where they are, or none are
  // there.
  const std::string& without_confidences() const { return without_confidences_; }

  // Throws InputError where points lie along the rays of their pixels in another frame than the
  // stated one.
  void CheckPoints(const PosedImage& image) const;

  // The scale of the maps by their poses.
  struct Scale {
    double factor = 1;       // to scene units
    std::string found = {};  // a clause
    std::vector<std::string> warnings = {};
  };
  // Aligns the poses of these images to their own. The factor is 1 where there are no poses or they
  // do not agree.
  Scale FindScale(std::span<const PosedImage> images) const;

  // Returns "24 maps of float32 504 x 378".
  std::string Description() const;

 private:
  using Order = std::unordered_map<std::string, size_t>;
  using PointTransform = Eigen::Matrix<float, 3, 4>;
  PointTransform CamFromPoints(const PosedImage& image, PointFrame frame,
                               PoseConvention poses) const;
  StoredDepth Slice(const NpyArray<float>& array, const std::string& name) const;
  // Returns the pose of an image in the stated convention.
  Rigid3 PoseOf(const std::string& image_name, PoseConvention convention) const;

  std::filesystem::path file_;
  std::string layer_;
  BundleLayout layout_;
  NpyArray<float> maps_;
  std::optional<NpyArray<float>> confidences_;
  std::string without_confidences_;
  std::vector<Rigid3> poses_;  // as stored; empty: there are none
  Order index_;
};

}  // namespace raylift
