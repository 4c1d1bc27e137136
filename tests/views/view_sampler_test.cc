#include "raylift/views/view_sampler.h"

#include <cmath>
#include <numbers>

#include "support/matchers.h"
#include "support/meshes.h"
#include "support/test_data.h"
#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

const Camera kSamplerCamera = CenteredPinhole(640, 480, 300);

TriangleMesh InsideOut(TriangleMesh mesh) {
  for (auto& triangle : mesh.triangles) std::swap(triangle[1], triangle[2]);
  return mesh;
}

// A room of 12 x 8 x 3 around a georeferenced place, floor at `floor`; in it a pillar to the
// ceiling, a table, and below it another, lower room that is smaller.
TriangleMesh MakeRooms(const Eigen::Vector3d& floor) {
  const auto at = [&floor](double x, double y, double z) -> Eigen::Vector3d {
    return floor + Eigen::Vector3d(x, y, z);
  };
  std::vector<TriangleMesh> parts;
  parts.push_back(InsideOut(MakeBox(at(0, 0, 1.5), {6, 4, 1.5})));
  parts.push_back(MakeBox(at(2, 1, 1.5), {0.4, 0.4, 1.499}));  // pillar
  parts.push_back(MakeBox(at(-3, -1, 0.75), {1, 0.7, 0.05}));  // table top
  parts.push_back(InsideOut(MakeBox(at(0, 0, -2), {3, 3, 1.5})));
  return MergeMeshes(std::move(parts));
}

RayCaster Scene(TriangleMesh mesh) {
  return RayCaster(std::make_shared<const TriangleMesh>(std::move(mesh)));
}

std::vector<Eigen::Vector3d> RandomDirections(Rng& rng, int count) {
  std::vector<Eigen::Vector3d> directions;
  for (int i = 0; i < count; ++i) {
    directions.push_back(Eigen::Vector3d(rng.Normal(), rng.Normal(), rng.Normal()).normalized());
  }
  return directions;
}

// Nothing within `clearance` (but for what slips between the sampler's directions), and at most
// `back_share` of what is seen in all directions is seen from behind.
void ExpectClear(const RayCaster& mesh, const Rigid3& pose, double clearance, double back_share) {
  Rng rng = TestRng();
  const Eigen::Vector3d center = pose.OriginInSource();
  std::vector<Ray> rays;
  for (const Eigen::Vector3d& direction : RandomDirections(rng, 2000)) {
    rays.push_back({center, direction});
  }
  const auto hits = mesh.Cast(rays);
  int back = 0;
  int seen = 0;
  for (size_t i = 0; i < hits.size(); ++i) {
    if (!hits[i]) continue;
    ++seen;
    back += hits[i]->normal_in_world.dot(rays[i].direction_in_world) > 0 ? 1 : 0;
    EXPECT_GT(hits[i]->ray_t, 0.97 * clearance);
  }
  EXPECT_GT(seen, 0);
  EXPECT_LE(back, back_share * seen);
}

TEST(SampleInside, CamerasStandOnTheFloorClearOfEverything) {
  const RayCaster mesh = Scene(MakeRooms(kGeoreferenced));
  const ViewSamplerOptions options{.camera = kSamplerCamera, .count = 40};
  const SampledViews views = SampleInside(mesh, options, {});
  EXPECT_TRUE(views.warnings.empty());
  ASSERT_EQ(views.cam_from_world.size(), 40u);
  for (const Rigid3& pose : views.cam_from_world) {
    const Eigen::Vector3d eye = pose.OriginInSource() - kGeoreferenced;
    EXPECT_NEAR(eye.z(), 1.6, 1e-5);  // of the larger room; neither on the table nor below
    EXPECT_LT(std::abs(eye.x()), 5.7 + 1e-5);
    EXPECT_LT(std::abs(eye.y()), 3.7 + 1e-5);
    ExpectClear(mesh, pose, 0.3, 0);
    // Level, and the picture is upright.
    EXPECT_NEAR((pose.rotation * Eigen::Vector3d(0, 0, 1)).y(), -1, 1e-9);
  }
}

TEST(SampleInside, ManyViewsOfFewPlacesAndTheSameForTheSameSeed) {
  const RayCaster mesh = Scene(InsideOut(MakeBox({0, 0, 1}, {0.5, 0.5, 1})));
  ViewSamplerOptions options{.camera = kSamplerCamera, .count = 60, .clearance = 0.2};
  const InsideOptions inside{.eye_height = 1};
  const SampledViews views = SampleInside(mesh, options, inside);
  ASSERT_EQ(views.cam_from_world.size(), 60u);
  options.threads = 1;
  const SampledViews again = SampleInside(mesh, options, inside);
  options.seed = 1;
  const SampledViews other = SampleInside(mesh, options, inside);
  int different = 0;
  for (size_t i = 0; i < 60; ++i) {
    EXPECT_EQ(views.cam_from_world[i].translation, again.cam_from_world[i].translation);
    different += views.cam_from_world[i].translation != other.cam_from_world[i].translation;
  }
  EXPECT_GT(different, 50);
}

TEST(SampleInside, TakesAnyDirectionAsUp) {
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(1.1, Eigen::Vector3d(1, 2, -1).normalized()));
  TriangleMesh mesh = MakeRooms({0, 0, 0});
  for (Eigen::Vector3f& vertex : mesh.vertices) vertex = turn.cast<float>() * vertex;
  mesh.origin_in_world = turn * mesh.origin_in_world;
  const Eigen::Vector3d up = turn * Eigen::Vector3d::UnitZ();
  // The hint is off by 15 degrees; the floors tell.
  const Eigen::Vector3d hint =
      Eigen::AngleAxisd(15 * std::numbers::pi / 180, up.unitOrthogonal()) * up;
  const Eigen::Vector3d level = LevelUp(mesh, hint);
  EXPECT_LT((level - up).norm(), 1e-5);
  const RayCaster caster = Scene(std::move(mesh));
  const SampledViews views =
      SampleInside(caster, {.camera = kSamplerCamera, .count = 10, .up_in_world = level}, {});
  ASSERT_EQ(views.cam_from_world.size(), 10u);
  for (const Rigid3& pose : views.cam_from_world) {
    EXPECT_NEAR(up.dot(pose.OriginInSource()), 1.6, 1e-4);
    ExpectClear(caster, pose, 0.3, 0);
  }
}

TEST(SampleInside, SaysWhereThereIsNoPlace) {
  const RayCaster mesh = Scene(InsideOut(MakeBox({0, 0, 0.5}, {5, 5, 0.5})));  // too low
  EXPECT_TRUE(FailsWithInputError([&] { SampleInside(mesh, {.camera = kSamplerCamera}, {}); },
                                  {"no place for a camera", "the eye height"}));
  EXPECT_FALSE(TrySampleInside(mesh, {.camera = kSamplerCamera}, {}));
}

TEST(SampleInside, CamerasOfARealRoomAreClearOfItsWalls) {
  const auto data = FindTestData("rgbd_small");
  if (!data) GTEST_SKIP() << "rgbd_small is not on this machine";
  TriangleMesh mesh = ReadMesh(*data / "mesh.ply");
  const Eigen::Vector3d up = LevelUp(mesh, -Eigen::Vector3d::UnitY());
  const RayCaster caster = Scene(std::move(mesh));
  const InsideOptions inside{.eye_height = 0.8};
  const SampledViews views = SampleInside(
      caster, {.camera = kSamplerCamera, .count = 20, .up_in_world = up, .clearance = 0.2}, inside);
  ASSERT_EQ(views.cam_from_world.size(), 20u);
  for (const Rigid3& pose : views.cam_from_world) {
    ExpectClear(caster, pose, 0.2, 0.15);  // rims of holes show their backs
  }
}

double TurnDeg(const Rigid3& a, const Rigid3& b) {
  return a.rotation.angularDistance(b.rotation) * 180 / std::numbers::pi;
}

// No pose is far from the one before, neither by place nor by direction.
void ExpectSteps(const SampledViews& walk, double spacing) {
  for (size_t i = 1; i < walk.cam_from_world.size(); ++i) {
    const Rigid3& before = walk.cam_from_world[i - 1];
    const Rigid3& pose = walk.cam_from_world[i];
    const Eigen::Vector3d step = pose.OriginInSource() - before.OriginInSource();
    EXPECT_LT(step.norm(), spacing + 0.06) << i;  // sways and bobs besides
    EXPECT_LT(TurnDeg(before, pose), 60) << i;    // half of it by the hand
  }
}

TEST(SampleWalk, GoesAboutTheRoomStepByStepClearOfEverything) {
  const RayCaster mesh = Scene(MakeRooms(kGeoreferenced));
  for (uint64_t seed = 0; seed < 4; ++seed) {
    const ViewSamplerOptions options{.camera = kSamplerCamera, .count = 120, .seed = seed};
    const SampledViews walk = SampleWalk(mesh, options, {});
    EXPECT_TRUE(walk.warnings.empty());
    ASSERT_EQ(walk.cam_from_world.size(), 120u);
    ExpectSteps(walk, 0.4);
    Eigen::AlignedBox3d visited;
    for (const Rigid3& pose : walk.cam_from_world) {
      const Eigen::Vector3d eye = pose.OriginInSource() - kGeoreferenced;
      visited.extend(eye);
      EXPECT_NEAR(eye.z(), 1.6, 0.0201);  // bobs
      if (seed == 0) ExpectClear(mesh, pose, 0.3, 0);
      // Upright but for the hand.
      EXPECT_LT((pose.rotation * Eigen::Vector3d(0, 0, 1)).y(), -0.9);
    }
    EXPECT_GT(visited.sizes().x(), 7);
    EXPECT_GT(visited.sizes().y(), 4);
  }
}

TEST(SampleWalk, IsTheSameForTheSameSeed) {
  const RayCaster mesh = Scene(MakeRooms(kGeoreferenced));
  ViewSamplerOptions options{.camera = kSamplerCamera, .count = 20};
  const SampledViews walk = SampleWalk(mesh, options, {});
  options.threads = 1;
  const SampledViews again = SampleWalk(mesh, options, {});
  options.seed = 1;
  const SampledViews other = SampleWalk(mesh, options, {});
  for (size_t i = 0; i < 20; ++i) {
    EXPECT_EQ(again.cam_from_world[i].translation, walk.cam_from_world[i].translation);
    EXPECT_NE(other.cam_from_world[i].translation, walk.cam_from_world[i].translation);
  }
}

TEST(SampleWalk, TurnsAboutInDeadEndsAndGoesRoundAndRound) {
  for (const Eigen::Vector3d& half : {Eigen::Vector3d(10, 0.5, 1.5), Eigen::Vector3d(1, 1, 1.5)}) {
    const Eigen::Quaterniond turn(Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, -1).normalized()));
    TriangleMesh mesh = InsideOut(MakeBox({0, 0, half.z()}, half));
    for (Eigen::Vector3f& vertex : mesh.vertices) vertex = turn.cast<float>() * vertex;
    mesh.origin_in_world = turn * mesh.origin_in_world;
    const Eigen::Vector3d up = turn * Eigen::Vector3d::UnitZ();
    const RayCaster caster = Scene(std::move(mesh));
    for (uint64_t seed = 0; seed < 2; ++seed) {
      const SampledViews walk = SampleWalk(
          caster, {.camera = kSamplerCamera, .count = 200, .up_in_world = up, .seed = seed},
          {.look_down_deg = 20});
      ASSERT_EQ(walk.cam_from_world.size(), 200u);
      ExpectSteps(walk, 0.4);
      Eigen::AlignedBox3d visited;
      double down = 0;
      for (const Rigid3& pose : walk.cam_from_world) {
        const Eigen::Vector3d eye = turn.conjugate() * pose.OriginInSource();
        visited.extend(eye);
        EXPECT_NEAR(eye.z(), 1.6, 0.021);
        down -= up.dot(pose.rotation.conjugate() * Eigen::Vector3d::UnitZ()) / 200;
      }
      EXPECT_GT(visited.sizes().x(), 0.6 * half.x());
      EXPECT_NEAR(down, std::sin(20 * std::numbers::pi / 180), 0.1);
    }
  }
}

TEST(SampleWalk, GoesThroughNoWall) {
  // The grid's cells are wider than the clearance.
  const RayCaster mesh = Scene([] {
    std::vector<TriangleMesh> parts;
    parts.push_back(InsideOut(MakeBox({0, 0, 2}, {40, 8, 2})));
    parts.push_back(MakeBox({10, 0, 2}, {0.01, 7.9, 1.99}));
    return MergeMeshes(std::move(parts));
  }());
  const SampledViews walk =
      SampleWalk(mesh, {.camera = kSamplerCamera, .count = 200, .clearance = 0.05}, {});
  const auto side = [](const Rigid3& pose) { return pose.OriginInSource().x() > 10; };
  for (const Rigid3& pose : walk.cam_from_world) EXPECT_FALSE(side(pose));  // the larger part
}

TEST(SampleWalk, SaysWhereThereIsNoWay) {
  const ViewSamplerOptions options{.camera = kSamplerCamera};
  const RayCaster low = Scene(InsideOut(MakeBox({0, 0, 0.5}, {5, 5, 0.5})));
  EXPECT_TRUE(FailsWithInputError([&] { SampleWalk(low, options, {}); },
                                  {"no way to walk", "the eye height"}));
  EXPECT_THROW(SampleWalk(low, options, {}, {.spacing = 0}), OptionError);
}

TEST(SampleAround, TheWholeMeshIsInEveryPicture) {
  const TriangleMesh sphere = MakeSphere(kGeoreferenced, 2, 20, 40);
  const RayCaster mesh = Scene(sphere);
  const Camera camera = kSamplerCamera;
  for (const double low : {-30.0, 40.0}) {  // a belt and a ring
    const SampledViews views = SampleAround(mesh, {.camera = camera, .count = 25},
                                            {.min_elevation_deg = low, .max_elevation_deg = 40});
    ASSERT_EQ(views.cam_from_world.size(), 25u);
    for (const Rigid3& pose : views.cam_from_world) {
      for (uint32_t i = 0; i < sphere.vertices.size(); ++i) {
        const auto pixel = camera.ImgFromCam(pose * sphere.VertexInWorld(i));
        ASSERT_TRUE(pixel && camera.Contains(*pixel));
      }
      const Eigen::Vector3d from_middle = pose.OriginInSource() - kGeoreferenced;
      const double elevation_deg = std::asin(from_middle.normalized().z()) * 180 / std::numbers::pi;
      EXPECT_GE(elevation_deg, low - 1e-4);
      EXPECT_LE(elevation_deg, 40 + 1e-4);
    }
  }
}

TEST(SampleAlong, LooksAlongTheLineAndLeavesOutWhatIsInWalls) {
  const RayCaster mesh = Scene(MakeRooms({0, 0, 0}));
  const ViewSamplerOptions options{.camera = kSamplerCamera, .count = 21};
  // Through the pillar, whose faces are at x = 1.6 and 2.4.
  const std::vector<Eigen::Vector3d> line = {{-4, 1, 1.6}, {4, 1, 1.6}, {4, -3, 1.6}};
  const SampledViews views = SampleAlong(mesh, options, line);
  EXPECT_EQ(views.warnings.size(), 1u);
  EXPECT_GT(views.cam_from_world.size(), 16u);
  EXPECT_LT(views.cam_from_world.size(), 21u);
  for (const Rigid3& pose : views.cam_from_world) ExpectClear(mesh, pose, 0.3, 0);
  const Rigid3& first = views.cam_from_world.front();
  EXPECT_LT((first.OriginInSource() - line[0]).norm(), 1e-9);
  EXPECT_LT(
      (first.rotation.conjugate() * Eigen::Vector3d::UnitZ() - Eigen::Vector3d::UnitX()).norm(),
      1e-9);
  const Rigid3& last = views.cam_from_world.back();
  EXPECT_LT((last.OriginInSource() - line[2]).norm(), 1e-9);
  EXPECT_LT(
      (last.rotation.conjugate() * Eigen::Vector3d::UnitZ() + Eigen::Vector3d::UnitY()).norm(),
      1e-9);
}

}  // namespace
}  // namespace raylift
