#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

#include "base/json_text.h"
#include "base/statistics.h"
#include "views/job_files.h"
#include <Eigen/Core>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/parallel.h"
#include "raylift/base/text.h"
#include "raylift/geometry/camera.h"

namespace raylift {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using Json = nlohmann::ordered_json;
using std::filesystem::path;

const ProductOutput* Find(const RenderJobOptions& options, Product product) {
  const auto found = std::find_if(options.products.begin(), options.products.end(),
                                  [&](const ProductOutput& p) { return p.product == product; });
  return found == options.products.end() ? nullptr : &*found;
}

// Returns the members of nerfstudio's file for a lens.
Json LensJson(const PosedImage& view) {
  const Camera& camera = view.camera;
  Json json = {{"camera_model", "OPENCV"},
               {"w", camera.width_px()},
               {"h", camera.height_px()},
               {"fl_x", camera.focal_x_px()},
               {"fl_y", camera.focal_y_px()},
               {"cx", camera.principal_point_px().x()},
               {"cy", camera.principal_point_px().y()}};
  const auto params = camera.params();
  const auto set = [&](size_t first, std::initializer_list<const char*> names) {
    for (const char* name : names) json[name] = params[first++];
  };
  switch (camera.model()) {
    case CameraModel::kSimplePinhole:
    case CameraModel::kPinhole:
      break;
    case CameraModel::kSimpleRadial:
      set(3, {"k1"});
      break;
    case CameraModel::kRadial:
      set(3, {"k1", "k2"});
      break;
    case CameraModel::kOpenCv:
      set(4, {"k1", "k2", "p1", "p2"});
      break;
    case CameraModel::kOpenCvFisheye:
      json["camera_model"] = "OPENCV_FISHEYE";
      set(4, {"k1", "k2", "k3", "k4"});
      break;
    default:
      throw InputError(fmt::format("transforms.json has no lens like that of {} ({})", view.name,
                                   view.camera.ToString()));
  }
  return json;
}

// Returns a pose in OpenGL's axes: x right, y up, z back.
Json PoseJson(const Rigid3& cam_from_world) {
  Eigen::Matrix4d world_from_gl = Eigen::Matrix4d::Identity();
  const Rigid3 world_from_cam = cam_from_world.Inverse();
  world_from_gl.topLeftCorner<3, 3>() =
      world_from_cam.rotation.toRotationMatrix() * Vector3d(1, -1, -1).asDiagonal();
  world_from_gl.topRightCorner<3, 1>() = world_from_cam.translation;
  Json rows = Json::array();
  for (const auto& row : world_from_gl.rowwise()) {
    rows.push_back({row[0], row[1], row[2], row[3]});
  }
  return rows;
}

std::string CameraText(const PosedImage& view, std::vector<double> depths) {
  constexpr int kDepths = 192;
  const Eigen::Matrix3d rotation = view.cam_from_world.rotation.toRotationMatrix();
  std::string text = "extrinsic\n";
  for (Eigen::Index r = 0; r < 3; ++r) {
    text += fmt::format("{} {} {} {}\n", rotation(r, 0), rotation(r, 1), rotation(r, 2),
                        view.cam_from_world.translation[r]);
  }
  const Camera& camera = view.camera;
  text += fmt::format("0 0 0 1\n\nintrinsic\n{} 0 {}\n0 {} {}\n0 0 1\n\n", camera.focal_x_px(),
                      camera.principal_point_px().x(), camera.focal_y_px(),
                      camera.principal_point_px().y());
  // A wall straight ahead has one depth, and planes are at several.
  constexpr double kLeastHalf = 0.005;
  const double middle = QuantileInPlace(std::span(depths), 0.5);
  const double low = std::min(QuantileInPlace(std::span(depths), 0.01), (1 - kLeastHalf) * middle);
  const double high = std::max(QuantileInPlace(std::span(depths), 0.99), (1 + kLeastHalf) * middle);
  return text + fmt::format("{} {} {} {}\n", low, (high - low) / (kDepths - 1), kDepths, high);
}

// Samples of what each view sees, and how well another view goes with it.
class PairScorer {
 public:
  PairScorer(const RayCaster& scene, std::span<const PosedImage> views, int threads)
      : scene_(scene), views_(views), points_(views.size()), depths_(views.size()) {
    ParallelFor(views.size(), threads, [&](size_t i) { Sample(i); });
  }

  const std::vector<double>& depths(size_t view) const { return depths_[view]; }

  // Returns the best other views for a view, best first. Those that may be are asked first, whether
  // or not something is between.
  std::vector<std::pair<double, size_t>> Best(size_t view) const {
    constexpr size_t kSources = 10, kAsked = 30;
    std::vector<size_t> others;
    for (size_t i = 0; i < views_.size(); ++i) {
      if (i != view && !depths_[i].empty()) others.push_back(i);
    }
    auto best = Scored(view, others, false);
    others.clear();
    for (size_t k = 0; k < std::min(best.size(), kAsked); ++k) others.push_back(best[k].second);
    best = Scored(view, others, true);
    best.resize(std::min(best.size(), kSources));
    return best;
  }

 private:
  void Sample(size_t index) {
    constexpr int kSide = 48;
    const Camera& camera = views_[index].camera;
    const Rigid3 world_from_cam = views_[index].cam_from_world.Inverse();
    std::vector<Ray> rays;
    for (int k = 0; k < kSide * kSide; ++k) {
      const Vector2d pixel((k % kSide + 0.5) / kSide * camera.width_px(),
                           (k / kSide + 0.5) / kSide * camera.height_px());
      if (const auto ray = camera.RayInCam(pixel)) {
        rays.push_back({world_from_cam.translation, world_from_cam.rotation * *ray});
      }
    }
    const auto hits = scene_.Cast(rays);
    for (size_t k = 0; k < rays.size(); ++k) {
      if (!hits[k]) continue;
      points_[index].push_back(rays[k].origin_in_world +
                               hits[k]->ray_t * rays[k].direction_in_world);
      depths_[index].push_back((views_[index].cam_from_world * points_[index].back()).z());
    }
    // The scores of all pairs need fewer. An odd step changes columns from row to row.
    constexpr size_t kScored = 150;
    const size_t step = points_[index].size() / kScored | 1;
    size_t num_kept = 0;
    for (size_t k = 0; k < points_[index].size(); k += step) {
      points_[index][num_kept++] = points_[index][k];
    }
    points_[index].resize(num_kept);
  }

  std::vector<std::pair<double, size_t>> Scored(size_t view, const std::vector<size_t>& others,
                                                bool ask_what_is_between) const {
    std::vector<std::pair<double, size_t>> scored;
    for (const size_t other : others) {
      if (const double score = Score(view, other, ask_what_is_between); score > 0) {
        scored.emplace_back(score, other);
      }
    }
    std::sort(scored.begin(), scored.end(), [](const auto& a, const auto& b) {
      return std::pair(-a.first, a.second) < std::pair(-b.first, b.second);
    });
    return scored;
  }

  double Score(size_t view, size_t other, bool ask_what_is_between) const {
    const Vector3d from = views_[view].cam_from_world.OriginInSource();
    const Vector3d to = views_[other].cam_from_world.OriginInSource();
    const Camera& camera = views_[other].camera;
    double score = 0;
    for (const Vector3d& point : points_[view]) {
      const auto pixel = camera.ImgFromCam(views_[other].cam_from_world * point);
      if (!pixel || !camera.Contains(*pixel)) continue;
      constexpr double kSame = 0.01;
      if (ask_what_is_between) {
        const Ray ray{to, point - to};
        const auto hit = scene_.Cast({&ray, 1}).front();
        if (!hit || hit->ray_t < 1 - kSame) continue;
      }
      const double cosine = (from - point).normalized().dot((to - point).normalized());
      const double deg = std::acos(std::clamp(cosine, -1.0, 1.0)) * 180 / std::numbers::pi;
      constexpr double kBestDeg = 5, kBelowDeg = 1, kAboveDeg = 10;
      const double off = (deg - kBestDeg) / (deg <= kBestDeg ? kBelowDeg : kAboveDeg);
      score += std::exp(-0.5 * off * off);
    }
    return score;
  }

  const RayCaster& scene_;
  std::span<const PosedImage> views_;
  std::vector<std::vector<Vector3d>> points_;
  std::vector<std::vector<double>> depths_;
};

}  // namespace

void CheckCameraFiles(std::span<const RenderTask> tasks, const RenderJobOptions& options) {
  for (const CameraFiles files : options.camera_files) {
    const std::string name(ToString(files));
    for (const RenderTask& task : tasks) {
      const Camera& camera = task.view.camera;
      if (camera.is_panorama()) {
        throw InputError(fmt::format("{} takes no panoramas: {}", name, task.view.name));
      }
      if (files == CameraFiles::kTransforms) {
        LensJson(task.view);
      } else if (camera.model() != CameraModel::kPinhole &&
                 camera.model() != CameraModel::kSimplePinhole) {
        throw InputError(
            fmt::format("mvsnet takes pinholes alone, and the lens of {} is {}: "
                        "undistort the images and their cameras before",
                        task.view.name, camera.ToString()));
      }
    }
    if (files == CameraFiles::kMvsnet) continue;
    if (options.photographs.empty() && Find(options, Product::kColor) == nullptr) {
      throw InputError("transforms.json needs pictures: photographs or the product color");
    }
    const ProductOutput* depth = Find(options, Product::kDepth);
    if (depth != nullptr && depth->format != "npy" && depth->format != "png") {
      throw InputError(
          fmt::format("transforms.json needs depth as npy or png, which nerfstudio reads, not {}",
                      depth->format));
    }
  }
}

std::string TransformsJson(std::span<const RenderTask> tasks, const RenderJobOptions& options) {
  const ProductOutput* depth = Find(options, Product::kDepth);
  const ProductOutput* color = Find(options, Product::kColor);
  // nerfstudio took the world for a turned one where it finds COLMAP's model and no such member.
  Json json = {{"applied_transform", {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}}};
  if (depth != nullptr) {
    json["depth_unit_scale_factor"] = depth->format == "png" ? options.storage.floats.png_step : 1;
  }
  json["frames"] = Json::array();
  for (const RenderTask& task : tasks) {
    const PosedImage& view = task.view;
    Json frame;
    frame["file_path"] =
        options.photographs.empty()
            ? TaskFile(task, *color)
            : std::filesystem::absolute(options.photographs / view.name)
                  .lexically_normal()
                  .lexically_relative(std::filesystem::absolute(options.out).lexically_normal())
                  .generic_string();
    if (depth != nullptr) frame["depth_file_path"] = TaskFile(task, *depth);
    frame.update(LensJson(view));
    frame["transform_matrix"] = PoseJson(view.cam_from_world);
    json["frames"].push_back(std::move(frame));
  }
  return JsonText(json, 1) + '\n';
}

std::vector<std::string> WriteMvsnetCameras(const path& out, const RayCaster& scene,
                                            std::span<const PosedImage> views, int threads) {
  const PairScorer scorer(scene, views, threads);
  std::vector<std::string> pairs(views.size());
  ParallelFor(views.size(), threads, [&](size_t i) {
    const auto best = scorer.Best(i);
    pairs[i] = fmt::format("{}\n{}", i, best.size());
    for (const auto& [score, other] : best) pairs[i] += fmt::format(" {} {:.4f}", other, score);
  });
  std::vector<std::string> warnings;
  std::string text;
  for (size_t i = 0; i < views.size(); ++i) {
    if (scorer.depths(i).empty()) {
      warnings.push_back(
          fmt::format("{} sees nothing, and MVSNet needs a range of depth: it is not in pair.txt",
                      views[i].name));
      continue;
    }
    WriteFile(out / "cams" / fmt::format("{:08}_cam.txt", i),
              CameraText(views[i], scorer.depths(i)));
    text += pairs[i] + "\n";
  }
  WriteFile(out / "pair.txt", fmt::format("{}\n", views.size() - warnings.size()) + text);
  return warnings;
}

}  // namespace raylift
