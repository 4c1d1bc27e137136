// What WriteGlb() writes, as assimp reads it.

#include <cmath>
#include <cstring>

#include "localization/results/exports.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <assimp/Importer.hpp>
#include <assimp/scene.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "raylift/base/file.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

// Far from the origin, as in map coordinates.
const Eigen::Vector3d kOrigin(4.5e5, 5.4e6, 300);

TriangleMesh Square() {
  return MakeMesh({kOrigin, kOrigin + Eigen::Vector3d(2, 0, 0), kOrigin + Eigen::Vector3d(2, 2, 1),
                   kOrigin + Eigen::Vector3d(0, 2, 0)},
                  {{0, 1, 2}, {0, 2, 3}}, {{255, 0, 0}, {0, 128, 0}, {0, 0, 7}, {90, 80, 70}});
}

GlbCamera MakeCamera(const std::string& name, const Rigid3& cam_from_world, GlbCameraKind kind) {
  const double params[] = {500, 400, 320, 240};
  return {{name, Camera(CameraModel::kPinhole, 640, 480, params), cam_from_world}, kind};
}

// One camera of each kind, near the square.
std::vector<GlbCamera> ThreeCameras() {
  Rng rng = TestRng();
  std::vector<GlbCamera> cameras;
  for (const EnumName<GlbCameraKind>& kind : kEnumNames<GlbCameraKind>) {
    const Rigid3 world_from_cam{RandomRigid3(rng, 1).rotation,
                                kOrigin + RandomRigid3(rng, 5).translation};
    cameras.push_back(
        MakeCamera(std::string(kind.name) + "/a.jpg", world_from_cam.Inverse(), kind.value));
  }
  return cameras;
}

nlohmann::json JsonOf(const std::filesystem::path& file) {
  const std::string glb = ReadFile(file);
  uint32_t size = 0;
  std::memcpy(&size, glb.data() + 12, sizeof(size));
  return nlohmann::json::parse(glb.substr(20, size));
}

aiMatrix4x4 RootFromNode(const aiNode* node) {
  aiMatrix4x4 matrix;
  for (; node != nullptr; node = node->mParent) matrix = node->mTransformation * matrix;
  return matrix;
}

Eigen::Vector3d ToEigen(const aiVector3D& v) { return {v.x, v.y, v.z}; }

TEST(SceneGlb, MeshComesBackWhereItWas) {
  const auto file = TestFolder() / "scene.glb";
  const TriangleMesh mesh = Square();
  WriteGlb(file, &mesh, ThreeCameras());
  const TriangleMesh read = ReadMesh(file);  // lines are no triangles
  ASSERT_EQ(read.triangles.size(), mesh.triangles.size());
  for (size_t i = 0; i < mesh.triangles.size(); ++i) {
    for (size_t k = 0; k < 3; ++k) {
      const uint32_t a = mesh.triangles[i][k], b = read.triangles[i][k];
      // assimp's matrices are float, whose steps are 0.5 at 5.4e6.
      EXPECT_LT((read.VertexInWorld(b) - mesh.VertexInWorld(a)).norm(), 0.5);
      EXPECT_EQ(read.vertex_colors_rgb.at(b), mesh.vertex_colors_rgb.at(a));
    }
  }
}

TEST(SceneGlb, TexturesComeBackTheSameWayUp) {
  const auto file = TestFolder() / "scene.glb";
  TriangleMesh mesh = Square();
  mesh.origin_in_world = Eigen::Vector3d::Zero();
  mesh.vertex_colors_rgb.clear();
  mesh.texture_coordinates = {{0, 0}, {1, 0}, {1, 1}, {0, 0.75f}};
  mesh.triangle_textures = {0, -1};
  Image picture{16, 8, 3, std::vector<uint8_t>(16 * 8 * 3, 200)};
  std::fill_n(picture.data.begin(), 16 * 4 * 3, 40);  // dark above
  mesh.textures = {picture};
  WriteGlb(file, &mesh, {});
  const TriangleMesh read = ReadMesh(file);
  EXPECT_EQ(read.warnings, std::vector<std::string>());
  // Those without a texture come first.
  ASSERT_EQ(read.triangle_textures, (std::vector<int32_t>{-1, 0}));
  ASSERT_EQ(read.textures.size(), 1u);
  EXPECT_NEAR(*read.textures[0].Pixel(8, 0), 40, 3);  // JPEG's losses
  EXPECT_NEAR(*read.textures[0].Pixel(8, 7), 200, 3);
  for (size_t k = 0; k < 3; ++k) {
    EXPECT_EQ(read.texture_coordinates[read.triangles[1][k]],
              mesh.texture_coordinates[mesh.triangles[0][k]]);
  }
}

TEST(SceneGlb, EachCameraIsANodeThatStandsAndLooksAsItDoes) {
  const auto file = TestFolder() / "scene.glb";
  std::vector<GlbCamera> cameras = ThreeCameras();
  for (GlbCamera& camera : cameras) {  // assimp rounds matrices to float
    camera.image.cam_from_world =
        camera.image.cam_from_world * Rigid3{Eigen::Quaterniond::Identity(), kOrigin};
  }
  constexpr double kSize = 0.5;
  WriteGlb(file, nullptr, cameras, {.frustum_size = kSize});
  Assimp::Importer importer;
  const aiScene* scene = importer.ReadFile(file.string(), 0);
  ASSERT_NE(scene, nullptr) << importer.GetErrorString();
  ASSERT_EQ(scene->mNumCameras, cameras.size());
  for (const GlbCamera& camera : cameras) {
    const aiNode* node = scene->mRootNode->FindNode(camera.image.name.c_str());
    ASSERT_NE(node, nullptr) << camera.image.name;
    EXPECT_STREQ(node->mParent->mName.C_Str(), std::string(ToString(camera.kind)).c_str());
    const aiMatrix4x4 root_from_node = RootFromNode(node);
    const Rigid3 world_from_cam = camera.image.cam_from_world.Inverse();
    ASSERT_EQ(node->mNumMeshes, 1u);
    const aiMesh& lines = *scene->mMeshes[node->mMeshes[0]];
    EXPECT_EQ(lines.mPrimitiveTypes, unsigned{aiPrimitiveType_LINE});
    EXPECT_EQ(lines.mNumFaces, 10u);
    // The center and the four corners of the image at the depth of the frustum.
    const double x = kSize * 320 / 500, y = kSize * 240 / 400;
    const Eigen::Vector3d expected[] = {
        {0, 0, 0}, {-x, -y, kSize}, {x, -y, kSize}, {x, y, kSize}, {-x, y, kSize}};
    const std::vector<aiVector3D> vertices(lines.mVertices, lines.mVertices + lines.mNumVertices);
    for (const Eigen::Vector3d& point_in_cam : expected) {
      double nearest = INFINITY;
      for (const aiVector3D& vertex : vertices) {
        nearest = std::min(
            nearest, (ToEigen(root_from_node * vertex) - world_from_cam * point_in_cam).norm());
      }
      EXPECT_LT(nearest, 1e-5) << camera.image.name;
    }
    // glTF's camera looks along -z.
    const Eigen::Vector3d ahead = ToEigen(root_from_node * aiVector3D(0, 0, -1));
    EXPECT_LT((ahead - world_from_cam * Eigen::Vector3d(0, 0, 1)).norm(), 1e-5);
  }
  const double up = 240.0 / 400, aside = 320.0 / 500;
  const auto pinhole = JsonOf(file)["cameras"][0]["perspective"];
  EXPECT_NEAR(pinhole["yfov"].get<double>(), 2 * std::atan(up), 1e-12);
  EXPECT_NEAR(pinhole["aspectRatio"].get<double>(), aside / up, 1e-12);
}

TEST(SceneGlb, UpIsTurnedToGltfsUp) {
  const auto file = TestFolder() / "scene.glb";
  TriangleMesh mesh = Square();
  mesh.origin_in_world = {10, 20, 30};
  WriteGlb(file, &mesh, {}, {.up_in_world = Eigen::Vector3d::UnitZ()});
  const TriangleMesh read = ReadMesh(file);
  for (size_t k = 0; k < 3; ++k) {
    const Eigen::Vector3d in_world = mesh.VertexInWorld(mesh.triangles[0][k]);
    const Eigen::Vector3d expected(in_world.x(), in_world.z(), -in_world.y());
    EXPECT_LT((read.VertexInWorld(read.triangles[0][k]) - expected).norm(), 1e-5);
  }
}

TEST(SceneGlb, FrustaOfLensesThatSeeBesideThemStayInFront) {
  const auto file = TestFolder() / "scene.glb";
  const double panorama[] = {640, 320};
  const double fisheye[] = {100, 100, 320, 240, 0, 0, 0, 0};
  std::vector<GlbCamera> cameras = {
      {{"panorama", Camera(CameraModel::kEquirectangular, 640, 320, panorama), {}}, {}},
      {{"fisheye", Camera(CameraModel::kOpenCvFisheye, 640, 480, fisheye), {}}, {}}};
  WriteGlb(file, nullptr, cameras);
  Assimp::Importer importer;
  const aiScene* scene = importer.ReadFile(file.string(), 0);
  ASSERT_NE(scene, nullptr) << importer.GetErrorString();
  ASSERT_EQ(scene->mNumMeshes, 2u);
  for (unsigned int i = 0; i < 2; ++i) {
    const aiMesh& lines = *scene->mMeshes[i];
    for (unsigned int v = 0; v < lines.mNumVertices; ++v) EXPECT_LE(lines.mVertices[v].z, 0);
  }
  EXPECT_TRUE(FailsWithInputError([&] { WriteGlb(file, nullptr, {}); }, {"nothing to write"}));
}

}  // namespace
}  // namespace raylift
