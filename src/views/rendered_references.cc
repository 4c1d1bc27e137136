#include "raylift/views/rendered_references.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "base/constants.h"
#include "base/statistics.h"
#include "views/task_list.h"
#include <Eigen/Geometry>
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

constexpr int kMaxSidePx = 1600;  // features are not looked for in larger pictures
constexpr double kMinFovDeg = 60;
constexpr double kMaxFovDeg = 100;
constexpr int kJpegQuality = 96;
// Below this share of the mesh's size nothing is gained by keeping away from surfaces.
constexpr double kMaxClearance = 0.05;

// Returns the field of view through the middle row; nullopt where the lens does not see it.
std::optional<double> HorizontalFovDeg(const Camera& camera) {
  const double y = 0.5 * camera.height_px();
  const auto left = camera.RayInCam({0.0, y});
  const auto right = camera.RayInCam({static_cast<double>(camera.width_px()), y});
  if (!left || !right) return std::nullopt;
  return std::atan2(left->cross(*right).norm(), left->dot(*right)) / kRadPerDeg;
}

double HalfTan(double fov_deg) { return std::tan(0.5 * fov_deg * kRadPerDeg); }

// Samples inside, unless there is no ground or it shows far less of the mesh than other places
// would: a table's top can pass for a ground.
ViewsOfKind SampleAuto(const RayCaster& mesh, const ViewSamplerOptions& options,
                       const ViewSamplerOptions& close, const InsideOptions& inside_options) {
  constexpr double kMinShare = 0.25;
  std::optional<SampledViews> inside = TrySampleInside(mesh, options, inside_options);
  SampledViews cover = SampleCovering(mesh, close);
  const auto shown = [&](const SampledViews& views) {
    return CoverageOf(mesh, close, views.cam_from_world);
  };
  if (inside && inside->warnings.empty() && shown(*inside) >= kMinShare * shown(cover)) {
    return {ViewKind::kInside, std::move(*inside)};
  }
  return {ViewKind::kCover, std::move(cover)};
}

std::vector<std::string> DescribeUp(const UpDirection& up) {
  const Eigen::Vector3d& axis = up.up_in_world;
  if (!up.is_clear) {
    return {"the mesh does not tell which way is up: z is taken for it where that is not said"};
  }
  if (axis == Eigen::Vector3d::UnitZ()) return {};
  return {
      fmt::format("up is taken to be ({:.3f}, {:.3f}, {:.3f}), by the mesh's floors and walls, "
                  "as it is not said",
                  axis.x(), axis.y(), axis.z())};
}

// Gives images names that no photograph is likely to have.
void RenameImages(ColmapModel& model) {
  for (auto& [id, image] : model.images) image.name = "rendered/" + image.name;
}

// Returns the k-th of `count` cameras, turned to the right.
Rigid3 CamFromRig(int k, int count) {
  const double angle = 2 * std::numbers::pi * k / count;
  // Image down is y; a turn to the right is positive about it, and the scene turns the other way.
  return {Eigen::Quaterniond(Eigen::AngleAxisd(-angle, Eigen::Vector3d::UnitY())),
          Eigen::Vector3d::Zero()};
}

ColmapSensor CameraSensor(int k) { return {0, static_cast<uint32_t>(k + 1)}; }

ColmapRig MakeRig(int rig_cameras) {
  ColmapRig rig;
  rig.reference_sensor = CameraSensor(0);
  for (int k = 1; k < rig_cameras; ++k) {
    rig.sensors.emplace_back(CameraSensor(k), ColmapPose::Of(CamFromRig(k, rig_cameras)));
  }
  return rig;
}

}  // namespace

ViewsOfKind SampleViews(const RayCaster& mesh, ViewKind kind, const ViewSamplerOptions& options,
                        const InsideOptions& inside, const AroundOptions& around) {
  ViewSamplerOptions close = options;
  close.clearance =
      std::min(options.clearance, kMaxClearance * MeshSize(mesh.mesh(), options.seed));
  switch (kind) {
    case ViewKind::kInside:
      return {kind, SampleInside(mesh, options, inside)};
    case ViewKind::kAround:
      return {kind, SampleAround(mesh, close, around)};
    case ViewKind::kCover:
      return {kind, SampleCovering(mesh, close)};
    case ViewKind::kAuto:
      break;
  }
  return SampleAuto(mesh, options, close, inside);
}

Camera CameraLikeQueries(std::span<const Camera> queries, const std::optional<PlaneSize>& size,
                         const std::optional<double>& fov_deg) {
  RAYLIFT_CHECK(!queries.empty());
  std::vector<double> fovs_deg, focals_px, aspects;
  for (const Camera& camera : queries) {
    fovs_deg.push_back(HorizontalFovDeg(camera).value_or(kMaxFovDeg));
    const double side_px = std::max(camera.width_px(), camera.height_px());
    focals_px.push_back(camera.MeanFocalPx() * std::min(1.0, kMaxSidePx / side_px));
    aspects.push_back(static_cast<double>(camera.height_px()) / camera.width_px());
  }
  const double fov =
      fov_deg.value_or(std::clamp(UpperMedianOr(std::move(fovs_deg), 0), kMinFovDeg, kMaxFovDeg));
  PlaneSize plane;
  if (size) {
    plane = *size;
  } else {
    const double aspect = UpperMedianOr(std::move(aspects), 0);
    const double most_px = kMaxSidePx / std::max(1.0, aspect);
    const double width_px = std::clamp(
        std::round(2 * HalfTan(fov) * UpperMedianOr(std::move(focals_px), 0)), 1.0, most_px);
    plane.width_px = static_cast<int>(width_px);
    plane.height_px = std::max(1, static_cast<int>(std::round(width_px * aspect)));
  }
  const double focal_px = 0.5 * plane.width_px / HalfTan(fov);
  const double params[] = {focal_px, focal_px, 0.5 * plane.width_px, 0.5 * plane.height_px};
  return {CameraModel::kPinhole, plane.width_px, plane.height_px, params};
}

ColorOptions ColorsLikePhotographs(const RayCaster& scene) {
  ColorOptions colors = PictureColors(scene);
  // Splats are smooth, and each of their rays is dear.
  colors.samples_per_pixel_side = scene.kind() == SurfaceKind::kSplats ? 1 : 2;
  colors.background_rgb = {128, 128, 128};
  return colors;
}

RenderedReferences RenderReferences(const std::shared_ptr<const RayCaster>& mesh,
                                    const RenderedReferenceOptions& options,
                                    const RenderHooks& hooks) {
  ViewSamplerOptions views_options = options.views;
  views_options.threads = options.threads;
  std::vector<std::string> warnings;
  if (options.estimate_up) {
    const UpDirection up = EstimateUp(mesh->mesh());
    views_options.up_in_world = up.up_in_world;
    warnings = DescribeUp(up);
  }
  ViewsOfKind sampled = SampleViews(*mesh, options.kind, views_options, options.inside);
  warnings.insert(warnings.end(), sampled.views.warnings.begin(), sampled.views.warnings.end());
  RenderedReferences references{.model = options.out / "model",
                                .images = options.out / "color",
                                .kind = sampled.kind,
                                .count = sampled.views.cam_from_world.size(),
                                .warnings = std::move(warnings)};
  if (!mesh->HasColors()) {
    references.warnings.emplace_back(
        "the mesh has neither texture nor vertex colors: pictures of its shape rarely match "
        "photographs by RootSIFT, and poses with few inliers are then wrong; `raylift color` "
        "gives it those of photographs with poses");
  }
  ColmapModel model =
      MakeSampledModel(options.views.camera, sampled.views.cam_from_world, /*rig_cameras=*/1);
  RenameImages(model);
  WriteColmapModel(references.model, model, ColmapForm::kText);
  RenderJobOptions job{.out = options.out,
                       .products = {{Product::kColor, "jpg"}},
                       .threads = options.threads,
                       .resume = true,
                       .wait = true};
  job.frame.color_options = ColorsLikePhotographs(*mesh);
  job.storage.jpeg_quality = kJpegQuality;
  references.rendered =
      RunRenderJob(mesh, SelectTasks(model.PosedImages(), {}), job, hooks).rendered;
  return references;
}

ColmapModel MakeSampledModel(const Camera& camera, std::span<const Rigid3> cam_from_world,
                             int rig_cameras) {
  RAYLIFT_CHECK(rig_cameras >= 1);
  const bool has_rig = rig_cameras > 1;
  ColmapModel model;
  for (int k = 0; k < rig_cameras; ++k) model.cameras.emplace(CameraSensor(k).id, camera);
  if (has_rig) model.rigs.emplace(1, MakeRig(rig_cameras));
  uint32_t image_id = 0;
  for (size_t i = 0; i < cam_from_world.size(); ++i) {
    ColmapFrame frame{.rig_id = 1, .rig_from_world = ColmapPose::Of(cam_from_world[i]), .data = {}};
    for (int k = 0; k < rig_cameras; ++k) {
      ColmapImage image;
      image.name = has_rig ? fmt::format("camera{}/{:04}.jpg", k, i) : fmt::format("{:04}.jpg", i);
      image.camera_id = CameraSensor(k).id;
      image.SetCamFromWorld(CamFromRig(k, rig_cameras) * cam_from_world[i]);
      model.images.emplace(++image_id, std::move(image));
      frame.data.push_back({CameraSensor(k), image_id});
    }
    if (has_rig) model.frames.emplace(static_cast<uint32_t>(i + 1), std::move(frame));
  }
  return model;
}

}  // namespace raylift
