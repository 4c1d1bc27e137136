#include "lifting/depth_bundle.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/read_limits.h"
#include "lifting/frame_alignment.h"
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {
namespace {

using std::filesystem::path;

constexpr std::string_view kNpy = ".npy";
constexpr uint64_t kPointSize = 3;

// Reads arrays by name; those of an NPY are the files beside it.
class Arrays {
 public:
  explicit Arrays(const path& file) : file_(file), is_npy_(file.extension() == kNpy), own_(file) {}

  std::string LayerOf(const std::string& wanted) const {
    if (is_npy_) return ArrayFile::kOnlyArray;
    if (!wanted.empty()) return wanted;
    return own_.names().size() == 1 ? *own_.names().begin() : "depth";
  }

  bool Has(const std::string& name) const {
    return IsBeside(name) ? IsFile(Beside(name)) : own_.Has(name);
  }

  NpyArray<float> Read(const std::string& name) const {
    return IsBeside(name) ? ArrayFile(Beside(name)).Read<float>(ArrayFile::kOnlyArray)
                          : own_.Read<float>(name);
  }

  [[noreturn]] void FailShape(const std::string& name, const std::vector<uint64_t>& shape,
                              std::string_view expected, std::string_view remedy = {}) const {
    Fail(name, fmt::format("expected {}, found an array of shape ({}){}", expected,
                           fmt::join(shape, ", "), remedy));
  }
  [[noreturn]] void Fail(const std::string& name, std::string_view message) const {
    throw InputError(IsBeside(name) ? Beside(name) : file_,
                     name.empty() ? file_.stem().string() : name, message);
  }

 private:
  bool IsBeside(const std::string& name) const { return is_npy_ && name != ArrayFile::kOnlyArray; }
  path Beside(const std::string& name) const {
    return file_.parent_path() / (name + std::string(kNpy));
  }

  path file_;
  bool is_npy_;
  ArrayFile own_;
};

// Makes (N, H, W) of (N, H, W, 1) and (N, 1, H, W), and of the (H, W) that is left of one map.
std::vector<uint64_t> MapShape(std::vector<uint64_t> shape) {
  if (shape.size() > 2 && shape.back() == 1) shape.pop_back();
  if (shape.size() == 4 && shape[1] == 1) shape.erase(shape.begin() + 1);
  if (shape.size() == 2) shape.insert(shape.begin(), 1);
  return shape;
}

std::vector<uint64_t> PointShape(std::vector<uint64_t> shape) {
  if (shape.size() == 3) shape.insert(shape.begin(), 1);
  return shape;
}

bool HasPixels(const std::vector<uint64_t>& shape) {
  return shape[0] > 0 && shape[1] > 0 && shape[2] > 0 &&
         std::max(shape[1], shape[2]) <= kMaxImageSidePx;
}

std::string OfWhichImages(const BundleLayout& layout) {
  return layout.names_file.empty()
             ? fmt::format("the {} references in the order of their names", layout.names.size())
             : fmt::format("the {} images that {} lists", layout.names.size(),
                           layout.names_file.string());
}

NpyArray<float> ReadMaps(const Arrays& arrays, const std::string& name,
                         const BundleLayout& layout) {
  NpyArray<float> maps = arrays.Read(name);
  const std::vector<uint64_t> stored = maps.shape;
  maps.shape = MapShape(std::move(maps.shape));
  const bool has_form = maps.shape.size() == 3 && HasPixels(maps.shape);
  if (has_form && maps.shape[0] == layout.names.size()) return maps;
  const bool are_points = stored.size() > 2 && stored.back() == kPointSize;
  arrays.FailShape(
      name, stored,
      fmt::format("a map of each of {}, shape (N, height, width)", OfWhichImages(layout)),
      are_points                              ? "; points=FRAME says whose axes points are in"
      : has_form && layout.names_file.empty() ? "; names=FILE lists whose maps they are"
                                              : "");
}

NpyArray<float> ReadPoints(const Arrays& arrays, const std::string& name,
                           const BundleLayout& layout) {
  NpyArray<float> points = arrays.Read(name);
  const std::vector<uint64_t> stored = points.shape;
  points.shape = PointShape(std::move(points.shape));
  if (points.shape.size() == 4 && points.shape[3] == kPointSize && HasPixels(points.shape) &&
      points.shape[0] == layout.names.size()) {
    return points;
  }
  arrays.FailShape(
      name, stored,
      fmt::format("points of each of {}, shape (N, height, width, 3)", OfWhichImages(layout)));
}

std::vector<Rigid3> ReadPoses(const Arrays& arrays, const BundleLayout& layout) {
  constexpr double kMaxFromOrthonormal = 1e-2;  // float16 is good to 1e-3
  NpyArray<float> stored = arrays.Read(layout.poses);
  std::vector<uint64_t>& shape = stored.shape;
  if (shape.size() == 2) shape.insert(shape.begin(), 1);  // of the only image
  if (shape.size() != 3 || shape[0] != layout.names.size() || shape[1] < 3 || shape[1] > 4 ||
      shape[2] != 4) {
    arrays.FailShape(
        layout.poses, shape,
        fmt::format("a pose of each of {}, shape (N, 3, 4) or (N, 4, 4)", OfWhichImages(layout)));
  }
  std::vector<Rigid3> poses;
  for (size_t i = 0; i < layout.names.size(); ++i) {
    const Eigen::Map<const Eigen::Matrix<float, 3, 4, Eigen::RowMajor>> rows(
        stored.values.data() + i * shape[1] * shape[2]);
    const Eigen::Matrix3d rotation = rows.leftCols<3>().cast<double>();
    const double off = (rotation * rotation.transpose() - Eigen::Matrix3d::Identity()).norm();
    if (!rows.allFinite() || !(off < kMaxFromOrthonormal) || rotation.determinant() < 0) {
      arrays.Fail(layout.poses,
                  fmt::format("expected poses, found no rotation in that of {}", layout.names[i]));
    }
    poses.push_back({Eigen::Quaterniond(rotation).normalized(), rows.col(3).cast<double>()});
  }
  return poses;
}

std::unordered_map<std::string, size_t> OrderOf(const std::vector<std::string>& names) {
  std::unordered_map<std::string, size_t> order;
  for (size_t i = 0; i < names.size(); ++i) order.emplace(names[i], i);
  return order;
}

// Says whether a name comes before another where 9 comes before 10.
bool IsBeforeByNumbers(std::string_view a, std::string_view b) {
  const auto digits = [](std::string_view text) {
    return std::min(text.find_first_not_of("0123456789"), text.size());
  };
  while (!a.empty() && !b.empty()) {
    const size_t in_a = digits(a), in_b = digits(b);
    if (in_a > 0 && in_b > 0 && in_a != in_b) return in_a < in_b;
    if (a.front() != b.front()) return a.front() < b.front();
    a.remove_prefix(1);
    b.remove_prefix(1);
  }
  return a.size() < b.size();
}

class Correlation {
 public:
  void Add(double x, double y) {
    ++count_;
    const double dx = x - mean_x_, dy = y - mean_y_;
    mean_x_ += dx / count_;
    mean_y_ += dy / count_;
    xx_ += dx * (x - mean_x_);
    yy_ += dy * (y - mean_y_);
    xy_ += dx * (y - mean_y_);
  }
  double count() const { return count_; }
  double Value() const { return xx_ > 0 && yy_ > 0 ? xy_ / std::sqrt(xx_ * yy_) : 0; }

 private:
  double count_ = 0, mean_x_ = 0, mean_y_ = 0, xx_ = 0, yy_ = 0, xy_ = 0;
};

// Returns the lesser of the correlations of x/z with the column and of y/z with the row: 1 of
// points before a pinhole camera, whatever its intrinsics, and less through a distorted lens.
// `points` are x, y, z, row by row; 0 where few of them are before the camera.
double AgreementWithRays(std::span<const float> points, PlaneSize size,
                         const Eigen::Matrix<float, 3, 4>& cam_from_points) {
  constexpr float kMaxTangent = 4;  // 76 degrees from the axis
  Correlation columns, rows;
  double asked = 0;
  for (int y = 0; y < size.height_px; ++y) {
    for (int x = 0; x < size.width_px; ++x) {
      const size_t i =
          static_cast<size_t>(y) * static_cast<size_t>(size.width_px) + static_cast<size_t>(x);
      const Eigen::Map<const Eigen::Vector3f> stored(points.data() + 3 * i);
      if (stored.isZero(0) || !stored.allFinite()) continue;
      ++asked;
      const Eigen::Vector3f point = cam_from_points * stored.homogeneous();
      if (!(point.head<2>().cwiseAbs().maxCoeff() < kMaxTangent * point.z())) continue;
      columns.Add(x, static_cast<double>(point.x() / point.z()));
      rows.Add(y, static_cast<double>(point.y() / point.z()));
    }
  }
  return 2 * columns.count() > asked ? std::min(columns.Value(), rows.Value()) : 0;
}

}  // namespace

DepthBundle::DepthBundle(const path& file, const DepthConvention& convention)
    : file_(file), layout_(convention.bundle) {
  const Arrays arrays(file);
  layer_ = arrays.LayerOf(convention.layer);
  maps_ = layout_.points ? ReadPoints(arrays, layer_, layout_) : ReadMaps(arrays, layer_, layout_);
  // A preset's tool may have written neither confidences nor poses.
  const std::string& confidences = convention.confidence_pattern;
  const bool are_asked_for = convention.confidence_threshold.has_value();
  if (!confidences.empty() && (are_asked_for || arrays.Has(confidences))) {
    try {
      confidences_ = ReadMaps(arrays, confidences, layout_);
    } catch (const InputError& error) {
      if (are_asked_for) throw;
      without_confidences_ = error.what();
    }
  }
  const bool is_preset = !layout_.files.empty();
  if (!layout_.poses.empty() && (!is_preset || arrays.Has(layout_.poses))) {
    poses_ = ReadPoses(arrays, layout_);
  }
  index_ = OrderOf(layout_.names);
}

Rigid3 DepthBundle::PoseOf(const std::string& image_name, PoseConvention convention) const {
  return CamFromWorld(poses_[index_.at(image_name)], convention);
}

StoredDepth DepthBundle::Slice(const NpyArray<float>& array, const std::string& name) const {
  StoredDepth stored;
  stored.width_px = static_cast<int>(array.shape[2]);
  stored.height_px = static_cast<int>(array.shape[1]);
  const size_t count = array.values.size() / array.shape[0];
  const auto begin = array.values.begin() + static_cast<std::ptrdiff_t>(index_.at(name) * count);
  stored.values.assign(begin, begin + static_cast<std::ptrdiff_t>(count));
  stored.format = layer_.empty() ? DepthFileFormat::kNpy : DepthFileFormat::kNpz;
  stored.sample_type = array.sample_type;
  stored.layer = layer_;
  return stored;
}

DepthBundle::PointTransform DepthBundle::CamFromPoints(const PosedImage& image, PointFrame frame,
                                                       PoseConvention poses) const {
  PointTransform transform = PointTransform::Identity();
  if (frame == PointFrame::kOpenGlCamera) transform.diagonal() << 1, -1, -1;
  if (frame == PointFrame::kWorld) {
    const Rigid3 pose = poses_.empty() ? image.cam_from_world : PoseOf(image.name, poses);
    transform << pose.rotation.toRotationMatrix().cast<float>(), pose.translation.cast<float>();
  }
  return transform;
}

StoredDepth DepthBundle::Map(const PosedImage& image) const {
  StoredDepth map = Slice(maps_, image.name);
  if (!layout_.points) return map;
  const Eigen::RowVector4f z_of_point =
      CamFromPoints(image, *layout_.points, layout_.pose_convention).row(2);
  for (size_t i = 0; i < map.values.size() / kPointSize; ++i) {
    const Eigen::Map<const Eigen::Vector3f> point(map.values.data() + i * kPointSize);
    // Zeros are what masks leave of points.
    map.values[i] = point.isZero(0) ? 0 : z_of_point.dot(point.homogeneous());
  }
  map.values.resize(map.values.size() / kPointSize);
  return map;
}

void DepthBundle::CheckPoints(const PosedImage& image) const {
  constexpr double kAgree = 0.97, kDisagree = 0.9;  // a distorted lens has 0.99
  if (!layout_.points || image.camera.is_panorama()) return;
  const StoredDepth points = Slice(maps_, image.name);
  const auto agreement = [&](PointFrame frame, PoseConvention poses) {
    return AgreementWithRays(points.values, {points.width_px, points.height_px},
                             CamFromPoints(image, frame, poses));
  };
  if (agreement(*layout_.points, layout_.pose_convention) > kDisagree) return;
  for (const PointFrame frame : AllValues<PointFrame>()) {
    const bool by_poses = frame == PointFrame::kWorld && !poses_.empty();
    for (const PoseConvention poses : AllValues<PoseConvention>()) {
      if ((poses != layout_.pose_convention && !by_poses) || agreement(frame, poses) < kAgree) {
        continue;
      }
      throw InputError(
          file_, layer_,
          fmt::format("expected points of the frame \"{}\" along their pixels' rays, found those "
                      "of points={}{}",
                      ToString(*layout_.points), ToString(frame),
                      by_poses ? fmt::format(",poses_are={}", ToString(poses)) : ""));
    }
  }
}

std::optional<StoredDepth> DepthBundle::Confidence(const PosedImage& image) const {
  if (!confidences_) return std::nullopt;
  return Slice(*confidences_, image.name);
}

DepthBundle::Scale DepthBundle::FindScale(std::span<const PosedImage> images) const {
  Scale scale;
  if (poses_.empty()) return scale;
  std::vector<Rigid3> cam_from_world;
  for (const PosedImage& image : images) {
    if (Has(image.name)) cam_from_world.push_back(image.cam_from_world);
  }
  const auto align = [&](PoseConvention convention, const Order& order) {
    std::vector<Rigid3> cam_from_frame;
    for (const PosedImage& image : images) {
      if (Has(image.name)) {
        cam_from_frame.push_back(CamFromWorld(poses_[order.at(image.name)], convention));
      }
    }
    return AlignFrame(cam_from_frame, cam_from_world);
  };
  if (cam_from_world.size() < 3) return scale;
  const auto found = align(layout_.pose_convention, index_);
  const auto is_far_better = [&](const std::optional<FrameAlignment>& other) {
    constexpr double kFar = 5;  // poses shifted in a list still agree roughly
    return other && (!found || (other->num_agreeing >= found->num_agreeing &&
                                kFar * other->relative_sigma < found->relative_sigma));
  };
  std::string but;
  for (const PoseConvention other : AllValues<PoseConvention>()) {
    if (!but.empty() || !is_far_better(align(other, index_))) continue;
    but = fmt::format("; as {} they do (poses_are={})", TitleOf(other), ToString(other));
  }
  std::vector<std::string> names = layout_.names;
  std::ranges::sort(names, IsBeforeByNumbers);
  if (but.empty() && is_far_better(align(layout_.pose_convention, OrderOf(names)))) {
    but = "; in the order of the numbers in their names they do (names=FILE lists it)";
  }
  if (!found || !but.empty()) {
    scale.warnings.push_back(fmt::format(
        "{}: {}: the poses do not agree with those of the references under any similarity{}",
        file_.string(), layout_.poses, but));
    return scale;
  }
  scale.factor = found->scale;
  scale.found = fmt::format(
      "x {:.4g} +- {:.2g} % by {} of its {} poses, which agree with the references' to {:.2g}",
      found->scale, 100 * found->relative_sigma, found->num_agreeing, cam_from_world.size(),
      found->position_sigma);
  return scale;
}

std::string DepthBundle::Description() const {
  return fmt::format("{} maps of {}{} {} x {}", maps_.shape[0], layout_.points ? "points, " : "",
                     maps_.sample_type, maps_.shape[2], maps_.shape[1]);
}

}  // namespace raylift
