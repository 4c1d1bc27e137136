// The cameras of transforms.json, of which two tools have dialects: nerfstudio
// (nerfstudio/cameras/camera_utils.py: camera_model, distortion_params) and instant-ngp
// (src/nerf_loader.cu, read_lens: is_fisheye, x_fov).

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/read_limits.h"
#include "datasets/importers.h"
#include "io/text/json_document.h"
#include <Eigen/QR>
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

struct Intrinsics {
  double width_px, height_px;
  double focal_x, focal_y, cx, cy;
};

Camera MakeCameraOf(CameraModel model, const Intrinsics& k, const std::vector<double>& lens) {
  std::vector<double> params = {k.focal_x, k.focal_y, k.cx, k.cy};
  params.insert(params.end(), lens.begin(), lens.end());
  return Camera(model, static_cast<int>(k.width_px), static_cast<int>(k.height_px), params);
}

// Returns 1 + k1 q + k2 q^2 + k3 q^3 + k4 q^4.
double Polynomial4(const std::vector<double>& d, double q) {
  return 1 + q * (d[0] + q * (d[1] + q * (d[2] + q * d[3])));
}

// Returns |u|^2 of the point that is distorted to the farthest corner; less where the lens folds
// before.
double SquaredRadiusOfCorner(const Intrinsics& k, const std::vector<double>& d) {
  const double x = std::max(k.cx, k.width_px - k.cx) / k.focal_x;
  const double y = std::max(k.cy, k.height_px - k.cy) / k.focal_y;
  const double corner = std::hypot(x, y);
  constexpr int kNumSteps = 4000;
  double distorted = 0, radius = 0;
  for (int i = 1; i <= kNumSteps && distorted < corner; ++i) {
    const double next = 4 * corner * i / kNumSteps;
    const double there = next * Polynomial4(d, next * next);
    if (there <= distorted) break;
    radius = next;
    distorted = there;
  }
  return radius * radius;
}

// Returns the FULL_OPENCV camera nearest to nerfstudio's lens, whose k4 multiplies r^8 (as
// Metashape's does), as that of no perspective camera of COLMAP does. Throws InputError where the
// two differ by more than a hundredth of a pixel.
Camera FitFullOpenCv(const Intrinsics& k, const std::vector<double>& d) {
  constexpr int kNumNodes = 200;
  constexpr double kMaxErrorPx = 0.01;
  const double q_max = SquaredRadiusOfCorner(k, d);
  Eigen::MatrixXd rows(kNumNodes, 6);
  Eigen::VectorXd values(kNumNodes);
  for (int i = 0; i < kNumNodes; ++i) {
    const double s = (i + 1.0) / kNumNodes;
    const double p = Polynomial4(d, s * q_max);
    // The pixel moves by the root of q.
    rows.row(i) << s, s * s, s * s * s, -p * s, -p * s * s, -p * s * s * s;
    rows.row(i) *= std::sqrt(s);
    values[i] = (p - 1) * std::sqrt(s);
  }
  const Eigen::VectorXd c = rows.completeOrthogonalDecomposition().solve(values);
  const double q2 = q_max * q_max, q3 = q2 * q_max;
  const Camera camera = MakeCameraOf(
      CameraModel::kFullOpenCv, k,
      {c[0] / q_max, c[1] / q2, d[4], d[5], c[2] / q3, c[3] / q_max, c[4] / q2, c[5] / q3});
  double largest_px = 0;
  for (int i = 1; i <= 4 * kNumNodes; ++i) {
    const double s = 0.25 * i / kNumNodes;
    const double numerator = 1 + s * (c[0] + s * (c[1] + s * c[2]));
    const double denominator = 1 + s * (c[3] + s * (c[4] + s * c[5]));
    const double error = numerator / denominator - Polynomial4(d, s * q_max);
    largest_px = std::max(largest_px,
                          std::abs(error) * std::sqrt(s * q_max) * std::max(k.focal_x, k.focal_y));
  }
  if (!(largest_px <= kMaxErrorPx)) {
    throw InputError(fmt::format(
        "k4 = {}: multiplies r^8, and FULL_OPENCV would be {:.3g} px from it", d[3], largest_px));
  }
  return camera;
}

Camera MakePerspective(const Intrinsics& k, const std::vector<double>& d) {
  if (d[3] != 0) return FitFullOpenCv(k, d);
  if (d[2] != 0) {
    return MakeCameraOf(CameraModel::kFullOpenCv, k, {d[0], d[1], d[4], d[5], d[2], 0, 0, 0});
  }
  const bool is_pinhole = std::all_of(d.begin(), d.end(), [](double x) { return x == 0; });
  if (is_pinhole) return MakeCameraOf(CameraModel::kPinhole, k, {});
  return MakeCameraOf(CameraModel::kOpenCv, k, {d[0], d[1], d[4], d[5]});
}

Camera MakeFisheye(const Intrinsics& k, const std::vector<double>& d) {
  if (d[4] == 0 && d[5] == 0) {
    return MakeCameraOf(CameraModel::kOpenCvFisheye, k, {d[0], d[1], d[2], d[3]});
  }
  return MakeCameraOf(CameraModel::kThinPrismFisheye, k,
                      {d[0], d[1], d[4], d[5], d[2], d[3], 0, 0});
}

// Makes a panorama: nerfstudio's azimuth is pi (x - cx) / fx, its elevation pi (cy - y) / fy.
Camera MakePanorama(const Intrinsics& k) {
  const auto is = [](double a, double b) { return std::abs(a - b) < 0.5; };
  if (!is(k.focal_x, 0.5 * k.width_px) || !is(k.focal_y, k.height_px) ||
      !is(k.cx, 0.5 * k.width_px) || !is(k.cy, 0.5 * k.height_px)) {
    throw InputError("EQUIRECTANGULAR: expected fl_x = w / 2, fl_y = h, cx = w / 2, cy = h / 2");
  }
  return Camera(CameraModel::kEquirectangular, static_cast<int>(k.width_px),
                static_cast<int>(k.height_px), std::vector<double>{k.width_px, k.height_px});
}

// The camera of a frame: every number is the frame's own, else the one of the whole file.
class TransformsLens {
 public:
  TransformsLens(const JsonPlace& frame, const JsonPlace& root) : frame_(frame), root_(root) {}

  Camera MakeCamera(const std::function<PlaneSize()>& size_of_photograph) const;

 private:
  bool Has(std::string_view key) const { return frame_.Has(key) || root_.Has(key); }
  std::optional<double> Number(std::string_view key) const;
  double NumberOr(std::string_view key, double otherwise) const {
    return Number(key).value_or(otherwise);
  }
  std::optional<double> Focal(char axis, double side_px) const;
  std::string ModelName() const;
  // Returns k1 k2 k3 k4 p1 p2, or what distortion_params holds.
  std::vector<double> Distortion() const;

  const JsonPlace& frame_;
  const JsonPlace& root_;
};

std::optional<double> TransformsLens::Number(std::string_view key) const {
  for (const JsonPlace* place : {&frame_, &root_}) {
    if (!place->Has(key)) continue;
    const JsonPlace value = place->Member(key);
    return value.Number();
  }
  return std::nullopt;
}

// Returns the focal length in pixels, from fl_x in pixels, camera_angle_x in radians or x_fov in
// degrees; of y likewise.
std::optional<double> TransformsLens::Focal(char axis, double side_px) const {
  if (const auto focal = Number(fmt::format("fl_{}", axis))) return focal;
  if (const auto angle = Number(fmt::format("camera_angle_{}", axis))) {
    return 0.5 * side_px / std::tan(0.5 * *angle);
  }
  if (const auto fov_deg = Number(fmt::format("{}_fov", axis))) {
    return 0.5 * side_px / std::tan(0.5 * *fov_deg * std::numbers::pi / 180);
  }
  return std::nullopt;
}

std::string TransformsLens::ModelName() const {
  for (const std::string_view key : {"ftheta_p0", "latlong", "equirectangular", "orthographic"}) {
    if (Has(key)) frame_.Fail(fmt::format("{}: this lens of instant-ngp is not read", key));
  }
  std::string model;
  for (const JsonPlace* place : {&frame_, &root_}) {
    if (!model.empty() || !place->Has("camera_model")) continue;
    const JsonPlace value = place->Member("camera_model");
    model = value.String();
  }
  const JsonPlace* says = frame_.Has("is_fisheye") ? &frame_ : &root_;
  if (!says->Has("is_fisheye")) return model.empty() ? "OPENCV" : model;
  const JsonPlace value = says->Member("is_fisheye");
  const bool is_fisheye = value.Bool();
  if (model.empty()) return is_fisheye ? "OPENCV_FISHEYE" : "OPENCV";
  if (is_fisheye != (model.find("FISHEYE") != std::string::npos)) {
    frame_.Fail(fmt::format("is_fisheye = {}, but camera_model = {}", is_fisheye, model));
  }
  return model;
}

std::vector<double> TransformsLens::Distortion() const {
  for (const JsonPlace* place : {&frame_, &root_}) {
    if (!place->Has("distortion_params")) continue;
    const JsonPlace list = place->Member("distortion_params");
    std::vector<double> params;
    for (size_t i = 0; i < list.ArraySize(); ++i) {
      const JsonPlace element = list.At(i);
      params.push_back(element.Number());
    }
    if (params.size() != 6 && params.size() != 12) {
      list.Fail(fmt::format("expected k1 k2 k3 k4 p1 p2, or 12 of FISHEYE624, found {} numbers",
                            params.size()));
    }
    return params;
  }
  std::vector<double> params;
  for (const std::string_view key : {"k1", "k2", "k3", "k4", "p1", "p2"}) {
    params.push_back(NumberOr(key, 0));
  }
  return params;
}

Camera TransformsLens::MakeCamera(const std::function<PlaneSize()>& size_of_photograph) const {
  const PlaneSize photo = Has("w") && Has("h") ? PlaneSize() : size_of_photograph();
  Intrinsics k{};
  k.width_px = NumberOr("w", photo.width_px);
  k.height_px = NumberOr("h", photo.height_px);
  if (!(k.width_px >= 1 && k.width_px <= kMaxImageSidePx && k.height_px >= 1 &&
        k.height_px <= kMaxImageSidePx)) {
    frame_.Fail("w, h: expected a size in pixels");
  }
  const auto focal_x = Focal('x', k.width_px), focal_y = Focal('y', k.height_px);
  const std::string model = ModelName();
  k.cx = NumberOr("cx", 0.5 * k.width_px);
  k.cy = NumberOr("cy", 0.5 * k.height_px);
  if (!focal_x && !focal_y) {
    frame_.Fail("expected fl_x, camera_angle_x or x_fov, in the frame or for all");
  }
  k.focal_x = focal_x ? *focal_x : *focal_y;
  k.focal_y = focal_y ? *focal_y : *focal_x;
  const std::vector<double> lens = Distortion();
  const bool is_624 = model == "FISHEYE624";
  if (is_624 != (lens.size() == 12)) {
    frame_.Fail("distortion_params: FISHEYE624 alone has 12 (k0 to k5 p0 p1 s0 to s3)");
  }
  try {
    if (is_624) return MakeCameraOf(CameraModel::kRadTanThinPrismFisheye, k, lens);
    if (model == "OPENCV_FISHEYE") return MakeFisheye(k, lens);
    if (model == "EQUIRECTANGULAR") return MakePanorama(k);
    for (const std::string_view name :
         {"OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL"}) {
      if (model == name) return MakePerspective(k, lens);
    }
  } catch (const InputError& error) {
    frame_.Fail(error.what());
  }
  frame_.Fail(
      fmt::format("camera_model: expected OPENCV, OPENCV_FISHEYE, FISHEYE624, PINHOLE, "
                  "SIMPLE_PINHOLE, SIMPLE_RADIAL, RADIAL or EQUIRECTANGULAR, found \"{}\"",
                  model));
}

}  // namespace

Camera CameraOfTransforms(const JsonPlace& frame, const JsonPlace& root,
                          const std::function<PlaneSize()>& size_of_photograph) {
  return TransformsLens(frame, root).MakeCamera(size_of_photograph);
}

}  // namespace raylift
