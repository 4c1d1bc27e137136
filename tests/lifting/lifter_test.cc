#include "raylift/lifting/lifter.h"

#include "support/enum_names.h"
#include "support/matchers.h"
#include "support/meshes.h"
#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "raylift/lifting/mesh_source.h"

namespace raylift {
namespace {

// Looks from the box's inside (its faces point outward) and has a surface for every pixel, but for
// pixels right of x = 50; counts the batches.
class HalfBlindSource final : public GeometrySource {
 public:
  HalfBlindSource()
      : inside_("mesh:box", std::make_shared<const RayCaster>(std::make_shared<const TriangleMesh>(
                                MakeBox({0, 0, 0}, {2, 3, 4})))) {}
  std::string Description() const override { return inside_.Description(); }
  std::vector<std::optional<SurfacePoint>> Lift(
      const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const override {
    ++num_batches;
    auto points = inside_.Lift(reference, pixels);
    for (size_t i = 0; i < pixels.size(); ++i) {
      if (pixels[i].x() > 50) points[i].reset();
    }
    return points;
  }
  mutable int num_batches = 0;

 private:
  MeshSource inside_;
};

TEST(LiftMatches, KeepsTheOrderOfTheMatchesAndCountsWhatItDrops) {
  Rng rng = TestRng();
  const Camera camera = CamerasOfEveryModel()[4];
  std::vector<PosedImage> references;
  for (int i = 0; i < 4; ++i) {
    references.push_back({"r" + std::to_string(i), camera,
                          LookAt({0.1 * i, 0.2, -0.3}, {rng.Normal(), rng.Normal(), 2})});
  }
  std::vector<Match2D2D> matches;
  for (int i = 0; i < 200; ++i) {
    const int reference = static_cast<int>(rng.UniformIndex(3));  // none of the fourth
    matches.push_back({reference, {1.0 * i, 2.0 * i}, {rng.Uniform(0, 64), rng.Uniform(0, 48)}});
    matches.back().query_keypoint = 3 * i;
  }
  const HalfBlindSource source;
  const LiftResult result = LiftMatches(source, references, matches);
  EXPECT_EQ(source.num_batches, 3);

  size_t next = 0;
  for (size_t i = 0; i < matches.size(); ++i) {
    if (matches[i].reference_px.x() > 50) continue;
    ASSERT_LT(next, result.lifted.size());
    const LiftedMatch& lifted = result.lifted[next++];
    EXPECT_EQ(lifted.match.match_2d2d, i);
    EXPECT_EQ(lifted.match.query_px, matches[i].query_px);
    EXPECT_EQ(lifted.match.query_keypoint, matches[i].query_keypoint);
    EXPECT_EQ(lifted.match.reference, matches[i].reference);
    EXPECT_EQ(lifted.match.point_in_world, lifted.surface.point_in_world);
    const PosedImage& reference = references[static_cast<size_t>(matches[i].reference)];
    const auto pixel =
        reference.camera.ImgFromCam(reference.cam_from_world * lifted.match.point_in_world);
    ASSERT_TRUE(pixel);
    EXPECT_LT((*pixel - matches[i].reference_px).norm(), 1e-4);
  }
  EXPECT_EQ(next, result.lifted.size());
  EXPECT_EQ(result.counts.matches, 200u);
  EXPECT_EQ(result.counts.hits, next);
  EXPECT_EQ(result.counts.misses, 200 - next);
  EXPECT_GT(result.counts.misses, 10u);
  EXPECT_EQ(result.counts.back_faces, next);
  EXPECT_EQ(Matches2D3D(result).size(), next);
}

// Knows one depth for the pixels from `begin_x` to `end_x`.
class StripSource final : public GeometrySource {
 public:
  StripSource(double begin_x, double end_x, double depth_z)
      : begin_x_(begin_x), end_x_(end_x), depth_z_(depth_z) {}
  std::string Description() const override { return "strip"; }
  std::vector<std::optional<SurfacePoint>> Lift(
      const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const override {
    std::vector<std::optional<SurfacePoint>> points(pixels.size());
    for (size_t i = 0; i < pixels.size(); ++i) {
      ++num_asked;
      if (pixels[i].x() < begin_x_ || pixels[i].x() >= end_x_) continue;
      const Eigen::Vector3d ray = reference.camera.RayInCam(pixels[i]).value();
      points[i] = {.point_in_world = ray * (depth_z_ / ray.z()),
                   .normal_in_world = -ray,
                   .depth_z = depth_z_,
                   .incidence_deg = 0,
                   .back_face = false};
    }
    return points;
  }
  mutable size_t num_asked = 0;

 private:
  double begin_x_, end_x_, depth_z_;
};

// Source 0 knows x < 30, source 1 20 <= x < 50, of matches at x = 0, 1, ..., 59.
struct TwoStrips {
  StripSource left{0, 30, 2}, middle{20, 50, 3};
  std::vector<PosedImage> references = {{"r", CamerasOfEveryModel()[4], Rigid3()}};
  std::vector<Match2D2D> matches;

  TwoStrips() {
    for (int i = 0; i < 60; ++i) matches.push_back({0, {1.0 * i, 7}, {1.0 * i, 24}});
  }
  LiftResult Lift(GeometryMode mode) const {
    const GeometrySource* const sources[] = {&left, &middle};
    return LiftMatches(sources, mode, references, matches);
  }
};

TEST(LiftMatches, FirstAsksALaterSourceForWhatTheEarlierDoesNotKnow) {
  const TwoStrips strips;
  const LiftResult result = strips.Lift(GeometryMode::kFirst);
  ASSERT_EQ(result.lifted.size(), 50u);
  for (size_t i = 0; i < 50; ++i) {
    EXPECT_EQ(result.lifted[i].match.match_2d2d, i);
    EXPECT_EQ(result.lifted[i].source, i < 30 ? 0u : 1u);
    EXPECT_EQ(result.lifted[i].surface.depth_z, i < 30 ? 2 : 3);
  }
  EXPECT_EQ(result.counts.hits, 50u);
  EXPECT_EQ(result.counts.misses, 10u);
  EXPECT_EQ(result.counts.points_of_source, (std::vector<size_t>{30, 20}));
  EXPECT_EQ(strips.left.num_asked, 60u);
  EXPECT_EQ(strips.middle.num_asked, 30u);
}

TEST(LiftMatches, AllGivesThePointsOfEverySource) {
  const LiftResult result = TwoStrips().Lift(GeometryMode::kAll);
  ASSERT_EQ(result.lifted.size(), 60u);
  EXPECT_EQ(result.counts.hits, 50u);
  EXPECT_EQ(result.counts.misses, 10u);
  EXPECT_EQ(result.counts.points_of_source, (std::vector<size_t>{30, 30}));
  // Matches 20 to 29 have two points, in the order of the sources.
  EXPECT_EQ(result.lifted[20].match.match_2d2d, 20u);
  EXPECT_EQ(result.lifted[20].source, 0u);
  EXPECT_EQ(result.lifted[21].match.match_2d2d, 20u);
  EXPECT_EQ(result.lifted[21].source, 1u);
  EXPECT_EQ(result.lifted[21].match.query_px, result.lifted[20].match.query_px);
}

TEST(LiftMatches, NoMatchesGiveAnEmptyResult) {
  const HalfBlindSource source;
  const LiftResult result = LiftMatches(source, {}, {});
  EXPECT_TRUE(result.lifted.empty());
  EXPECT_EQ(result.counts.matches, 0u);
}

TEST(GeometryMode, EachHasAName) { EXPECT_TRUE(NamesEveryValue<GeometryMode>()); }

}  // namespace
}  // namespace raylift
