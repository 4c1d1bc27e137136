// Depth maps as a source of geometry: the meaning of the numbers in a folder of maps, the folder,
// and the source that lifts pixels by it. Every pipeline has its own convention (z or the length of
// the ray, meters or millimeters, holes as 0, 65535 or infinity); each map is converted once, when
// it is loaded, to that of DepthMap.

#pragma once

#include <cstddef>
#include <filesystem>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/base/enum_names.h"
#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/lifting/geometry_source.h"
#include "raylift/scene/image.h"
#include "raylift/scene/photographs.h"

namespace raylift {

enum class DepthKind {
  kZ,        // along the optical axis
  kRay,      // along the ray of each pixel, from the camera's center
  kInverse,  // 1 / z
};
template <>
inline constexpr auto kEnumNames<DepthKind> = std::to_array<EnumName<DepthKind>>({
    {DepthKind::kZ, "z"},
    {DepthKind::kRay, "ray", "ray length"},
    {DepthKind::kInverse, "inverse", "inverse depth"},
});

// The order of a file's samples in the image; each order is its own inverse.
enum class MapOrientation {
  kAsStored,
  kFlippedX,    // left and right exchanged
  kFlippedY,    // the bottom row first
  kHalfTurn,    // both
  kTransposed,  // columns first
};
template <>
inline constexpr auto kEnumNames<MapOrientation> = std::to_array<EnumName<MapOrientation>>({
    {MapOrientation::kAsStored, "as_stored", "as stored"},
    {MapOrientation::kFlippedX, "flipped_x", "left and right exchanged"},
    {MapOrientation::kFlippedY, "flipped_y", "top and bottom exchanged"},
    {MapOrientation::kHalfTurn, "half_turn", "upside down"},
    {MapOrientation::kTransposed, "transposed"},
});

// The part of its image that a map covers.
enum class MapFit {
  kWhole,      // all of it, stretched to the map's size
  kCrop,       // the image was scaled to cover the map, rounded, and cut about its middle
  kCropFloor,  // the same, rounded down
  // These round to multiples of 14.
  kWidth,  // its whole width; height is cut or padded about its middle
  kPad,    // all of it, padded about its middle
};
template <>
inline constexpr auto kEnumNames<MapFit> = std::to_array<EnumName<MapFit>>({
    {MapFit::kWhole, "whole"},
    {MapFit::kCrop, "crop"},
    {MapFit::kCropFloor, "crop_floor"},
    {MapFit::kWidth, "width"},
    {MapFit::kPad, "pad"},
});

// A sensor that stands beside the photograph's camera.
struct DepthSensor {
  Camera camera;
  Rigid3 image_from_sensor;  // from the sensor's frame to that of the photograph's camera
};

// The frame of a map of points, whose z is then the depth.
enum class PointFrame {
  kCamera,        // x right, y down, z forward
  kOpenGlCamera,  // y up, z backward
  kWorld,         // that of the poses beside them
};
template <>
inline constexpr auto kEnumNames<PointFrame> = std::to_array<EnumName<PointFrame>>({
    {PointFrame::kCamera, "camera"},
    {PointFrame::kOpenGlCamera, "opengl_camera"},
    {PointFrame::kWorld, "world"},
});

// The maps of many images in one file.
struct BundleLayout {
  // Paths of the file, relative to the folder (which may itself be such a file), in the order of
  // preference.
  std::vector<std::string> files = {};
  // These are the images whose maps it holds, in their order, and the file that says it, if one
  // does.
  std::vector<std::string> names = {};
  std::filesystem::path names_file = {};
  std::optional<PointFrame> points = std::nullopt;  // the array is one of points, (N, H, W, 3)
  // Names the array of poses in a frame and scale of their own, (N, 3, 4) or (N, 4, 4); empty where
  // there is none.
  std::string poses = {};
  PoseConvention pose_convention = PoseConvention::kCamFromWorld;
};

struct DepthConvention {
  DepthKind kind = DepthKind::kZ;
  MapOrientation orientation = MapOrientation::kAsStored;
  // A stored 1 is so many scene units (with kInverse: 1 / scene units). With nullopt it is 1 where
  // the file holds floats, and 0.001 (millimeters) where it holds integers.
  std::optional<double> unit = std::nullopt;
  double scale = 1;  // times this, for whole sources whose scale is off
  // These stored values mean no depth; values that are not finite or not positive always do.
  std::vector<double> invalid_values = {};
  double max_depth = std::numeric_limits<double>::infinity();  // scene units; beyond: none

  // These are patterns of the path of an image's map, relative to the folder, in the order of
  // preference. "{name}" is the image's name in the model, "{dir}" its folder, "{stem}" its file
  // name without extension, "{base}" that up to the first dot, "{flat}" the folder and {base}
  // joined by "_", "{flat7}" the same without the folder's "-", "{time}" the number in the folder
  // nearest to {stem} as seconds (within 20 ms). If there are none, the usual ones are tried.
  std::vector<std::string> patterns = {};
  BundleLayout bundle = {};
  MapFit fit = MapFit::kWhole;
  std::string layer = {};   // the channel of an EXR, the key of an NPZ
  bool headerless = false;  // plain floats, of `raw_size` or else of the image's size
  std::optional<PlaneSize> raw_size = std::nullopt;

  // The sensor that the maps are of where it is not the photograph's camera: they are warped into
  // the photograph.
  std::optional<DepthSensor> sensor = std::nullopt;

  // Pattern of a second map that says how far each depth can be trusted; depths below the threshold
  // are dropped. The worth of the confidences above it is learned (depth_confidence.h).
  std::string confidence_pattern = {};  // of a bundle: the array's name; empty: there is none
  // Depths of a lower confidence, in stored values, are dropped; with nullopt none is.
  std::optional<double> confidence_threshold = 0.5;
};

// The depth maps of the references of a scene, found, loaded and converted when they are needed.
class DepthFolder {
 public:
  // Finds the maps of these references: one file each in a folder, or all in one file. Throws
  // InputError where there is none at all. One map is read, so that a wrong format is noticed at
  // once.
  DepthFolder(std::filesystem::path folder, DepthConvention convention,
              std::span<const PosedImage> references, size_t max_cache_bytes = size_t{1} << 29);
  ~DepthFolder();

  // Returns the converted map of a reference; null where there is none. Maps are kept while the
  // cache has room. Thread safe: a map is read once even where many threads ask for it.
  std::shared_ptr<const DepthMap> Load(const PosedImage& reference) const;
  // Returns whether there are confidences for the pixels of references; those of a sensor are for
  // the sensor's own pixels.
  bool HasConfidences() const;
  // Returns the confidences of a reference's map, as stored; null where there are none.
  std::shared_ptr<const DepthMap> LoadConfidence(const PosedImage& reference) const;

  // Says how the files were read ("PNG uint16 640 x 480, z, 1 is 0.001").
  const std::string& interpretation() const { return interpretation_; }
  // Returns the size of the first reference's map, oriented as the image.
  PlaneSize size_px() const { return size_px_; }
  // Returns the scene units of a stored 1 (of kInverse: 1 / scene units), with the scale, of the
  // first reference's map.
  double unit() const { return unit_; }
  const DepthConvention& convention() const;
  // Returns warnings for the user: references without a map, a unit that was guessed.
  const std::vector<std::string>& warnings() const { return warnings_; }

 private:
  void LookAt(const PosedImage& first);

  struct Impl;
  std::unique_ptr<Impl> impl_;
  std::string interpretation_;
  PlaneSize size_px_;
  double unit_ = 1;
  std::vector<std::string> warnings_;
};

enum class DepthInterpolation { kEdgeAware, kNearest };
template <>
inline constexpr auto kEnumNames<DepthInterpolation> = std::to_array<EnumName<DepthInterpolation>>({
    {DepthInterpolation::kEdgeAware, "edge"},
    {DepthInterpolation::kNearest, "nearest"},
});

struct DepthSamplingOptions {
  DepthInterpolation interpolation = DepthInterpolation::kEdgeAware;
  double max_jump = 0.05;  // relative, from pixel to pixel
  // The position of a map's first sample, in its pixels: 0.5 where samples are at pixel centers, 0
  // where the map was made for integer coordinates. For LiftByDepthMap; SampleDepth takes positions
  // with centers at 0.5.
  double first_sample_px = 0.5;
};

class DepthSource final : public GeometrySource {
 public:
  DepthSource(std::string description, std::shared_ptr<const DepthFolder> maps,
              const DepthSamplingOptions& sampling = {}, const SurfaceLimits& limits = {});

  std::string Description() const override;
  std::vector<std::optional<SurfacePoint>> Lift(
      const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const override;

 private:
  std::string description_;
  std::shared_ptr<const DepthFolder> maps_;
  DepthSamplingOptions sampling_;
  SurfaceLimits limits_;
};

// Lifts pixels by one map that is already in memory.
std::vector<std::optional<SurfacePoint>> LiftByDepthMap(const DepthMap& map,
                                                        const PosedImage& reference,
                                                        std::span<const Eigen::Vector2d> pixels,
                                                        const DepthSamplingOptions& options = {});

}  // namespace raylift
