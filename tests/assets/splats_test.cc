// The demo's scene as Gaussian splats looks as its mesh does.

#include <cmath>
#include <filesystem>
#include <numbers>

#include "support/splat_files.h"
#include "support/test_data.h"
#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/io/colmap_model.h"
#include "raylift/renderers/frame_renderer.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

Frame Render(const std::shared_ptr<const RayCaster>& caster, const PosedImage& view, int samples) {
  FrameOptions options;
  options.depth = options.distance = options.normals = options.color = true;
  options.color_options.samples_per_pixel_side = samples;
  options.color_options.background_rgb = {222, 226, 232};
  Frame frame;
  FrameRenderer(caster, options).Render(PixelRays(view.camera, 0), view.cam_from_world, 0, frame);
  return frame;
}

Eigen::Vector3d ColorAt(const Frame& frame, size_t pixel) {
  const uint8_t* const rgb = &frame.color.data[3 * pixel];
  return Eigen::Vector3d(rgb[0], rgb[1], rgb[2]) / 255;
}

// A flat disc on the triangle that each pixel sees, as large as the pixel there.
std::vector<TestSplat> DiscsOfPixels(const PosedImage& view, const Frame& frame,
                                     std::vector<size_t>& pixels) {
  const Rigid3 world_from_cam = view.cam_from_world.Inverse();
  std::vector<TestSplat> discs;
  for (size_t pixel = 0; pixel < frame.depth.size(); ++pixel) {
    if (frame.distance[pixel] == 0) continue;
    const auto width = static_cast<size_t>(frame.width_px);
    const Eigen::Vector2d at(static_cast<double>(pixel % width) + 0.5,
                             static_cast<double>(pixel / width) + 0.5);
    const Eigen::Vector3d ray = world_from_cam.rotation * view.camera.RayInCam(at)->normalized();
    const Eigen::Vector3d normal =
        Eigen::Map<const Eigen::Vector3f>(&frame.normals[3 * pixel]).cast<double>().normalized();
    const double distance = double{frame.distance[pixel]};
    const double side = 0.5 * distance / view.camera.MeanFocalPx();
    const double cosine = std::max(0.05, std::abs(normal.dot(ray)));
    Eigen::Matrix3d axes;
    axes.col(0) = cosine > 0.999 ? normal.unitOrthogonal() : normal.cross(ray).normalized();
    axes.col(1) = normal.cross(axes.col(0));
    axes.col(2) = normal;
    discs.push_back({.mean = world_from_cam.translation + distance * ray,
                     .rotation = Eigen::Quaterniond(axes),
                     .scale = {side, side / cosine, 1e-3 * side},
                     .harmonics = {HarmonicOf(ColorAt(frame, pixel))}});
    pixels.push_back(pixel);
  }
  return discs;
}

TEST(DemoSplats, LookAsTheMeshDoes) {
  const auto mesh = std::make_shared<const RayCaster>(
      std::make_shared<const TriangleMesh>(ReadMesh(DemoFolder() / "scene.obj")));
  PosedImage view = ReadColmapModel(DemoFolder() / "ground_truth").PosedImages().front();
  view.camera = view.camera.Scaled(320, 240);
  const Frame target = Render(mesh, view, 4);
  std::vector<size_t> pixels;
  std::vector<TestSplat> discs = DiscsOfPixels(view, Render(mesh, view, 1), pixels);
  const auto file = TestFolder() / "demo.ply";
  double psnr = 0;
  size_t near = 0;
  // Discs overlap: their colors are fitted to what is seen of all of them.
  for (int round = 0; round < 6; ++round) {
    WriteFile(file, SplatPly(discs, SplatLayout::kDiscs));
    const auto splats = std::make_shared<const RayCaster>(
        std::make_shared<const Splats>(ReadSplats(file)), SplatDepth::kMedian);
    const Frame seen = Render(splats, view, 1);
    for (size_t i = 0; i < discs.size(); ++i) {
      const Eigen::Vector3d rest = ColorAt(target, pixels[i]) - ColorAt(seen, pixels[i]);
      discs[i].harmonics[0] += (2 * std::sqrt(std::numbers::pi) * rest).cast<float>();
    }
    double sum = 0;
    near = 0;
    for (size_t pixel = 0; pixel < target.depth.size(); ++pixel) {
      sum += (ColorAt(target, pixel) - ColorAt(seen, pixel)).squaredNorm() / 3;
      const double off = std::abs(double{target.depth[pixel]} - double{seen.depth[pixel]});
      near += off <= 1e-3 * double{target.depth[pixel]} ? 1 : 0;
    }
    psnr = -10 * std::log10(sum / static_cast<double>(target.depth.size()));
  }
  RecordProperty("psnr_db", std::to_string(psnr));
  EXPECT_GT(psnr, 30);
  EXPECT_GT(near, 0.9 * static_cast<double>(target.depth.size())) << "but for edges and leaves";
}

}  // namespace
}  // namespace raylift
