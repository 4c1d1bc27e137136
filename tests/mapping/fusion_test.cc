// Surfaces of formulas, seen by rays from all sides, must come back as they are.

#include "raylift/mapping/fusion.h"

#include <cmath>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "base/rng.h"
#include "base/statistics.h"
#include "mapping/distance_grid.h"
#include "mapping/view_planes.h"
#include "support/meshes.h"
#include <Eigen/Core>
#include <gtest/gtest.h>

#include "raylift/base/error.h"
#include "raylift/renderers/ray_caster.h"

namespace raylift {
namespace {

using Eigen::Vector3d;

const Vector3d kHalfRoom(2, 1.5, 2.5);
const Vector3d kBall(0.4, 0.5, 0.3);
constexpr double kRadius = 0.5;

// Inside a room with a ball in it; `change` moves what a view sees by a factor of its depth.
class Room final : public GeometrySource {
 public:
  using Change = std::function<double(const PosedImage& view, const Eigen::Vector2d& pixel)>;

  explicit Room(Vector3d shift = Vector3d::Zero(), Change change = {})
      : shift_(std::move(shift)), change_(std::move(change)) {}

  std::string Description() const override { return "room"; }

  std::vector<std::optional<SurfacePoint>> Lift(
      const PosedImage& view, std::span<const Eigen::Vector2d> pixels) const override {
    std::vector<std::optional<SurfacePoint>> points;
    for (const Eigen::Vector2d& pixel : pixels) points.push_back(LiftOne(view, pixel));
    return points;
  }

  // From the nearest surface of the room.
  double Distance(const Vector3d& point_in_world) const {
    const Vector3d point = point_in_world - shift_;
    return std::min((kHalfRoom - point.cwiseAbs()).cwiseAbs().minCoeff(),
                    std::abs((point - kBall).norm() - kRadius));
  }

 private:
  std::optional<SurfacePoint> LiftOne(const PosedImage& view, const Eigen::Vector2d& pixel) const {
    const Rigid3 world_from_cam = view.cam_from_world.Inverse();
    const Vector3d ray_in_cam = *view.camera.RayInCam(pixel);
    const Vector3d ray = world_from_cam.rotation * ray_in_cam;
    const Vector3d origin = world_from_cam.translation - shift_;
    double ray_t = 1e9;
    Vector3d normal = Vector3d::Zero();
    for (int axis = 0; axis < 3; ++axis) {
      const double wall = std::copysign(kHalfRoom[axis], ray[axis]);
      const double t = (wall - origin[axis]) / ray[axis];
      if (t < ray_t) {
        ray_t = t;
        normal = -std::copysign(1.0, ray[axis]) * Vector3d::Unit(axis);
      }
    }
    const double along = ray.dot(kBall - origin);
    const double root = along * along - (kBall - origin).squaredNorm() + kRadius * kRadius;
    if (root > 0 && along - std::sqrt(root) > 0) {
      ray_t = along - std::sqrt(root);
      normal = (origin + ray_t * ray - kBall) / kRadius;
    }
    if (change_) ray_t *= change_(view, pixel);
    if (ray_t <= 0) return std::nullopt;
    return SurfacePoint{.point_in_world = shift_ + origin + ray_t * ray,
                        .normal_in_world = normal,
                        .depth_z = ray_t * ray_in_cam.z(),
                        .incidence_deg = std::acos(-normal.dot(ray)) * 180 / M_PI,
                        .back_face = false};
  }

  Vector3d shift_;
  Change change_;
};

// All around the room, from places outside of the ball.
std::vector<PosedImage> Views(const Vector3d& shift = Vector3d::Zero()) {
  const double params[] = {120, 120, 80, 60};
  const Camera camera(CameraModel::kPinhole, 160, 120, params);
  std::vector<PosedImage> views;
  for (int i = 0; i < 24; ++i) {
    const double angle = i * M_PI / 6;
    const Vector3d center(1.4 * std::cos(angle), i < 12 ? -0.5 : 0.9, 1.8 * std::sin(angle));
    const Vector3d target(-1.2 * std::cos(angle), i < 12 ? 1 : -1, -1.2 * std::sin(angle));
    views.push_back({"view_" + std::to_string(i), camera, LookAt(shift + center, shift + target)});
  }
  return views;
}

class Fusion : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!CanFuse()) GTEST_SKIP() << "built without OpenVDB";
  }
};

TEST_F(Fusion, SurfacesComeBackAsTheyAre) {
  const Room room;
  const FusedMesh fused = FuseViews(room, Views(), {.voxel = 0.05});
  ASSERT_GT(fused.mesh.triangles.size(), 10000U);
  // Within edges of the room no surface is smooth, and a vertex has one of two walls.
  double sum = 0;
  for (uint32_t i = 0; i < fused.mesh.vertices.size(); ++i) {
    const double distance = room.Distance(fused.mesh.VertexInWorld(i));
    EXPECT_LT(distance, 0.05) << fused.mesh.VertexInWorld(i).transpose();
    sum += distance;
  }
  EXPECT_LT(sum / static_cast<double>(fused.mesh.vertices.size()), 0.002);
}

TEST_F(Fusion, FrontFacesLookAtTheCameras) {
  const FusedMesh fused = FuseViews(Room(), Views(), {.voxel = 0.05});
  const RayCaster caster(std::make_shared<const TriangleMesh>(fused.mesh));
  size_t num_hits = 0, num_backs = 0;
  for (const PosedImage& view : Views()) {
    const Rigid3 world_from_cam = view.cam_from_world.Inverse();
    std::vector<Ray> rays;
    for (double x = -0.6; x < 0.6; x += 0.1) {
      rays.push_back(
          {world_from_cam.translation, world_from_cam.rotation * Vector3d(x, 0.1, 1), 0});
    }
    const auto hits = caster.Cast(rays);
    for (size_t i = 0; i < hits.size(); ++i) {
      if (!hits[i]) continue;
      ++num_hits;
      num_backs += hits[i]->normal_in_world.dot(rays[i].direction_in_world) > 0;
    }
  }
  EXPECT_GT(num_hits, 200U);
  // Where views look along the ball, it is uneven by less than a voxel.
  EXPECT_LT(num_backs, num_hits / 10);
}

TEST_F(Fusion, IsTheSameForAnyNumberOfThreads) {
  const FusedMesh one = FuseViews(Room(), Views(), {.voxel = 0.06, .threads = 1});
  const FusedMesh five = FuseViews(Room(), Views(), {.voxel = 0.06, .threads = 5});
  EXPECT_EQ(one.mesh.triangles, five.mesh.triangles);
  EXPECT_EQ(one.mesh.vertices, five.mesh.vertices);
}

TEST_F(Fusion, KeepsCoordinatesOfAMapProjection) {
  const Vector3d shift(512345.25, 5412345.5, 312);
  const Room room(shift);
  const FusedMesh fused = FuseViews(room, Views(shift), {.voxel = 0.05});
  double sum = 0;
  for (uint32_t i = 0; i < fused.mesh.vertices.size(); ++i) {
    sum += room.Distance(fused.mesh.VertexInWorld(i));
  }
  EXPECT_LT(sum / static_cast<double>(fused.mesh.vertices.size()), 0.002);
}

TEST_F(Fusion, FindsTheNoiseAndAveragesIt) {
  const auto noise = [](const PosedImage& view, const Eigen::Vector2d& pixel) {
    const double values[] = {pixel.x(), pixel.y()};
    Rng rng(std::hash<std::string>()(view.name) + static_cast<uint64_t>(values[0]) * 977 +
            static_cast<uint64_t>(values[1]) * 131071);
    return 1 + 0.01 * rng.Normal();
  };
  const Room room(Vector3d::Zero(), noise);
  const FusedMesh fused = FuseViews(room, Views());
  // Pixels that lie between others are as noisy, and the room is smooth but for its edges.
  EXPECT_NEAR(fused.scale.relative_noise, 0.01, 0.001);
  EXPECT_NEAR(fused.scale.relative_roughness, 0.01, 0.001);
  double sum = 0;
  for (uint32_t i = 0; i < fused.mesh.vertices.size(); ++i) {
    sum += room.Distance(fused.mesh.VertexInWorld(i));
  }
  const double mean = sum / static_cast<double>(fused.mesh.vertices.size());
  EXPECT_LT(mean, 0.3 * fused.scale.noise);
}

TEST_F(Fusion, VoxelsAreTwoPixelsOrAsLargeAsTheNoise) {
  const FusedMesh exact = FuseViews(Room(), Views());
  EXPECT_DOUBLE_EQ(exact.voxel, 2 * exact.scale.pixel_width);
  EXPECT_DOUBLE_EQ(exact.truncation, 4 * exact.voxel);
  // Each view sees everything larger or smaller than it is.
  const Room room(Vector3d::Zero(), [](const PosedImage& view, const Eigen::Vector2d&) {
    return view.name.back() % 2 == 0 ? 0.95 : 1.05;
  });
  const FusedMesh noisy = FuseViews(room, Views());
  EXPECT_GT(noisy.scale.noise, 2 * noisy.scale.pixel_width);
  EXPECT_DOUBLE_EQ(noisy.voxel, noisy.scale.noise);
}

TEST(ViewPlanes, WeighLessWhereTheyAreSlantedOrNoisy) {
  const PosedImage view = Views().front();
  for (const double noise : {0.0, 0.05}) {
    const ViewPlanes seen = LookForPlanes(Room(), view, {.relative_noise = noise}, 0.1);
    for (size_t i = 0; i < seen.planes.size(); ++i) {
      const PixelPlane& plane = seen.planes[i];
      const Eigen::Vector2d pixel(static_cast<double>(i % 160) + 0.5,
                                  static_cast<double>(i / 160) + 0.5);
      const double cosine = -plane.normal_in_cam.cast<double>().dot(*view.camera.RayInCam(pixel));
      const double sigma = noise * static_cast<double>(plane.depth);
      const double weight = cosine * 0.01 / (sigma * sigma + 0.0025);
      if (plane.weight == 0) continue;
      EXPECT_NEAR(plane.weight, weight, 1e-4 * weight);
    }
    EXPECT_GT(seen.max_depth, 1);
  }
}

// Where depth is rough, planes are fitted to that of some pixels; that of the room is exact.
TEST(ViewPlanes, FittedToRoughDepthGoThroughTheSurface) {
  const PosedImage view = Views().front();
  const ViewPlanes exact = LookForPlanes(Room(), view, {}, 0.1);
  const ViewPlanes fitted = LookForPlanes(Room(), view, {.relative_roughness = 0.01}, 0.1);
  std::vector<double> distances;
  for (size_t i = 0; i < fitted.planes.size(); ++i) {
    const PixelPlane& plane = fitted.planes[i];
    const Eigen::Vector2d pixel(static_cast<double>(i % 160) + 0.5,
                                static_cast<double>(i / 160) + 0.5);
    const Vector3d ray = *view.camera.RayInCam(pixel);
    const Vector3d point = static_cast<double>(exact.planes[i].depth) / ray.z() * ray;
    if (plane.weight == 0) continue;
    distances.push_back(std::abs(plane.normal_in_cam.cast<double>().dot(point) -
                                 static_cast<double>(plane.offset)));
  }
  ASSERT_GT(distances.size(), 10000U);
  EXPECT_LT(UpperMedianOr(distances, 1), 1e-4);
}

TEST_F(Fusion, WhatOthersLookThroughIsFree) {
  // One view sees everything at half its distance, in the middle of the room.
  const auto is_wrong = [](const PosedImage& view) { return view.name == "view_3"; };
  const Room room(Vector3d::Zero(), [&](const PosedImage& view, const Eigen::Vector2d&) {
    return is_wrong(view) ? 0.5 : 1.0;
  });
  const FusedMesh fused = FuseViews(room, Views(), {.voxel = 0.05});
  size_t num_wrong = 0;
  for (uint32_t i = 0; i < fused.mesh.vertices.size(); ++i) {
    num_wrong += room.Distance(fused.mesh.VertexInWorld(i)) > 0.1;
  }
  EXPECT_LT(num_wrong, fused.mesh.vertices.size() / 200);
}

TEST_F(Fusion, SmallPiecesAreLeftOut) {
  // A speck that one view alone sees, before a wall that none other does.
  const std::vector<PosedImage> views = {Views().front()};
  const Room room(Vector3d::Zero(), [](const PosedImage&, const Eigen::Vector2d& pixel) {
    return (pixel - Eigen::Vector2d(120, 60)).norm() < 5 ? 0.5 : 1;
  });
  const auto all = FuseViews(room, views, {.voxel = 0.03, .min_piece_voxels = 0});
  const auto large = FuseViews(room, views, {.voxel = 0.03});
  EXPECT_LT(large.mesh.triangles.size(), all.mesh.triangles.size());
  EXPECT_GT(large.mesh.triangles.size(), all.mesh.triangles.size() * 9 / 10);
}

template <typename Error>
std::string MessageOf(const FusionOptions& options, const Room& room = Room()) {
  try {
    FuseViews(room, Views(), options);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

TEST_F(Fusion, SaysWhatCannotBe) {
  EXPECT_NE(MessageOf<OptionError>({.voxel = -1}).find("voxel = -1"), std::string::npos);
  EXPECT_NE(MessageOf<OptionError>({.min_piece_voxels = -1}).find("min_piece = -1"),
            std::string::npos);
  EXPECT_NE(MessageOf<OptionError>({.voxel = 0.05, .truncation = 9}).find("2 to 50 voxels"),
            std::string::npos);
  EXPECT_NE(MessageOf<OptionError>({.voxel = 0.01, .max_bytes = 1000000}).find("a quarter"),
            std::string::npos);
  const Room nothing(Vector3d::Zero(), [](const PosedImage&, const Eigen::Vector2d&) { return 0; });
  EXPECT_NE(MessageOf<InputError>({}, nothing).find("none of the 24 views"), std::string::npos);
}

TEST_F(Fusion, MakesNoMoreBlocksThanItsMemoryHolds) {
  const Room room;
  const std::vector<PosedImage> views = Views();
  const std::vector<ViewPlanes> seen = {
      LookForPlanes(room, views.front(), MeasureScale(room, views, 1), 0.01)};
  DistanceGrid grid({.voxel = 0.01, .truncation = 0.05, .max_bytes = 1000000});
  grid.MakeBlocks(seen);
  EXPECT_GT(grid.MemoryBytes(), 1000000U);
  EXPECT_LT(grid.MemoryBytes(), 1010000U);
}

TEST(FusionWithoutOpenVdb, SaysHowToGetIt) {
  if (CanFuse()) GTEST_SKIP() << "built with OpenVDB";
  EXPECT_NE(MessageOf<OptionError>({}).find("libopenvdb-dev"), std::string::npos);
}

}  // namespace
}  // namespace raylift
