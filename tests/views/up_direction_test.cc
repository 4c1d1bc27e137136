#include <numbers>

#include "base/rng.h"
#include "support/meshes.h"
#include "support/test_data.h"
#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "raylift/surfaces/mesh_files.h"
#include "raylift/views/view_sampler.h"

namespace raylift {
namespace {

double AngleDeg(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b)) * 180 / std::numbers::pi;
}

TriangleMesh Turned(TriangleMesh mesh, const Eigen::Quaterniond& turn) {
  for (Eigen::Vector3f& vertex : mesh.vertices) {
    vertex = (turn * vertex.cast<double>()).cast<float>();
  }
  return mesh;
}

// However it is turned.
void ExpectUp(const TriangleMesh& mesh, const Eigen::Vector3d& up, double within_deg) {
  Rng rng(5);
  for (int i = 0; i < 20; ++i) {
    Eigen::Vector4d numbers;
    for (double& number : numbers) number = rng.Normal();
    const Eigen::Quaterniond turn = Eigen::Quaterniond(numbers).normalized();
    const UpDirection found = EstimateUp(Turned(mesh, turn));
    EXPECT_TRUE(found.is_clear);
    EXPECT_LT(AngleDeg(found.up_in_world, turn * up), within_deg) << i;
  }
}

TEST(EstimateUp, OfTheDemo) {
  const TriangleMesh mesh = ReadMesh(DemoFolder() / "scene.obj");
  EXPECT_EQ(EstimateUp(mesh).up_in_world, Eigen::Vector3d::UnitZ());
  ExpectUp(mesh, Eigen::Vector3d::UnitZ(), 1.5);
}

TEST(EstimateUp, OfARealRoom) {
  const auto data = FindTestData("rgbd_small");
  if (!data) GTEST_SKIP() << "rgbd_small is not on this machine";
  const TriangleMesh mesh = ReadMesh(*data / "mesh.ply");
  ExpectUp(mesh, LevelUp(mesh, -Eigen::Vector3d::UnitY()), 2);
}

// A rectangle of the plane through `center` with these two sides; it faces their cross product.
void AddRectangle(TriangleMesh& mesh, const Eigen::Vector3f& center, const Eigen::Vector3f& a,
                  const Eigen::Vector3f& b) {
  const auto first = static_cast<uint32_t>(mesh.vertices.size());
  for (const Eigen::Vector3f& corner :
       {Eigen::Vector3f(center - (a + b) / 2), Eigen::Vector3f(center + (a - b) / 2),
        Eigen::Vector3f(center + (a + b) / 2), Eigen::Vector3f(center + (b - a) / 2)}) {
    mesh.vertices.push_back(corner);
  }
  mesh.triangles.push_back({first, first + 1, first + 2});
  mesh.triangles.push_back({first, first + 2, first + 3});
}

TEST(EstimateUp, IsNotWhatAFacadeFaces) {
  TriangleMesh mesh;
  AddRectangle(mesh, {0, 0, 0}, {8, 0, 0}, {0, 4, 0});   // the ground
  AddRectangle(mesh, {0, 2, 5}, {8, 0, 0}, {0, 0, 10});  // the facade
  const UpDirection found = EstimateUp(mesh);
  EXPECT_TRUE(found.is_clear);
  EXPECT_EQ(found.up_in_world, Eigen::Vector3d::UnitZ());
}

TEST(EstimateUp, IsZWhereNothingTells) {
  for (const TriangleMesh& mesh :
       {TriangleMesh(), MakeBox({0, 0, 0}, {1, 1, 1}), MakeSphere({0, 0, 0}, 1, 20, 40)}) {
    const UpDirection found =
        EstimateUp(Turned(mesh, Eigen::Quaterniond(0.8, 0.4, 0.4, -0.2).normalized()));
    EXPECT_FALSE(found.is_clear);
    EXPECT_EQ(found.up_in_world, Eigen::Vector3d::UnitZ());
  }
}

}  // namespace
}  // namespace raylift
