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
#include "raylift/lifting/mesh_placement.h"
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
  const auto load = [&](const PosedImage& reference) {
    const auto map = scene.maps.find(reference.name);
    return map == scene.maps.end() ? nullptr : map->second;
  };
  return Diagnose({.source = source,
                   .references = scene.references,
                   .matches = scene.matches,
                   .as_read = as_read,
                   .map_size_px = PlaneSize{first.width_px, first.height_px},
                   .stored = StoredMaps{.load = load, .unit = 0.001 * as_read.scale}},
                  options);
}

std::string Describe(const Diagnosis& diagnosis) {
  std::string text =
      fmt::format("{}\nbest fit {:.2f} px, {:.2f} at random; {:.2f}, {:.2f}\n", Summary(diagnosis),
                  diagnosis.fit.median_px, diagnosis.fit.median_chance_px, diagnosis.fit.upper_px,
                  diagnosis.fit.upper_chance_px);
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

// The scene with another depth at every pixel that has one; of the n-th map.
template <typename Change>
Scene WithDepth(const Scene& scene, const Change& change) {
  Scene changed = scene;
  int n = 0;
  for (auto& [name, map] : changed.maps) {
    DepthMap copy = *map;
    for (float& z : copy.z) {
      if (z > 0) z = static_cast<float>(change(double{z}, n));
    }
    map = std::make_shared<const DepthMap>(std::move(copy));
    ++n;
  }
  return changed;
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
  EXPECT_EQ(diagnosis.verdict, Verdict::kTooFewMatches);
  EXPECT_FALSE(diagnosis.suspicious());
}

TEST_F(DemoDoctor, CutOffDepthIsTakenForNone) {
  for (const double most : {6.0, 8.0}) {
    const Diagnosis diagnosis =
        Examine(WithDepth(scene_, [&](double z, int) { return std::min(z, most); }));
    EXPECT_EQ(diagnosis.verdict, Verdict::kRepair) << Describe(diagnosis);
    EXPECT_EQ(diagnosis.fault, InputFault::kClamp);
    EXPECT_EQ(diagnosis.best, InputReading());
    EXPECT_EQ(diagnosis.repair.geometry_keys,
              std::vector<std::string>{fmt::format("invalid={}", 1000 * most)});
  }
}

TEST_F(DemoDoctor, WrappedDepthFitsNothing) {
  for (const double modulus : {4.096, 8.192}) {
    const Diagnosis diagnosis = Examine(
        WithDepth(scene_, [&](double z, int) { return std::max(std::fmod(z, modulus), 0.001); }));
    EXPECT_EQ(diagnosis.verdict, Verdict::kNothingFits) << Describe(diagnosis);
    EXPECT_EQ(diagnosis.fault, InputFault::kWrap) << Describe(diagnosis);
    EXPECT_NE(diagnosis.reason.find(fmt::format("{:.0f}", 1000 * modulus)), std::string::npos);
    EXPECT_EQ(ToString(diagnosis.repair), "");
  }
}

TEST_F(DemoDoctor, DisparityIsNoDepth) {
  for (const double of_map : {0.0, 0.3}) {
    const Scene disparity = WithDepth(scene_, [&](double z, int n) {
      return (1 + of_map * (n % 3)) * 7 / z + 0.4 + of_map * (n % 2);
    });
    for (const DepthKind kind : {DepthKind::kZ, DepthKind::kInverse}) {
      Scene read = disparity;
      if (kind == DepthKind::kInverse) {
        read = WithDepth(disparity, [](double d, int) { return 1 / d; });
      }
      const Diagnosis diagnosis = Examine(read, {.kind = kind});
      EXPECT_EQ(diagnosis.verdict, Verdict::kNothingFits) << Describe(diagnosis);
      EXPECT_EQ(diagnosis.fault, InputFault::kDisparity) << Describe(diagnosis);
    }
  }
}

TEST_F(DemoDoctor, NoisyDepthIsReadAsMeant) {
  Rng rng(3);
  const Scene noisy =
      WithDepth(scene_, [&](double z, int) { return z * std::exp(0.05 * rng.Normal()); });
  EXPECT_EQ(Examine(noisy).verdict, Verdict::kAsMeant);
  const Scene monocular = WithDepth(scene_, [](double z, int n) {
    return z * std::exp(0.15 * std::sin(n) + 0.02 * std::sin(3 * z));
  });
  EXPECT_EQ(Examine(monocular).verdict, Verdict::kAsMeant);
}

TEST_F(DemoDoctor, DepthOfAnotherSceneFitsNothing) {
  Rng rng(4);
  const Diagnosis random =
      Examine(WithDepth(scene_, [&](double, int) { return rng.Uniform(2, 20); }));
  EXPECT_EQ(random.verdict, Verdict::kNothingFits) << Describe(random);
  EXPECT_TRUE(Summary(random).starts_with("nothing fits: ")) << Summary(random);
  const Diagnosis constant = Examine(WithDepth(scene_, [](double, int) { return 5.0; }));
  EXPECT_EQ(constant.verdict, Verdict::kNothingFits) << Describe(constant);
}

TEST_F(DemoDoctor, WrongMatchesAreNotBlamedOnDepth) {
  for (size_t i = 0; i < scene_.matches.size(); ++i) {
    scene_.matches[i].b_px =
        scene_.matches[(i + scene_.matches.size() / 3) % scene_.matches.size()].b_px;
  }
  const Diagnosis diagnosis = Examine(scene_);
  EXPECT_EQ(diagnosis.verdict, Verdict::kNothingFits);
  EXPECT_EQ(diagnosis.fault, InputFault::kPoses);
  EXPECT_NE(diagnosis.reason.find("poses and matches do not agree"), std::string::npos);
}

class MovedMesh : public DemoDoctor {
 protected:
  // The verdict on the demo's mesh where what is right is `world_from_mesh`.
  Diagnosis ExamineMoved(const MeshPlacement& world_from_mesh) const {
    // The inverse: mesh = axes^T (world - shift) / scale.
    MeshPlacement moved{.scale = 1 / world_from_mesh.scale,
                        .axes = world_from_mesh.axes.transpose()};
    moved.shift = -moved.scale * (moved.axes * world_from_mesh.shift);
    const auto caster = std::make_shared<const RayCaster>(std::make_shared<const TriangleMesh>(
        Placed(ReadMesh(fs::path(RAYLIFT_DEMO_DIR) / "scene.obj"), moved)));
    const MeshSource source("mesh", caster);
    return Diagnose({.source = source,
                     .references = scene_.references,
                     .matches = scene_.matches,
                     .mesh = caster});
  }

  void ExpectFound(const MeshPlacement& expected) const {
    const Diagnosis diagnosis = ExamineMoved(expected);
    EXPECT_EQ(diagnosis.verdict, Verdict::kRepair) << Describe(diagnosis);
    ASSERT_TRUE(diagnosis.mesh_placement.has_value()) << Describe(diagnosis);
    const MeshPlacement& found = *diagnosis.mesh_placement;
    EXPECT_NEAR(found.scale / expected.scale, 1, 0.002) << Describe(found);
    EXPECT_LT((found.axes - expected.axes).norm(), 0.01) << Describe(found);
    EXPECT_LT((found.shift - expected.shift).norm(), 0.02) << Describe(found);
  }
};

TEST_F(MovedMesh, IsAsMeantInItsPlace) { EXPECT_EQ(ExamineMoved({}).verdict, Verdict::kAsMeant); }

TEST_F(MovedMesh, IsFoundWhereItIsShifted) { ExpectFound({.shift = {5, 0, 0}}); }

TEST_F(MovedMesh, IsFoundInAnotherUnit) {
  for (const double scale : {0.5, 0.001, 0.3048}) ExpectFound({.scale = scale});
}

TEST_F(MovedMesh, IsFoundWithOtherAxes) {
  for (const char* axes : {"x/-z/y", "x/z/y", "-x/y/z"}) {
    ExpectFound({.axes = AxesFromName(axes).value()});
  }
}

TEST_F(MovedMesh, KeysSayWhatWasFound) {
  const Diagnosis diagnosis = ExamineMoved({.scale = 0.001, .axes = *AxesFromName("x/-z/y")});
  EXPECT_EQ(diagnosis.repair.geometry_keys, std::vector<std::string>{"scale=0.001,axes=x/-z/y"});
}

TEST_F(MovedMesh, NotFoundIsNothingFits) {
  // No similarity.
  TriangleMesh mesh = ReadMesh(fs::path(RAYLIFT_DEMO_DIR) / "scene.obj");
  for (Eigen::Vector3f& v : mesh.vertices) v = {v.x() * 2, v.y() + 0.3f * v.x(), v.z() * 0.6f};
  const auto caster =
      std::make_shared<const RayCaster>(std::make_shared<const TriangleMesh>(std::move(mesh)));
  const MeshSource source("mesh", caster);
  const Diagnosis diagnosis = Diagnose({.source = source,
                                        .references = scene_.references,
                                        .matches = scene_.matches,
                                        .mesh = caster});
  EXPECT_EQ(diagnosis.verdict, Verdict::kNothingFits) << Describe(diagnosis);
}

TEST_F(DemoDoctor, ThreadsDoNotChangeTheResult) {
  const Scene wrong = Plant(scene_, {.kind = DepthKind::kRay});
  EXPECT_EQ(Describe(Examine(wrong, {}, {.max_matches = 1000, .threads = 1})),
            Describe(Examine(wrong, {}, {.max_matches = 1000, .threads = 3})));
}

}  // namespace
}  // namespace raylift
