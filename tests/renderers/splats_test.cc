// Rays at Gaussian splats, against closed forms and a plain renderer of the published equations.

#include "raylift/surfaces/splats.h"

#include <array>
#include <cmath>
#include <numbers>
#include <sstream>

#include "renderers/splat_blend.h"
#include "support/matchers.h"
#include "support/splat_files.h"
#include "support/test_data.h"
#include <Eigen/Geometry>
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/renderers/frame_renderer.h"
#include "raylift/renderers/ray_caster.h"

namespace raylift {
namespace {

const std::string kPython = "/usr/bin/python3";

std::filesystem::path WriteSplats(const std::vector<TestSplat>& splats,
                                  SplatLayout layout = SplatLayout::kEllipsoids) {
  auto path = TestFolder() / "splats.ply";
  WriteFile(path, SplatPly(splats, layout));
  return path;
}

RayCaster CasterOf(const std::vector<TestSplat>& splats, SplatDepth depth = SplatDepth::kMedian,
                   SplatLayout layout = SplatLayout::kEllipsoids) {
  return {std::make_shared<const Splats>(ReadSplats(WriteSplats(splats, layout))), depth};
}

SplatLook LookAlong(const RayCaster& caster, const Ray& ray) {
  const auto colors = SplatColors(*caster.splats(), ray.origin_in_world, 1);
  SplatLook look;
  caster.LookAtSplats({&ray, 1}, colors, {&look, 1});
  return look;
}

std::vector<Eigen::Vector3f> Plain(const Eigen::Vector3d& rgb) { return {HarmonicOf(rgb)}; }

const Ray kForward{Eigen::Vector3d::Zero(), Eigen::Vector3d::UnitZ()};

TEST(Splats, OneGaussianIsAsTheClosedFormSays) {
  const Eigen::Vector3d rgb(0.9, 0.3, 0.1);
  const RayCaster caster = CasterOf(
      {{.mean = {0, 0, 5}, .scale = {0.2, 0.3, 0.1}, .opacity = 0.8, .harmonics = Plain(rgb)}});
  for (const double x : {0.0, 0.1, 0.15, 0.3}) {
    const Ray ray{{x, 0, 1}, {0, 0, 2}};
    const SplatLook look = LookAlong(caster, ray);
    const double alpha = 0.8 * std::exp(-0.5 * x * x / 0.04);
    EXPECT_NEAR(look.transmittance, 1 - alpha, 1e-6);
    for (int i = 0; i < 3; ++i) EXPECT_NEAR(double{look.color_rgb[i]}, alpha * rgb[i], 1e-6);
    ASSERT_EQ(look.hit.has_value(), alpha >= 0.5) << x;
    if (!look.hit) continue;
    EXPECT_NEAR(look.hit->ray_t, 2, 1e-6);  // in lengths of the direction
    EXPECT_NEAR(look.hit->normal_in_world.z(), -1, 1e-6) << "the shortest axis, against the ray";
    EXPECT_NEAR(look.hit->sigma, 0.1, 1e-6) << "its own spread";
    EXPECT_EQ(look.hit->triangle, 0u);
  }
}

TEST(Splats, WhatIsTooTransparentIsNotThere) {
  // Alpha is 1/255 at sqrt(2 ln(255 * 0.5)) = 3.1141 standard deviations.
  const RayCaster caster = CasterOf({{.mean = {0, 0, 5}, .opacity = 0.5}});
  EXPECT_LT(LookAlong(caster, {{3.113, 0, 0}, {0, 0, 1}}).transmittance, 1);
  EXPECT_EQ(LookAlong(caster, {{3.115, 0, 0}, {0, 0, 1}}).transmittance, 1);
  EXPECT_EQ(LookAlong(caster, {{0, 0, 6}, {0, 0, 1}}).transmittance, 1) << "it is behind";
  EXPECT_EQ(LookAlong(caster, {{0, 0, 0}, {0, 0, 1}, 5.1}).transmittance, 1) << "too near";
}

TEST(Splats, TheDepthsOfTwoLayersDiffer) {
  std::vector<TestSplat> layers;
  for (const auto& [z, opacity] : {std::pair(2.0, 0.6), {1.0, 0.45}}) {
    layers.push_back({.mean = {0, 0, z}, .scale = {1, 1, 0.01}, .opacity = opacity});
  }
  const double near = 0.45, far = 0.55 * 0.6;  // weights
  const double expected = (near * 1 + far * 2) / (near + far);
  for (const auto& [depth, t] : {std::pair(SplatDepth::kMedian, 2.0),
                                 {SplatDepth::kExpected, expected},
                                 {SplatDepth::kPeak, 1.0}}) {
    const auto hit = LookAlong(CasterOf(layers, depth), kForward).hit;
    ASSERT_TRUE(hit);
    EXPECT_NEAR(hit->ray_t, t, 1e-6);
    EXPECT_EQ(hit->triangle, 1u) << "the nearer one weighs more";
    const double variance =
        (near * (1 - t) * (1 - t) + far * (2 - t) * (2 - t)) / (near + far) + 0.01 * 0.01;
    EXPECT_NEAR(hit->sigma, std::sqrt(variance), 1e-6);
    EXPECT_NEAR(hit->normal_in_world.z(), -1, 1e-6) << "against the ray";
  }
}

TEST(Splats, BehindOpaqueOnesThereIsNothing) {
  std::vector<TestSplat> layers;
  for (const double z : {1.0, 2.0, 3.0}) {
    layers.push_back({.mean = {0, 0, z}, .opacity = 0.9999, .harmonics = Plain({z / 4, 0, 0})});
  }
  const SplatLook look = LookAlong(CasterOf(layers), kForward);
  // 0.99 is the most: 1e-2 is left, then 1e-4, and then less than that would be.
  EXPECT_NEAR(look.transmittance, 1e-4, 1e-9);
  EXPECT_NEAR(double{look.color_rgb[0]}, 0.99 * 0.25 + 0.0099 * 0.5, 1e-6);
}

TEST(Splats, ADiscIsHitOnItsPlane) {
  Rng rng = TestRng();
  const Eigen::Matrix3d axes = RandomRigid3(rng, 0).rotation.toRotationMatrix();
  const Eigen::Vector3d center(0.3, -0.2, 4);
  const RayCaster caster = CasterOf({{.mean = center,
                                      .rotation = Eigen::Quaterniond(axes),
                                      .scale = {0.5, 0.25, 0},
                                      .opacity = 0.95}},
                                    SplatDepth::kMedian, SplatLayout::kDiscs);
  for (int i = 0; i < 100; ++i) {
    const Eigen::Vector2d at(rng.Uniform(-0.5, 0.5), rng.Uniform(-0.25, 0.25));
    const Eigen::Vector3d target = center + axes.leftCols<2>() * at;
    const Eigen::Vector3d eye(rng.Uniform(-1, 1), rng.Uniform(-1, 1), 0);
    const double cosine = std::abs((target - eye).normalized().dot(axes.col(2)));
    if (cosine < 0.2) continue;
    const SplatLook look = LookAlong(caster, {eye, target - eye});
    const double alpha =
        0.95 * std::exp(-0.5 * (at.x() * at.x() / 0.25 + at.y() * at.y() / 0.0625));
    // Float resolves 2e-7 of the center's place; that moves the hit on the disc by more, and there
    // by more standard deviations.
    EXPECT_NEAR(look.transmittance, 1 - alpha, 2e-6 / cosine);
    if (!look.hit) continue;
    EXPECT_NEAR(look.hit->ray_t, 1, 4e-7 / cosine);
    EXPECT_LT(look.hit->sigma, 1e-6);
    EXPECT_GT(std::abs(look.hit->normal_in_world.dot(axes.col(2))), 1 - 1e-6);
  }
}

// A box of Gaussians of all shapes, with an eye among them.
std::vector<TestSplat> RandomSplats(size_t count, size_t coefficients, Rng& rng) {
  std::vector<TestSplat> splats(count);
  for (TestSplat& splat : splats) {
    splat.mean = {rng.Uniform(-2, 2), rng.Uniform(-2, 2), rng.Uniform(-2, 6)};
    splat.rotation = RandomRigid3(rng, 0).rotation;
    for (double& scale : splat.scale) scale = std::exp(rng.Uniform(std::log(0.02), std::log(0.5)));
    splat.opacity = rng.Uniform(0.02, 0.999);
    splat.harmonics.resize(coefficients);
    for (Eigen::Vector3f& rgb : splat.harmonics) {
      rgb = 0.5f * Eigen::Vector3d(rng.Normal(), rng.Normal(), rng.Normal()).cast<float>();
    }
  }
  return splats;
}

TEST(Splats, AgreeWithAPlainRendererOfTheEquations) {
  if (!HasProgram(kPython + " -c 'import numpy'")) GTEST_SKIP() << "numpy is not installed";
  Rng rng = TestRng();
  for (const auto& [layout, coefficients] : {std::pair(SplatLayout::kEllipsoids, 16u),
                                             {SplatLayout::kEllipsoids, 4u},
                                             {SplatLayout::kDiscs, 9u}}) {
    const auto file = WriteSplats(RandomSplats(600, coefficients, rng), layout);
    const auto splats = std::make_shared<const Splats>(ReadSplats(file));
    const Eigen::Vector3d eye(0.1, -0.2, -0.5);
    std::vector<Ray> rays;
    std::string text = fmt::format("{:.17g} {:.17g} {:.17g}\n", eye.x(), eye.y(), eye.z());
    for (int i = 0; i < 500; ++i) {
      rays.push_back({eye, Eigen::Vector3d(rng.Normal(), rng.Normal(), rng.Normal()).normalized()});
      const Eigen::Vector3d& d = rays.back().direction_in_world;
      text += fmt::format("{:.17g} {:.17g} {:.17g}\n", d.x(), d.y(), d.z());
    }
    const auto list = file.parent_path() / "rays.txt";
    WriteFile(list, text);
    std::istringstream output(RunProgram(
        fmt::format("{} {} {} {}", kPython, RAYLIFT_SPLAT_RENDERER, file.string(), list.string())));
    std::array<std::vector<SplatLook>, 3> looks;  // by depth
    for (const SplatDepth depth : {SplatDepth::kMedian, SplatDepth::kExpected, SplatDepth::kPeak}) {
      auto& of_depth = looks[static_cast<size_t>(depth)];
      of_depth.resize(rays.size());
      RayCaster(splats, depth).LookAtSplats(rays, SplatColors(*splats, eye, 1), of_depth);
    }
    int surfaces = 0;
    for (size_t i = 0; i < rays.size(); ++i) {
      const SplatLook& look = looks[0][i];
      for (int channel = 0; channel < 3; ++channel) {
        double value = 0;
        output >> value;
        EXPECT_NEAR(double{look.color_rgb[channel]}, value, 1e-5);
      }
      double left = 0;
      output >> left;
      EXPECT_NEAR(look.transmittance, left, 1e-5);
      std::array<std::string, 4> surface;  // the three depths, and the spread about the median
      for (std::string& word : surface) output >> word;
      for (size_t depth = 0; depth < 3; ++depth) {
        const auto& hit = looks[depth][i].hit;
        ASSERT_EQ(hit.has_value(), surface[depth] != "none");
        if (!hit) continue;
        const double t = ParseDouble(surface[depth]).value();
        EXPECT_NEAR(hit->ray_t, t, 1e-5 * t);
      }
      if (!look.hit) continue;
      const double along = std::abs(look.hit->normal_in_world.dot(rays[i].direction_in_world));
      EXPECT_NEAR(look.hit->sigma / along, ParseDouble(surface[3]).value(), 1e-5);
      ++surfaces;
    }
    EXPECT_GT(surfaces, 50);
  }
}

// Enough of them that the search is cut short on the way.
TEST(Splats, TheEndOfLightEndsTheSearchAndChangesNothing) {
  Rng rng = TestRng();
  const RayCaster caster = CasterOf(RandomSplats(4000, 1, rng));
  const std::vector<PackedSplat> packed = PackSplats(*caster.splats(), 1);
  size_t cut_short = 0;
  for (int i = 0; i < 200; ++i) {
    const SplatRay ray{{0, 0, -0.5},
                       Eigen::Vector3d(rng.Uniform(-1, 1), rng.Uniform(-1, 1), 1).normalized()};
    std::vector<SplatOnRay> met;
    for (uint32_t k = 0; k < packed.size(); ++k) {
      const auto one = MeetSplat(packed[k], k, ray);
      if (one && one->t > 0) met.push_back(*one);
    }
    cut_short += SortVisible(met) ? 1 : 0;
    const SplatBlend expected = BlendSplats(packed, ray, met, SplatDepth::kMedian, {});
    const SplatLook look = LookAlong(caster, {ray.origin, ray.direction});
    EXPECT_NEAR(look.transmittance, expected.transmittance, 1e-12);
    ASSERT_EQ(look.hit.has_value(), expected.surface.has_value());
    if (look.hit) {
      EXPECT_NEAR(look.hit->ray_t, expected.surface->t, 1e-12);
    }
  }
  EXPECT_GT(cut_short, 100u);
}

TEST(Splats, BlocksAndOcclusionAreThoseOfSingleRays) {
  Rng rng = TestRng();
  const RayCaster caster = CasterOf(RandomSplats(300, 1, rng));
  const Eigen::Vector3d eye(0, 0, -3);
  std::vector<RayBlock> blocks(20);
  for (RayBlock& block : blocks) {
    for (size_t i = 0; i + 1 < RayBlock::kSize; ++i) {  // the last is no ray
      block.x[i] = static_cast<float>(rng.Uniform(-0.5, 0.5));
      block.y[i] = static_cast<float>(rng.Uniform(-0.5, 0.5));
      block.z[i] = 1;
    }
  }
  std::vector<HitBlock> hits(blocks.size());
  const size_t count = caster.CastBlocks(eye, blocks, hits);
  size_t found = 0;
  for (size_t b = 0; b < blocks.size(); ++b) {
    for (size_t i = 0; i < RayBlock::kSize; ++i) {
      const Ray ray{eye,
                    Eigen::Vector3f(blocks[b].x[i], blocks[b].y[i], blocks[b].z[i]).cast<double>()};
      const auto hit = caster.Cast({&ray, 1})[0];
      ASSERT_EQ(hit.has_value(), hits[b].triangle[i] != HitBlock::kNoTriangle);
      EXPECT_EQ(caster.IsOccluded(ray), hit.has_value());
      if (!hit) continue;
      ++found;
      EXPECT_FLOAT_EQ(hits[b].ray_t[i], static_cast<float>(hit->ray_t));
      EXPECT_EQ(caster.RefineHit(eye, ray.direction_in_world, hit->triangle, hit->ray_t).ray_t,
                hit->ray_t);
    }
  }
  EXPECT_EQ(found, count);
  EXPECT_GT(found, 50u);
}

TEST(Splats, FromFarAwayTheyAreTheSame) {
  const RayCaster caster = CasterOf({{.mean = {0, 0, 5}, .scale = {0.01, 0.01, 0.01}}});
  const Eigen::Vector3d direction = Eigen::Vector3d(1, 2, 3).normalized();
  const Eigen::Vector3d target(0, 0, 5);
  const auto hit = LookAlong(caster, {target - 1e6 * direction, direction}).hit;
  ASSERT_TRUE(hit);
  EXPECT_NEAR(hit->ray_t, 1e6, 1e-6);
  EXPECT_FALSE(LookAlong(caster, {{0, 0, 0}, {0, 0, 0}}).hit);
  EXPECT_FALSE(LookAlong(caster, {{0, 0, 0}, {0, 0, std::nan("")}}).hit);
}

TEST(Splats, PicturesHaveDepthNormalsAndColorsOverTheBackground) {
  // A wall of one disc, which does not fill the picture.
  const RayCaster caster = CasterOf({{.mean = {0, 0, 2},
                                      .scale = {0.3, 0.3, 1e-4},
                                      .opacity = 0.8,
                                      .harmonics = Plain({1, 0.5, 0})}});
  EXPECT_TRUE(caster.HasColors());
  const double params[] = {60, 60, 32, 24};
  const Camera camera(CameraModel::kPinhole, 64, 48, params);
  FrameOptions options;
  options.depth = options.distance = options.normals = options.color = options.mask = true;
  options.color_options.background_rgb = {0, 0, 200};
  for (const int side : {1, 3}) {
    options.color_options.samples_per_pixel_side = side;
    const std::shared_ptr<const RayCaster> borrowed(std::shared_ptr<void>(), &caster);
    Frame frame;
    FrameRenderer(borrowed, options).Render(PixelRays(camera, 1), Rigid3(), 2, frame);
    size_t hits = 0;
    for (int y = 0; y < 48; ++y) {
      for (int x = 0; x < 64; ++x) {
        const size_t pixel = static_cast<size_t>(y) * 64 + static_cast<size_t>(x);
        const Eigen::Vector2d slope((x + 0.5 - 32) / 60, (y + 0.5 - 24) / 60);
        const double alpha = 0.8 * std::exp(-0.5 * 4 * slope.squaredNorm() / 0.09);
        const bool is_hit = alpha >= 0.5;
        hits += is_hit ? 1 : 0;
        EXPECT_NEAR(double{frame.depth[pixel]}, is_hit ? 2 : 0, 1e-5);
        EXPECT_EQ(frame.mask.data[pixel], is_hit ? 255 : 0);
        EXPECT_NEAR(double{frame.normals[3 * pixel + 2]}, is_hit ? -1 : 0, 1e-5);
        const double seen = alpha < 1.0 / 255 ? 0 : alpha;
        // The mean over a pixel is that of its center within the curvature.
        const double tolerance = side == 1 ? 0.6 : 1.6;
        EXPECT_NEAR(frame.color.data[3 * pixel], 255 * seen, tolerance);
        EXPECT_NEAR(frame.color.data[3 * pixel + 2], 200 * (1 - seen), tolerance);
      }
    }
    EXPECT_EQ(frame.num_hits, hits);
    EXPECT_GT(hits, 200u);
  }
}

TEST(Splats, ThoseWithoutColorsAreGray) {
  auto splats = ReadSplats(WriteSplats({{.mean = {0, 0, 2}, .opacity = 0.999}}));
  splats.harmonics.clear();
  const RayCaster caster(std::make_shared<const Splats>(std::move(splats)), SplatDepth::kMedian);
  EXPECT_FALSE(caster.HasColors());
  const double params[] = {60, 60, 1, 1};
  const Camera camera(CameraModel::kPinhole, 2, 2, params);
  EXPECT_NEAR(RenderColor(caster, camera, Rigid3(), {}, 1).data[0], 0.99 * 190, 1);
}

TEST(Splats, TheHashIsOfWhatIsSeen) {
  const std::vector<TestSplat> one = {{.mean = {0, 0, 5}}};
  const uint64_t hash = SurfaceHash(CasterOf(one), 1);
  EXPECT_EQ(SurfaceHash(CasterOf(one), 2), hash);
  EXPECT_NE(SurfaceHash(CasterOf(one, SplatDepth::kPeak), 1), hash);
  EXPECT_NE(SurfaceHash(CasterOf({{.mean = {0, 0, 5.1}}}), 1), hash);
}

}  // namespace
}  // namespace raylift
