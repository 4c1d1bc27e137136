// The doctor on the real room and on the demo: it finds what was planted and nothing else.

#include "raylift/lifting/input_doctor.h"

#include <cmath>
#include <map>
#include <memory>

#include "support/test_data.h"
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "raylift/base/rng.h"
#include "raylift/io/query_list.h"
#include "raylift/lifting/depth_source.h"
#include "raylift/lifting/mesh_source.h"
#include "raylift/localization/hloc_matches.h"
#include "raylift/localization/references.h"
#include "raylift/localization/scene_matches.h"
#include "raylift/renderers/mesh_reader.h"
#include "raylift/renderers/view_renderer.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

using MapsByName = std::map<std::string, std::shared_ptr<const DepthMap>>;

class MapsInMemory final : public GeometrySource {
 public:
  MapsInMemory(MapsByName maps, double first_sample_px) : maps_(std::move(maps)) {
    sampling_.first_sample_px = first_sample_px;
  }
  std::string Description() const override { return "maps"; }
  std::vector<std::optional<SurfacePoint>> Lift(
      const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const override {
    const auto map = maps_.find(reference.name);
    if (map == maps_.end()) return std::vector<std::optional<SurfacePoint>>(pixels.size());
    return LiftByDepthMap(*map->second, reference, pixels, sampling_);
  }

 private:
  MapsByName maps_;
  DepthSamplingOptions sampling_;
};

// A scene whose input is read rightly.
struct Scene {
  std::vector<PosedImage> references;
  std::vector<ReferenceMatch> matches;
  MapsByName maps;
};

// What a file holds that is `true_reading` but is read as z in our convention.
Scene Plant(const Scene& scene, const InputReading& true_reading) {
  Scene planted = scene;
  for (PosedImage& reference : planted.references) {
    reference.cam_from_world = StoredPose(reference.cam_from_world, true_reading.poses);
    if (!scene.maps.contains(reference.name)) continue;
    const DepthMap& map = *scene.maps.at(reference.name);
    const auto ray_z = RayZOfPixels(reference.camera.Scaled(map.width_px, map.height_px));
    StoredDepth stored;
    stored.width_px = map.width_px;
    stored.height_px = map.height_px;
    stored.values = map.z;
    for (size_t i = 0; i < stored.values.size(); ++i) {
      float& value = stored.values[i];
      if (value == 0) continue;
      if (true_reading.kind == DepthKind::kRay) value /= ray_z[i];
      if (true_reading.kind == DepthKind::kInverse) value = 1 / value;
      value /= static_cast<float>(true_reading.scale);
    }
    stored = Oriented(std::move(stored), true_reading.orientation);
    planted.maps[reference.name] = std::make_shared<const DepthMap>(
        DepthMap{stored.width_px, stored.height_px, std::move(stored.values)});
  }
  return planted;
}

Diagnosis Examine(const Scene& scene, const InputReading& as_read = {},
                  const DoctorOptions& options = {}) {
  const MapsInMemory source(scene.maps, as_read.first_sample_px);
  const DepthMap& first = *scene.maps.begin()->second;
  return Diagnose({.source = source,
                   .references = scene.references,
                   .matches = scene.matches,
                   .as_read = as_read,
                   .map_size_px = PlaneSize{first.width_px, first.height_px}},
                  options);
}

std::string Describe(const Diagnosis& diagnosis) {
  std::string text = Summary(diagnosis) + "\n";
  for (const ReadingEvidence& e : diagnosis.readings) {
    text +=
        fmt::format("{:7.2f} px {:5.3f} within 5 px, own scale {:7.2f} px; {:7.1f} {:7.4f} {}\n",
                    e.median_px, e.share_within_5px, e.median_own_scale_px, e.sigmas, e.gain,
                    DescribeDifference(diagnosis.as_read, e.reading));
  }
  return text;
}

::testing::AssertionResult Finds(const InputReading& expected, double scale_tolerance,
                                 const Diagnosis& diagnosis) {
  const double relative = diagnosis.best.scale / expected.scale;
  InputReading best = diagnosis.best;
  if (std::abs(std::log(relative)) <= scale_tolerance) best.scale = expected.scale;
  if (best == expected) return ::testing::AssertionSuccess();
  return ::testing::AssertionFailure()
         << "expected: " << DescribeDifference(diagnosis.as_read, expected) << "\n"
         << Describe(diagnosis);
}

// The readings that are planted one at a time; a shift is planted by reading it wrongly.
std::vector<InputReading> WrongReadings() {
  return {{.kind = DepthKind::kRay},
          {.kind = DepthKind::kInverse},
          {.scale = 1000},
          {.scale = 0.0254},
          {.scale = 1.37},
          {.orientation = MapOrientation::kFlippedX},
          {.orientation = MapOrientation::kFlippedY},
          {.orientation = MapOrientation::kTransposed},
          {.poses = PoseConvention::kWorldFromCam},
          {.poses = PoseConvention::kOpenGlCamFromWorld},
          {.poses = PoseConvention::kWorldFromOpenGlCamera}};
}

void ExpectFindsEachWrongReading(const Scene& right, double scale_tolerance) {
  for (const InputReading& wrong : WrongReadings()) {
    EXPECT_TRUE(
        Finds(wrong, scale_tolerance, Examine(Plant(right, wrong), {}, {.max_matches = 4000})));
  }
}

std::shared_ptr<const RayCaster> Open(const fs::path& mesh) {
  return std::make_shared<const RayCaster>(std::make_shared<const TriangleMesh>(ReadMesh(mesh)));
}

MapsByName RenderMaps(const RayCaster& caster, const std::vector<PosedImage>& references,
                      int width_px) {
  MapsByName maps;
  for (const PosedImage& r : references) {
    const int height_px = width_px * r.camera.height_px() / r.camera.width_px();
    maps[r.name] = std::make_shared<const DepthMap>(
        RenderDepth(caster, r.camera.Scaled(width_px, height_px), r.cam_from_world, 1));
  }
  return maps;
}

class RgbdSmallDoctor : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto data = FindTestData("rgbd_small");
    if (!data) GTEST_SKIP() << "rgbd_small is not on this machine";
    data_ = *data;
    Load(1);
  }

  void Load(int every) {
    const ReferenceSet references = LoadReferences(data_ / "model_ref", every).references;
    const auto queries = ReadQueryList(data_ / "queries_with_intrinsics.txt");
    const auto matches = OpenHlocMatches(
        {data_ / "features.h5", data_ / "matches.h5", data_ / "pairs.txt"}, references, 10);
    scene_.references = references.images;
    scene_.matches = CollectReferenceMatches(queries, *matches, references, 1);
  }

  Scene With(const std::string& folder) const {
    Scene scene = scene_;
    const DepthFolder maps(data_ / folder, {.invalid_values = {65535}}, scene.references);
    for (const PosedImage& r : scene.references) scene.maps[r.name] = maps.Load(r);
    return scene;
  }

  fs::path data_;
  Scene scene_;
};

TEST_F(RgbdSmallDoctor, FindsEachWrongReadingOfSensorDepth) {
  ExpectFindsEachWrongReading(With("depth_sensor"), 0.01);
}

TEST_F(RgbdSmallDoctor, FindsEachWrongReadingOfMonocularDepth) {
  ExpectFindsEachWrongReading(With("depth_mono_sim"), 0.06);  // its maps are off by 10 %
}

TEST_F(RgbdSmallDoctor, IsSilentOnTheRightReading) {
  EXPECT_TRUE(Finds({}, 0, Examine(With("depth_sensor"))));
  EXPECT_TRUE(Finds({}, 0, Examine(With("depth_mono_sim"))));
}

TEST_F(RgbdSmallDoctor, IsSilentWhereReferencesAreFew) {
  for (const int every : {2, 3, 5}) {
    Load(every);
    EXPECT_TRUE(Finds({}, 0, Examine(With("depth_sensor")))) << every;
    EXPECT_TRUE(Finds({}, 0, Examine(With("depth_mono_sim")))) << every;
  }
}

TEST_F(RgbdSmallDoctor, FewMatchesTellGrossErrorsAndRaiseNoFalseAlarm) {
  const DoctorOptions quick{.max_matches = 1500, .shifts = false};
  const Scene sensor = With("depth_sensor");
  const Scene monocular = With("depth_mono_sim");
  EXPECT_TRUE(Finds({}, 0, Examine(sensor, {}, quick)));
  EXPECT_TRUE(Finds({}, 0, Examine(monocular, {}, quick)));
  for (const InputReading& wrong : WrongReadings()) {
    EXPECT_TRUE(Finds(wrong, 0.02, Examine(Plant(sensor, wrong), {}, quick)));
  }
}

// The data's own depth and colour are registered within a pixel of the images (the matches say 1.2
// px, downwards), so that half a pixel can be told where pixels are larger.
TEST_F(RgbdSmallDoctor, FindsHalfAPixelOfCoarseMaps) {
  const auto caster = Open(data_ / "mesh.ply");
  Scene scene = scene_;
  scene.maps = RenderMaps(*caster, scene.references, 80);
  for (const double first_sample_px : {0.0, 0.5, 1.0}) {
    EXPECT_TRUE(Finds({}, 0, Examine(scene, {.first_sample_px = first_sample_px})));
  }
  scene.maps = RenderMaps(*caster, scene.references, 640);
  EXPECT_TRUE(Finds({}, 0, Examine(scene)));
}

TEST_F(RgbdSmallDoctor, FindsWrongPosesOfAMesh) {
  using enum PoseConvention;
  const MeshSource mesh("mesh", Open(data_ / "mesh.ply"));
  for (const PoseConvention poses :
       {kCamFromWorld, kWorldFromCam, kOpenGlCamFromWorld, kWorldFromOpenGlCamera}) {
    const Scene scene = Plant(scene_, {.poses = poses});
    EXPECT_TRUE(Finds(
        {.poses = poses}, 0,
        Diagnose({.source = mesh, .references = scene.references, .matches = scene.matches})));
  }
}

// Random pixels of each reference, where others see the same point, with noise.
std::vector<ReferenceMatch> MatchByMesh(const GeometrySource& mesh,
                                        const std::vector<PosedImage>& references, double noise_px,
                                        Rng& rng) {
  std::vector<ReferenceMatch> matches;
  const int count = static_cast<int>(references.size());
  for (int a = 0; a < count; ++a) {
    const PosedImage& from = references[static_cast<size_t>(a)];
    std::vector<Eigen::Vector2d> pixels;
    for (int i = 0; i < 100; ++i) {
      pixels.emplace_back(rng.Uniform(0, from.camera.width_px()),
                          rng.Uniform(0, from.camera.height_px()));
    }
    const auto points = mesh.Lift(from, pixels);
    for (int b = 0; b < count; ++b) {
      const PosedImage& to = references[static_cast<size_t>(b)];
      for (size_t i = 0; a != b && i < pixels.size(); ++i) {
        if (!points[i]) continue;
        const auto seen = to.camera.ImgFromCam(to.cam_from_world * points[i]->point_in_world);
        if (!seen || !to.camera.Contains(*seen)) continue;
        const auto there = mesh.Lift(to, {&*seen, 1})[0];
        if (!there || (there->point_in_world - points[i]->point_in_world).norm() > 0.01) continue;
        const Eigen::Vector2d noise(rng.Normal(), rng.Normal());
        matches.push_back({a, b, pixels[i], *seen + noise_px * noise});
      }
    }
  }
  return matches;
}

class DemoDoctor : public ::testing::Test {
 protected:
  void SetUp() override {
    const fs::path demo = RAYLIFT_DEMO_DIR;
    const auto caster = Open(demo / "scene.obj");
    scene_.references = LoadReferences(demo / "model", 1).references.images;
    Rng rng(1);
    scene_.matches = MatchByMesh(MeshSource("mesh", caster), scene_.references, 0.7, rng);
    scene_.maps = RenderMaps(*caster, scene_.references, 160);
  }

  Scene scene_;
};

TEST_F(DemoDoctor, FindsEachWrongReadingAndNothingElse) {
  EXPECT_TRUE(Finds({}, 0, Examine(scene_)));
  ExpectFindsEachWrongReading(scene_, 0.01);
  for (const double first_sample_px : {0.0, 1.0}) {
    EXPECT_TRUE(Finds({}, 0, Examine(scene_, {.first_sample_px = first_sample_px})));
  }
}

TEST_F(DemoDoctor, FindsTwoMistakesAtOnce) {
  const InputReading wrong{.orientation = MapOrientation::kFlippedY,
                           .scale = 0.001,
                           .poses = PoseConvention::kWorldFromOpenGlCamera};
  EXPECT_TRUE(Finds(wrong, 0.01, Examine(Plant(scene_, wrong))));
  const InputReading disparity{.kind = DepthKind::kInverse, .scale = 0.01};
  EXPECT_TRUE(Finds(disparity, 0.01, Examine(Plant(scene_, disparity))));
}

TEST_F(DemoDoctor, SaysNothingOfTooFewMatches) {
  scene_.matches.resize(10);
  const Diagnosis diagnosis = Examine(Plant(scene_, {.scale = 0.001}));
  EXPECT_TRUE(diagnosis.too_few_matches);
  EXPECT_FALSE(diagnosis.suspicious());
}

TEST_F(DemoDoctor, ThreadsDoNotChangeTheResult) {
  const Scene wrong = Plant(scene_, {.kind = DepthKind::kRay});
  EXPECT_EQ(Describe(Examine(wrong, {}, {.max_matches = 1000, .threads = 1})),
            Describe(Examine(wrong, {}, {.max_matches = 1000, .threads = 3})));
}

}  // namespace
}  // namespace raylift
