#include "lifting/sfm_source.h"

#include <algorithm>
#include <map>
#include <utility>

#include "support/matchers.h"
#include "support/meshes.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/io/hloc_files.h"
#include "raylift/lifting/geometry_spec.h"

namespace raylift {
namespace {

// Two images 1 unit apart, 5 units before four points; all keypoints are exact projections.
struct TinyModel {
  ColmapModel model;
  std::vector<PosedImage> images;
  std::vector<Eigen::Vector3d> points = {{0, 0, 0}, {0.5, 0.2, 0.3}, {-0.6, 0.4, 1}, {1, -1, 2}};

  TinyModel() {
    const double params[] = {500, 320, 240, -0.05};
    model.cameras.emplace(1, Camera(CameraModel::kSimpleRadial, 640, 480, params));
    for (uint32_t i = 0; i < 2; ++i) {
      ColmapImage& image = model.images[10 + i];
      image.name = "r" + std::to_string(i);
      image.camera_id = 1;
      image.SetCamFromWorld(LookAt({1.0 * i, 0, -5}, {0, 0, 0}));
    }
    images = model.PosedImages();
    for (size_t p = 0; p < points.size(); ++p) {
      ColmapPoint3D& point = model.points3d[100 + p];
      point.position_in_world = points[p];
      point.error_px = 0.25 * static_cast<double>(p);
      for (uint32_t i = 0; i < 2; ++i) {
        point.track.push_back({10 + i, AddKeypoint(i, PixelOf(p, i), 100 + p)});
      }
    }
  }

  Eigen::Vector2d PixelOf(size_t point, uint32_t image) const {
    return *images[image].camera.ImgFromCam(images[image].cam_from_world * points[point]);
  }
  uint32_t AddKeypoint(uint32_t image, const Eigen::Vector2d& pixel,
                       std::optional<uint64_t> point3d_id) {
    auto& keypoints = model.images[10 + image].points2d;
    keypoints.push_back({pixel, point3d_id});
    return static_cast<uint32_t>(keypoints.size() - 1);
  }

  std::optional<SurfacePoint> Lift(const Eigen::Vector2d& pixel,
                                   const SfmOptions& options = {}) const {
    return SfmSource("sfm", model, options).Lift(images[0], {&pixel, 1})[0];
  }
  bool LiftsTo(size_t point, const Eigen::Vector2d& pixel, const SfmOptions& options = {}) const {
    const auto lifted = Lift(pixel, options);
    return lifted && lifted->point_in_world == points[point];
  }
};

TEST(SfmSource, TheModelsOwnKeypointsHaveTheirPointsAndItsRecord) {
  const TinyModel tiny;
  const SfmSource source("sfm:tiny", tiny.model, {.radius_px = 0});
  EXPECT_EQ(source.Description(), "sfm:tiny");
  for (uint32_t i = 0; i < 2; ++i) {
    std::vector<Eigen::Vector2d> pixels;
    for (size_t p = 0; p < 4; ++p) pixels.push_back(tiny.PixelOf(p, i));
    const auto lifted = source.Lift(tiny.images[i], pixels);
    for (size_t p = 0; p < 4; ++p) {
      ASSERT_TRUE(lifted[p]);
      EXPECT_EQ(lifted[p]->point_in_world, tiny.points[p]);
      const Eigen::Vector3d in_cam = tiny.images[i].cam_from_world * tiny.points[p];
      EXPECT_NEAR(lifted[p]->depth_z, in_cam.z(), 1e-12);
      const Eigen::Vector3d toward_camera =
          -(tiny.images[i].cam_from_world.rotation.conjugate() * in_cam.normalized());
      EXPECT_LT((lifted[p]->normal_in_world - toward_camera).norm(), 1e-12);
      EXPECT_FALSE(lifted[p]->back_face);
      EXPECT_FALSE(lifted[p]->depth_jump);
      ASSERT_TRUE(lifted[p]->track);
      EXPECT_EQ(lifted[p]->track->length, 2u);
      EXPECT_EQ(lifted[p]->track->error_px, 0.25 * static_cast<double>(p));
    }
  }
}

TEST(SfmSource, OtherFeaturesTakeTheNearestPointWithinTheRadius) {
  const TinyModel tiny;
  const Eigen::Vector2d pixel = tiny.PixelOf(1, 0);
  EXPECT_TRUE(tiny.LiftsTo(1, pixel + Eigen::Vector2d(1.1, -1.6)));  // 1.94 px off
  EXPECT_FALSE(tiny.Lift(pixel + Eigen::Vector2d(1.3, -1.6)));       // 2.06 px off
  EXPECT_TRUE(tiny.LiftsTo(1, pixel + Eigen::Vector2d(1.3, -1.6), {.radius_px = 2.1}));
  EXPECT_FALSE(tiny.Lift(pixel + Eigen::Vector2d(0.1, 0), {.radius_px = 0}));
  const Eigen::Vector2d between = 0.6 * tiny.PixelOf(0, 0) + 0.4 * pixel;
  EXPECT_TRUE(tiny.LiftsTo(0, between, {.radius_px = 200}));
  EXPECT_FALSE(tiny.Lift({0, 0}));
}

TEST(SfmSource, AKeypointOfTheModelWithoutAPointHasNone) {
  TinyModel tiny;
  const Eigen::Vector2d pixel = tiny.PixelOf(2, 0) + Eigen::Vector2d(0.5, 0);
  EXPECT_TRUE(tiny.LiftsTo(2, pixel));
  tiny.AddKeypoint(0, pixel, std::nullopt);
  EXPECT_FALSE(tiny.Lift(pixel));
  // Another feature at that place, of another orientation, may have one.
  tiny.AddKeypoint(0, pixel, 102);
  EXPECT_TRUE(tiny.LiftsTo(2, pixel));
  // Of several, the one that most images confirm.
  tiny.AddKeypoint(0, pixel, 103);
  tiny.model.points3d[103].track.push_back({11, 0});
  EXPECT_TRUE(tiny.LiftsTo(3, pixel));
}

TEST(SfmSource, DropsWhatTheOptionsSay) {
  TinyModel tiny;
  const auto lifts = [&tiny](size_t point, const SfmOptions& options) {
    return tiny.Lift(tiny.PixelOf(point, 0), options).has_value();
  };
  EXPECT_TRUE(lifts(3, {.max_error_px = 0.75}));
  EXPECT_FALSE(lifts(3, {.max_error_px = 0.74}));
  EXPECT_TRUE(lifts(3, {.min_track_length = 2}));
  EXPECT_FALSE(lifts(3, {.min_track_length = 3}));
  EXPECT_FALSE(lifts(3, {.limits = {.far_z = 5}}));
  EXPECT_TRUE(lifts(0, {.limits = {.near_z = 4.9, .far_z = 5.1}}));
  // A track that is longer than the model knows, and points that it does not hold.
  tiny.model.points3d.erase(103);
  EXPECT_FALSE(lifts(3, {}));
}

TEST(SfmSource, ImagesThatTheModelDoesNotHoldHaveNoPoints) {
  const TinyModel tiny;
  const Eigen::Vector2d pixel = tiny.PixelOf(0, 0);
  PosedImage other = tiny.images[0];
  other.name = "other";
  EXPECT_FALSE(SfmSource("sfm", tiny.model).Lift(other, {&pixel, 1})[0]);
  // The reference's pose counts: a point behind it is not what it shows.
  PosedImage turned = tiny.images[0];
  turned.cam_from_world = LookAt({0, 0, -5}, {0, 0, -10});
  EXPECT_FALSE(SfmSource("sfm", tiny.model).Lift(turned, {&pixel, 1})[0]);
}

TEST(CheckSfmModel, NoticesAnotherFrameAndMissingReferences) {
  const TinyModel tiny;
  const SfmFit right = CheckSfmModel(tiny.model, tiny.images);
  EXPECT_EQ(right.interpretation,
            "4 points, tracks of 2 images (median), 0.00 px from the references' keypoints "
            "(median)");
  EXPECT_TRUE(right.warnings.empty());

  std::vector<PosedImage> references = tiny.images;
  for (PosedImage& image : references) image.cam_from_world = LookAt({0, 3, -5}, {0, 1, 0});
  references.push_back(references[0]);
  references.back().name = "third";
  const SfmFit wrong = CheckSfmModel(tiny.model, references);
  ASSERT_EQ(wrong.warnings.size(), 2u);
  EXPECT_EQ(wrong.warnings[0], "1 of 3 references are not in the model");
  EXPECT_NE(wrong.warnings[1].find("another coordinate frame?"), std::string::npos);
}

TEST(MakeGeometrySource, OpensSfmModels) {
  const TinyModel tiny;
  const std::string folder = (TestFolder() / "model").string();
  WriteColmapModel(folder, tiny.model, ColmapForm::kBinary);
  const auto lifts = [&](const std::string& spec, const Eigen::Vector2d& pixel) {
    const NamedGeometry geometry =
        MakeGeometrySource(spec, {.model = folder, .references = tiny.images});
    EXPECT_EQ(geometry.kind, GeometryKind::kSfm);
    EXPECT_EQ(geometry.source->Description(), "sfm:" + folder);
    EXPECT_TRUE(geometry.interpretation.starts_with("4 points")) << geometry.interpretation;
    EXPECT_TRUE(geometry.warnings.empty());
    return geometry.source->Lift(tiny.images[0], {&pixel, 1})[0].has_value();
  };
  const Eigen::Vector2d own = tiny.PixelOf(3, 0);
  const Eigen::Vector2d near = own + Eigen::Vector2d(0, 1.5);
  EXPECT_TRUE(lifts("sfm", own));
  EXPECT_TRUE(lifts("sfm:" + folder, near));
  EXPECT_FALSE(lifts("sfm,radius=1", near));
  EXPECT_TRUE(lifts("sfm:" + folder + ",radius=1.6,min_track=2,max_error=1,near=1,far=10", near));
  EXPECT_FALSE(lifts("sfm,min_track=3", own));
  EXPECT_FALSE(lifts("sfm,max_error=0.5", own));
  EXPECT_FALSE(lifts("sfm,far=5", own));
}

TEST(MakeGeometrySource, SfmPointsAreThinnedOutWithTheirImages) {
  const TinyModel tiny;
  const std::string folder = (TestFolder() / "model").string();
  WriteColmapModel(folder, tiny.model, ColmapForm::kBinary);
  const std::vector<PosedImage> kept = {tiny.images[0]};
  const std::vector<std::string> thinned_out = {tiny.images[1].name};
  EXPECT_TRUE(FailsWithInputError(
      [&] {
        MakeGeometrySource("sfm",
                           {.model = folder, .references = kept, .thinned_out = thinned_out});
      },
      {folder, "no 3D point is seen by two"}));
}

TEST(MakeGeometrySource, AModelWithoutPointsIsAnInputError) {
  TinyModel tiny;
  tiny.model.points3d.clear();
  const std::string folder = (TestFolder() / "model").string();
  WriteColmapModel(folder, tiny.model, ColmapForm::kText);
  EXPECT_TRUE(FailsWithInputError([&] { MakeGeometrySource("sfm:" + folder); },
                                  {folder, "the model has no 3D points"}));
}

// COLMAP's own features: keypoint i of the features file is keypoint i of the model. Where several
// features are at one place, any of their points may be meant.
TEST(SfmSource, FollowsTheLinksOfARealModel) {
  const auto data = FindTestData("sceaux_sfm");
  if (!data) GTEST_SKIP() << "sceaux_sfm is not on this machine";
  const ColmapModel model = ReadColmapModel(*data / "model_ref");
  const SfmSource source("sfm", model);
  const FeatureFile features(*data / "features.h5");
  const auto images = model.PosedImages();
  size_t num_linked = 0;
  for (const auto& [id, image] : model.images) {
    using Place = std::pair<double, double>;
    std::map<Place, std::vector<Eigen::Vector3d>> points_at;
    const auto place_of = [](const Eigen::Vector2d& pixel) { return Place(pixel.x(), pixel.y()); };
    for (const auto& keypoint : image.points2d) {
      if (!keypoint.point3d_id) continue;
      points_at[place_of(keypoint.pixel)].push_back(
          model.points3d.at(*keypoint.point3d_id).position_in_world);
      ++num_linked;
    }
    const auto reference =
        std::find_if(images.begin(), images.end(),
                     [&name = image.name](const PosedImage& other) { return other.name == name; });
    const auto pixels = features.Read(image.name).keypoints_px;
    const auto lifted = source.Lift(*reference, pixels);
    ASSERT_EQ(pixels.size(), image.points2d.size());
    for (size_t i = 0; i < pixels.size(); ++i) {
      EXPECT_LT((pixels[i] - image.points2d[i].pixel).norm(), 0.01);
      const auto points = points_at.find(place_of(image.points2d[i].pixel));
      ASSERT_EQ(lifted[i].has_value(), points != points_at.end()) << pixels[i].transpose();
      if (!lifted[i]) continue;
      EXPECT_NE(std::find(points->second.begin(), points->second.end(), lifted[i]->point_in_world),
                points->second.end());
    }
  }
  EXPECT_GT(num_linked, 10000u);
}

}  // namespace
}  // namespace raylift
