#include <algorithm>
#include <array>
#include <cmath>

#include "renderers/casters.h"
#include "support/matchers.h"
#include "support/meshes.h"
#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "raylift/renderers/frame_renderer.h"

namespace raylift {
namespace {

// Calls check(pixel, ray_in_cam, z) for every pixel of the depth map, in the camera's frame.
template <typename Check>
void ForEachPixel(const Camera& camera, const DepthMap& depth, const Check& check) {
  ASSERT_EQ(depth.width_px, camera.width_px());
  ASSERT_EQ(depth.height_px, camera.height_px());
  for (int y = 0; y < depth.height_px; ++y) {
    for (int x = 0; x < depth.width_px; ++x) {
      const auto ray = camera.RayInCam({x + 0.5, y + 0.5});
      ASSERT_TRUE(ray) << camera.ToString() << " has no ray at " << x << " " << y;
      check(*ray, static_cast<double>(depth.At(x, y)));
    }
  }
}

TEST(RenderDepth, PlaneHasTheDepthOfTheClosedFormInEveryCamera) {
  for (const Eigen::Vector3d& center : {Eigen::Vector3d(0, 0, 0), kGeoreferenced}) {
    const Rigid3 world_from_plane{Eigen::Quaterniond::Identity(), center};
    const RayCaster caster = MakeCaster(MakePlane(world_from_plane, 40, 20));
    const Eigen::Vector3d eye = center + Eigen::Vector3d(0.4, -0.7, -4);
    const Rigid3 cam_from_world = LookAt(eye, center + Eigen::Vector3d(0.5, 0.3, 0));
    const Eigen::Vector3d normal = cam_from_world.rotation * Eigen::Vector3d(0, 0, 1);
    for (const Camera& camera : CamerasOfEveryModel()) {
      const DepthMap depth = RenderDepth(caster, camera, cam_from_world, 2);
      ForEachPixel(camera, depth, [&](const Eigen::Vector3d& ray, double z) {
        const double expected = 4 / normal.dot(ray) * ray.z();
        EXPECT_NEAR(z, expected, 1e-5 * expected) << camera.ToString();
      });
    }
  }
}

TEST(RenderDepth, SphereHasTheDepthOfTheClosedFormInEveryCamera) {
  for (const Eigen::Vector3d& center : {Eigen::Vector3d(0, 0, 0), kGeoreferenced}) {
    const RayCaster caster = MakeCaster(MakeSphere(center, 1, 500, 1000));
    const Eigen::Vector3d eye = center + Eigen::Vector3d(-1.1, 2, 1.5);
    const Rigid3 cam_from_world = LookAt(eye, center + Eigen::Vector3d(0.05, 0, 0.02));
    const Eigen::Vector3d center_in_cam = cam_from_world.rotation * (center - eye);
    for (const Camera& camera : CamerasOfEveryModel()) {
      const DepthMap depth = RenderDepth(caster, camera, cam_from_world, 2);
      int compared = 0;
      ForEachPixel(camera, depth, [&](const Eigen::Vector3d& ray, double z) {
        const double along = ray.dot(center_in_cam);
        const double cosine2 = 1 - (center_in_cam.squaredNorm() - along * along);
        // A facet is up to 1e-5 inside the sphere; an oblique ray sees that enlarged.
        if (cosine2 < 0.25) return;
        ++compared;
        const double expected = (along - std::sqrt(cosine2)) * ray.z();
        EXPECT_NEAR(z, expected, 1e-5 * expected) << camera.ToString();
      });
      EXPECT_GT(compared, 300) << camera.ToString();
    }
  }
}

TEST(RenderDepth, BoxHasTheDepthOfTheClosedFormInEveryCamera) {
  const Eigen::Vector3d half(3, 2, 4);
  for (const Eigen::Vector3d& center : {Eigen::Vector3d(0, 0, 0), kGeoreferenced}) {
    const RayCaster caster = MakeCaster(MakeBox(center, half));
    const Eigen::Vector3d eye(0.5, -0.3, -1);  // from the box's center
    const Rigid3 cam_from_world = LookAt(center + eye, center + Eigen::Vector3d(2, 1.5, 3));
    for (const Camera& camera : CamerasOfEveryModel()) {
      const DepthMap depth = RenderDepth(caster, camera, cam_from_world, 2);
      ForEachPixel(camera, depth, [&](const Eigen::Vector3d& ray, double z) {
        const Eigen::Vector3d direction = cam_from_world.rotation.conjugate() * ray;
        const double t =
            ((half.array() * direction.array().sign() - eye.array()) / direction.array())
                .minCoeff();
        EXPECT_NEAR(z, t * ray.z(), 1e-5 * t * ray.z()) << camera.ToString();
      });
    }
  }
}

TEST(RenderDepth, PixelsWithoutSurfaceAreZero) {
  const RayCaster caster = MakeCaster(MakeBox({0, 0, 10}, {1, 1, 1}));
  const DepthMap depth = RenderDepth(caster, CenteredPinhole(19, 13, 10), Rigid3(), 1);
  EXPECT_EQ(depth.At(0, 0), 0.0f);
  EXPECT_EQ(depth.At(18, 12), 0.0f);
  EXPECT_FLOAT_EQ(depth.At(9, 6), 9.0f);
}

TEST(RenderDepth, SameBytesForAnyThreadCount) {
  const RayCaster caster = MakeCaster(MakeSphere({0, 0, 5}, 2, 40, 80));
  const Camera camera = CenteredPinhole(211, 157, 150);
  const DepthMap one = RenderDepth(caster, camera, Rigid3(), 1);
  EXPECT_EQ(RenderDepth(caster, camera, Rigid3(), 4).z, one.z);
}

// A square of 2 x 2 at z = 2 that fills a 64 x 64 image, upright: u to the right, v up.
TriangleMesh TexturedSquare(Image texture) {
  TriangleMesh mesh =
      MeshOfShape({{-1, -1, 2}, {1, -1, 2}, {1, 1, 2}, {-1, 1, 2}}, {{0, 2, 1}, {0, 3, 2}});
  mesh.texture_coordinates = {{0, 1}, {1, 1}, {1, 0}, {0, 0}};
  mesh.triangle_textures = {0, 0};
  mesh.textures = {std::move(texture)};
  return mesh;
}

std::array<int, 3> At(const Image& image, int x, int y) {
  const uint8_t* rgb = image.Pixel(x, y);
  return {rgb[0], rgb[1], rgb[2]};
}

TEST(RenderColor, TextureStandsUprightAndKeepsItsTexels) {
  Rng rng = TestRng();
  Image texture{64, 64, 3, std::vector<uint8_t>(size_t{64} * 64 * 3)};
  for (uint8_t& byte : texture.data) byte = static_cast<uint8_t>(rng.UniformIndex(256));
  const RayCaster caster = MakeCaster(TexturedSquare(texture));
  const Image image = RenderColor(caster, CenteredPinhole(64, 64, 64), Rigid3(), {}, 2);
  // A pixel sees one texel, center on center; its footprint is estimated to a few percent, so that
  // a little of the halved texture is mixed in.
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < 64; ++x) {
      for (int c = 0; c < 3; ++c) {
        ASSERT_NEAR(image.Pixel(x, y)[c], texture.Pixel(x, y)[c], 4) << x << " " << y;
      }
    }
  }
}

TEST(RenderColor, FarTextureIsAveragedNotSampled) {
  Image texture{256, 256, 3, std::vector<uint8_t>(size_t{256} * 256 * 3)};
  for (int i = 0; i < 256 * 256; ++i) {
    if ((i + i / 256) % 2 == 0) std::fill_n(&texture.data[static_cast<size_t>(i) * 3], 3, 255);
  }
  const RayCaster caster = MakeCaster(TexturedSquare(texture));
  const Image image = RenderColor(caster, CenteredPinhole(16, 16, 16), Rigid3(), {}, 1);
  for (const uint8_t value : image.data) {
    EXPECT_NEAR(value, 127.5, 2);
  }
}

TEST(RenderColor, VertexColorsAreInterpolated) {
  TriangleMesh mesh =
      MeshOfShape({{-1, -1, 2}, {1, -1, 2}, {1, 1, 2}, {-1, 1, 2}}, {{0, 2, 1}, {0, 3, 2}});
  mesh.vertex_colors_rgb = {{0, 0, 0}, {255, 0, 0}, {255, 255, 0}, {0, 255, 0}};
  const RayCaster caster = MakeCaster(std::move(mesh));
  const Image image = RenderColor(caster, CenteredPinhole(51, 51, 51), Rigid3(), {}, 1);
  for (int i = 0; i < 51; ++i) {
    const int expected = static_cast<int>(std::lround((i + 0.5) / 51 * 255));
    EXPECT_NEAR(At(image, i, 10)[0], expected, 1);
    EXPECT_NEAR(At(image, 10, i)[1], expected, 1);
    EXPECT_EQ(At(image, i, i)[2], 0);
  }
}

TEST(RenderColor, BackgroundAndUntexturedColorsAreTheOptions) {
  const RayCaster caster = MakeCaster(MakeBox({0, 0, 10}, {1, 1, 1}));
  ColorOptions options;
  options.background_rgb = {1, 2, 3};
  options.untextured_rgb = {50, 60, 70};
  options.samples_per_pixel_side = 3;
  const Image image = RenderColor(caster, CenteredPinhole(21, 21, 10), Rigid3(), options, 2);
  EXPECT_EQ(At(image, 0, 0), (std::array{1, 2, 3}));
  EXPECT_EQ(At(image, 10, 10), (std::array{50, 60, 70}));
}

TEST(RenderColor, SupersamplingAveragesAnEdge) {
  // The half plane x < 0 covers half of the middle pixel's column.
  TriangleMesh mesh =
      MeshOfShape({{-50, -50, 2}, {0, -50, 2}, {0, 50, 2}, {-50, 50, 2}}, {{0, 2, 1}, {0, 3, 2}});
  const RayCaster caster = MakeCaster(std::move(mesh));
  ColorOptions options;
  options.untextured_rgb = {200, 200, 200};
  options.samples_per_pixel_side = 4;
  const Image image = RenderColor(caster, CenteredPinhole(9, 9, 10), Rigid3(), options, 1);
  EXPECT_EQ(At(image, 3, 4)[0], 200);
  EXPECT_EQ(At(image, 4, 4)[0], 100);
  EXPECT_EQ(At(image, 5, 4)[0], 0);
}

TEST(RenderColor, HeadlightIsTheCosineToTheViewer) {
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(0.9, Eigen::Vector3d(0, 1, 0)));
  const RayCaster caster = MakeCaster(MakePlane({turn, {0, 0, 3}}, 5, 1));
  ColorOptions options;
  options.shading = ColorOptions::Shading::kHeadlight;
  options.untextured_rgb = {255, 255, 255};
  const Image image = RenderColor(caster, CenteredPinhole(3, 3, 100), Rigid3(), options, 1);
  EXPECT_NEAR(At(image, 1, 1)[0], 255 * std::cos(0.9), 1);
}

TEST(RenderColor, SunLightsAndCastsShadowsAlsoFarFromTheOrigin) {
  // A floor, seen from above, and a small roof over its left half; the sun stands at the zenith.
  for (const Eigen::Vector3d& center : {Eigen::Vector3d(0, 0, 0), kGeoreferenced}) {
    std::vector<Eigen::Vector3d> positions = {{-5, -5, 0}, {5, -5, 0}, {5, 5, 0}, {-5, 5, 0},
                                              {-5, -5, 9}, {0, -5, 9}, {0, 5, 9}, {-5, 5, 9}};
    for (Eigen::Vector3d& position : positions) position += center;
    const RayCaster caster =
        MakeCaster(MeshOfShape(positions, {{0, 1, 2}, {0, 2, 3}, {4, 5, 6}, {4, 6, 7}}));
    ColorOptions options;
    options.shading = ColorOptions::Shading::kSun;
    options.sun_direction_in_world = {0, 0, -3};
    options.ambient = 0.25;
    options.untextured_rgb = {200, 200, 200};
    const Rigid3 cam_from_world =
        LookAt(center + Eigen::Vector3d(0, 0, 8), center);  // below the roof
    const Image image =
        RenderColor(caster, CenteredPinhole(40, 40, 40), cam_from_world, options, 2);
    int lit = 0;
    int shaded = 0;
    for (int x = 0; x < 40; ++x) {
      lit += At(image, x, 20)[0] == 200 ? 1 : 0;
      shaded += At(image, x, 20)[0] == 50 ? 1 : 0;
    }
    EXPECT_EQ(lit, 20);
    EXPECT_EQ(shaded, 20);
  }
}

TEST(RenderColor, SameBytesForAnyThreadCount) {
  const RayCaster caster = MakeCaster(MakeSphere({0, 0, 5}, 2, 40, 80));
  ColorOptions options;
  options.shading = ColorOptions::Shading::kSun;
  options.samples_per_pixel_side = 2;
  const Camera camera = CenteredPinhole(111, 57, 60);
  const Image one = RenderColor(caster, camera, Rigid3(), options, 1);
  EXPECT_EQ(RenderColor(caster, camera, Rigid3(), options, 4).data, one.data);
}

}  // namespace
}  // namespace raylift
