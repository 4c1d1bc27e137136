// The doctor on the real room and on the demo: it finds what was planted and nothing else.

#include "raylift/diagnosis/doctor.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <iterator>
#include <map>
#include <memory>

#include "base/rng.h"
#include "lifting/depth_convention.h"
#include "lifting/mesh_placement.h"
#include "localization/calibration_images.h"
#include "localization/matching/file_matches.h"
#include "support/test_data.h"
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "raylift/io/query_list.h"
#include "raylift/lifting/depth_source.h"
#include "raylift/lifting/geometry_spec.h"
#include "raylift/lifting/mesh_source.h"
#include "raylift/localization/match_source.h"
#include "raylift/localization/scene.h"
#include "raylift/renderers/frame_renderer.h"
#include "raylift/surfaces/mesh_files.h"

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
Scene Plant(const Scene& scene, const DataConvention& true_reading) {
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

Diagnosis Examine(const Scene& scene, const DataConvention& as_read = {},
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
  for (const ConventionEvidence& e : diagnosis.conventions) {
    text +=
        fmt::format("{:7.2f} px {:5.3f} within 5 px, own scale {:7.2f} px; {:7.1f} {:7.4f} {}\n",
                    e.median_px, e.share_within_5px, e.median_own_scale_px, e.sigmas, e.gain,
                    DescribeDifference(diagnosis.as_read, e.convention));
  }
  return text;
}

::testing::AssertionResult Finds(const DataConvention& expected, double scale_tolerance,
                                 const Diagnosis& diagnosis) {
  const double relative = diagnosis.best.scale / expected.scale;
  DataConvention best = diagnosis.best;
  if (std::abs(std::log(relative)) <= scale_tolerance) best.scale = expected.scale;
  if (best == expected) return ::testing::AssertionSuccess();
  return ::testing::AssertionFailure()
         << "expected: " << DescribeDifference(diagnosis.as_read, expected) << "\n"
         << Describe(diagnosis);
}

// The readings that are planted one at a time; a shift is planted by reading it wrongly.
std::vector<DataConvention> WrongReadings() {
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
  for (const DataConvention& wrong : WrongReadings()) {
    EXPECT_TRUE(
        Finds(wrong, scale_tolerance, Examine(Plant(right, wrong), {}, {.max_matches = 4000})));
  }
}

std::shared_ptr<const RayCaster> CasterOf(TriangleMesh mesh) {
  return std::make_shared<const RayCaster>(std::make_shared<const TriangleMesh>(std::move(mesh)));
}

std::shared_ptr<const RayCaster> Open(const fs::path& mesh) { return CasterOf(ReadMesh(mesh)); }

// Of a mesh in place of the scene's maps.
Diagnosis ExamineMesh(const Scene& scene, TriangleMesh mesh) {
  const auto caster = CasterOf(std::move(mesh));
  const MeshSource source("mesh", caster);
  return Diagnose(
      {.source = source, .references = scene.references, .matches = scene.matches, .mesh = caster});
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
    const ReferenceSet references =
        LoadReferences(data_ / "model_ref", {.every = every}).references;
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
  const DoctorOptions quick{.max_matches = 1500, .half_pixels = false};
  const Scene sensor = With("depth_sensor");
  const Scene monocular = With("depth_mono_sim");
  EXPECT_TRUE(Finds({}, 0, Examine(sensor, {}, quick)));
  EXPECT_TRUE(Finds({}, 0, Examine(monocular, {}, quick)));
  for (const DataConvention& wrong : WrongReadings()) {
    EXPECT_TRUE(Finds(wrong, 0.02, Examine(Plant(sensor, wrong), {}, quick)));
  }
}

// The data's own depth and color are registered within a pixel of the images (the matches say 1.2
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

TEST_F(RgbdSmallDoctor, FindsFaultsOfStoredDepth) {
  for (const char* folder : {"depth_sensor", "depth_mono_sim"}) {
    const Scene right = With(folder);
    const Diagnosis clamped =
        Examine(WithDepth(right, [](double z, int) { return std::min(z, 2.0); }));
    EXPECT_EQ(clamped.repair.geometry_keys, std::vector<std::string>{"invalid=2000"})
        << folder << Describe(clamped);
    const Diagnosis wrapped = Examine(
        WithDepth(right, [](double z, int) { return std::max(std::fmod(z, 2.048), 0.001); }));
    EXPECT_EQ(wrapped.verdict, InputVerdict::kNothingFits) << folder << Describe(wrapped);
    // Of maps that are off by 10 % it cannot be told what else is wrong.
    if (folder == std::string("depth_sensor")) {
      EXPECT_EQ(wrapped.fault, InputFault::kWrap);
    }
    const Diagnosis disparity =
        Examine(WithDepth(right, [](double z, int) { return 0.7 / z + 0.1; }));
    EXPECT_EQ(disparity.fault, InputFault::kDisparity) << folder << Describe(disparity);
  }
}

class DemoDoctor : public ::testing::Test {
 protected:
  void SetUp() override {
    const fs::path demo = DemoFolder();
    const auto caster = Open(demo / "scene.obj");
    scene_.references = LoadReferences(demo / "model").references.images;
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
  const DataConvention wrong{.orientation = MapOrientation::kFlippedY,
                             .scale = 0.001,
                             .poses = PoseConvention::kWorldFromOpenGlCamera};
  EXPECT_TRUE(Finds(wrong, 0.01, Examine(Plant(scene_, wrong))));
  const DataConvention disparity{.kind = DepthKind::kInverse, .scale = 0.01};
  EXPECT_TRUE(Finds(disparity, 0.01, Examine(Plant(scene_, disparity))));
}

TEST_F(DemoDoctor, SaysNothingOfTooFewMatches) {
  scene_.matches.resize(10);
  const Diagnosis diagnosis = Examine(Plant(scene_, {.scale = 0.001}));
  EXPECT_EQ(diagnosis.verdict, InputVerdict::kTooFewMatches);
  EXPECT_FALSE(diagnosis.suspicious());
}

TEST_F(DemoDoctor, CutOffDepthIsTakenForNone) {
  for (const double most : {6.0, 8.0}) {
    const Diagnosis diagnosis =
        Examine(WithDepth(scene_, [&](double z, int) { return std::min(z, most); }));
    EXPECT_EQ(diagnosis.verdict, InputVerdict::kRepair) << Describe(diagnosis);
    EXPECT_EQ(diagnosis.fault, InputFault::kClamp);
    EXPECT_EQ(diagnosis.best, DataConvention());
    EXPECT_EQ(diagnosis.repair.geometry_keys,
              std::vector<std::string>{fmt::format("invalid={}", 1000 * most)});
  }
}

TEST_F(DemoDoctor, CutOffDepthIsToldFromRightDepthAtTheOtherEnd) {
  const Scene both = WithDepth(scene_, [](double z, int) { return std::clamp(z, 3.0, 8.0); });
  // Nearer than 3 most keypoints are right: the many exact values there are a floor at 3.
  Scene near = both;
  std::erase_if(near.matches, [&](const ReferenceMatch& m) {
    const auto depth_at = [&](int reference, const Eigen::Vector2d& px) {
      const PosedImage& image = near.references[static_cast<size_t>(reference)];
      const auto point = LiftByDepthMap(*scene_.maps.at(image.name), image, {&px, 1}, {})[0];
      return point ? point->depth_z : 0.0;
    };
    return depth_at(m.reference_a, m.a_px) < 3.2 || depth_at(m.reference_b, m.b_px) < 3.2;
  });
  const Diagnosis diagnosis = Examine(near);
  EXPECT_EQ(diagnosis.repair.geometry_keys, std::vector<std::string>{"invalid=8000"})
      << Describe(diagnosis);
}

// What is printed for values that are cut off matches what float files hold.
TEST_F(DemoDoctor, InvalidValuesOfFloatMapsAreFoundAgain) {
  for (const DepthKind kind : {DepthKind::kZ, DepthKind::kRay, DepthKind::kInverse}) {
    for (const double scale : {1.0, 0.3}) {
      DepthConvention convention{.kind = kind, .unit = 1, .scale = scale};
      std::map<std::string, StoredDepth> files;
      std::ptrdiff_t right = 0;
      Scene scene = scene_;
      const auto read = [&] {
        for (const PosedImage& r : scene.references) {
          scene.maps[r.name] =
              std::make_shared<const DepthMap>(ToDepthMap(files.at(r.name), r.camera, convention));
        }
      };
      for (const PosedImage& r : scene.references) {
        const DepthMap& map = *scene_.maps.at(r.name);
        const auto ray_z = RayZOfPixels(r.camera.Scaled(map.width_px, map.height_px));
        StoredDepth& file = files[r.name];
        file.width_px = map.width_px;
        file.height_px = map.height_px;
        file.values = map.z;
        file.sample_type = "float32";
        for (size_t i = 0; i < file.values.size(); ++i) {
          float& value = file.values[i];
          if (value == 0) continue;
          if (kind == DepthKind::kRay) value /= ray_z[i];
          if (value < 7.3f) ++right;
          value = std::min(value, 7.3f);
          if (kind == DepthKind::kInverse) value = 1 / value;
          value /= static_cast<float>(scale);
        }
      }
      read();
      const auto load = [&](const PosedImage& r) { return scene.maps.at(r.name); };
      const MapsInMemory source(scene.maps, 0.5);
      const DepthMap& first = *scene.maps.begin()->second;
      const Diagnosis diagnosis =
          Diagnose({.source = source,
                    .references = scene.references,
                    .matches = scene.matches,
                    .as_read = {.kind = kind, .scale = scale},
                    .map_size_px = PlaneSize{first.width_px, first.height_px},
                    .stored = StoredMaps{.load = load, .unit = scale}});
      ASSERT_EQ(diagnosis.fault, InputFault::kClamp) << Describe(diagnosis);
      ASSERT_EQ(diagnosis.repair.geometry_keys.size(), 1u);
      const std::string& key = diagnosis.repair.geometry_keys[0];
      ASSERT_TRUE(key.starts_with("invalid=")) << key;
      EXPECT_NE(diagnosis.reason.find("cut off"), std::string::npos) << diagnosis.reason;
      EXPECT_NE(diagnosis.reason.find(kind == DepthKind::kInverse ? "the smallest" : "the largest"),
                std::string::npos);
      convention.invalid_values = {std::stod(key.substr(8))};
      read();
      std::ptrdiff_t left = 0;
      for (const auto& [name, map] : scene.maps) {
        left += std::count_if(map->z.begin(), map->z.end(), [](float z) { return z > 0; });
      }
      EXPECT_NEAR(left, right, 3) << key;  // some may by chance have the value
      EXPECT_NE(Examine(scene, {.kind = kind, .scale = scale}).fault, InputFault::kClamp) << key;
    }
  }
}

TEST_F(DemoDoctor, WrongBackgroundIsNoWrap) {
  std::vector<float> depths;
  for (const auto& [name, map] : scene_.maps) {
    std::copy_if(map->z.begin(), map->z.end(), std::back_inserter(depths),
                 [](float z) { return z > 0; });
  }
  std::sort(depths.begin(), depths.end());
  const double most = double{depths[depths.size() * 95 / 100]};
  const Scene far = WithDepth(scene_, [&](double z, int) { return z > most ? 0.6 * z : z; });
  EXPECT_NE(Examine(far).fault, InputFault::kWrap) << Describe(Examine(far));
  EXPECT_EQ(Examine(far).verdict, InputVerdict::kAsMeant) << Describe(Examine(far));
}

TEST_F(DemoDoctor, OffsetDepthIsNoDisparity) {
  // On walls 4 to 6 away.
  const Scene offset =
      WithDepth(scene_, [](double z, int) { return z < 4 || z > 6 ? 0.0 : z - 0.5; });
  const Diagnosis diagnosis = Examine(offset);
  EXPECT_EQ(diagnosis.fault, InputFault::kAffine) << Describe(diagnosis);
}

TEST_F(DemoDoctor, ViewsWithoutParallaxTellNoDepth) {
  // All from about the same place.
  const Eigen::Vector3d center = scene_.references[0].cam_from_world.OriginInSource();
  const MeshSource mesh("mesh", Open(DemoFolder() / "scene.obj"));
  int n = 0;
  for (PosedImage& reference : scene_.references) {
    const Eigen::Vector3d near = center + Eigen::Vector3d(0.001 * n++, 0, 0);
    reference.cam_from_world.rotation = scene_.references[0].cam_from_world.rotation;
    reference.cam_from_world.translation = -(reference.cam_from_world.rotation * near);
  }
  Rng rng(1);
  scene_.matches = MatchByMesh(mesh, scene_.references, 0.3, rng);
  scene_.maps = RenderMaps(*Open(DemoFolder() / "scene.obj"), scene_.references, 160);
  const Diagnosis diagnosis = Examine(scene_);
  EXPECT_EQ(diagnosis.verdict, InputVerdict::kTooFewMatches) << Describe(diagnosis);
  EXPECT_NE(diagnosis.reason.find("too close together"), std::string::npos);
}

TEST_F(DemoDoctor, OneWrongMatchPerPairIsNoAgreement) {
  Rng rng(5);
  std::vector<ReferenceMatch> matches;
  const auto count = static_cast<int>(scene_.references.size());
  const Camera& camera = scene_.references[0].camera;
  const auto at_random = [&] {
    return Eigen::Vector2d(rng.Uniform(0, camera.width_px()), rng.Uniform(0, camera.height_px()));
  };
  for (int a = 0; a < count; ++a) {
    for (int b = a + 1; b < count; ++b) matches.push_back({a, b, at_random(), at_random()});
  }
  scene_.matches = matches;
  const Diagnosis diagnosis = Examine(scene_);
  EXPECT_TRUE(diagnosis.verdict == InputVerdict::kTooFewMatches ||
              diagnosis.fault == InputFault::kPoses)
      << Describe(diagnosis);
}

TEST_F(DemoDoctor, WrappedDepthFitsNothing) {
  for (const double modulus : {4.096, 8.192}) {
    const Diagnosis diagnosis = Examine(
        WithDepth(scene_, [&](double z, int) { return std::max(std::fmod(z, modulus), 0.001); }));
    EXPECT_EQ(diagnosis.verdict, InputVerdict::kNothingFits) << Describe(diagnosis);
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
      EXPECT_EQ(diagnosis.verdict, InputVerdict::kNothingFits) << Describe(diagnosis);
      EXPECT_EQ(diagnosis.fault, InputFault::kDisparity) << Describe(diagnosis);
    }
  }
}

TEST_F(DemoDoctor, NoisyDepthIsReadAsMeant) {
  Rng rng(3);
  const Scene noisy =
      WithDepth(scene_, [&](double z, int) { return z * std::exp(0.05 * rng.Normal()); });
  EXPECT_EQ(Examine(noisy).verdict, InputVerdict::kAsMeant);
  const Scene monocular = WithDepth(scene_, [](double z, int n) {
    return z * std::exp(0.15 * std::sin(n) + 0.02 * std::sin(3 * z));
  });
  EXPECT_EQ(Examine(monocular).verdict, InputVerdict::kAsMeant);
}

TEST_F(DemoDoctor, DepthOfAnotherSceneFitsNothing) {
  Rng rng(4);
  const Diagnosis random =
      Examine(WithDepth(scene_, [&](double, int) { return rng.Uniform(2, 20); }));
  EXPECT_EQ(random.verdict, InputVerdict::kNothingFits) << Describe(random);
  EXPECT_TRUE(Summary(random).starts_with("nothing fits: ")) << Summary(random);
  const Diagnosis constant = Examine(WithDepth(scene_, [](double, int) { return 5.0; }));
  EXPECT_EQ(constant.verdict, InputVerdict::kNothingFits) << Describe(constant);
}

TEST_F(DemoDoctor, WrongMatchesAreNotBlamedOnDepth) {
  for (size_t i = 0; i < scene_.matches.size(); ++i) {
    scene_.matches[i].b_px =
        scene_.matches[(i + scene_.matches.size() / 3) % scene_.matches.size()].b_px;
  }
  const Diagnosis diagnosis = Examine(scene_);
  EXPECT_EQ(diagnosis.verdict, InputVerdict::kNothingFits);
  EXPECT_EQ(diagnosis.fault, InputFault::kPoses);
  EXPECT_NE(diagnosis.reason.find("poses and matches do not agree"), std::string::npos);
}

class MovedMesh : public DemoDoctor {
 protected:
  // The verdict on the demo's mesh where what is right is `world_from_mesh`.
  Diagnosis ExamineMoved(const MeshPlacement& world_from_mesh) const {
    return ExamineMesh(scene_,
                       Placed(ReadMesh(DemoFolder() / "scene.obj"), Inverse(world_from_mesh)));
  }

  void ExpectFound(const MeshPlacement& expected) const {
    const Diagnosis diagnosis = ExamineMoved(expected);
    EXPECT_EQ(diagnosis.verdict, InputVerdict::kRepair) << Describe(diagnosis);
    ASSERT_TRUE(diagnosis.mesh_placement.has_value()) << Describe(diagnosis);
    const MeshPlacement& found = *diagnosis.mesh_placement;
    EXPECT_NEAR(found.scale / expected.scale, 1, 0.002) << Describe(found);
    EXPECT_LT((found.axes - expected.axes).norm(), 0.01) << Describe(found);
    EXPECT_LT((found.shift - expected.shift).norm(), 0.02) << Describe(found);
  }
};

TEST_F(MovedMesh, IsAsMeantInItsPlace) {
  EXPECT_EQ(ExamineMoved({}).verdict, InputVerdict::kAsMeant);
}

// Another place, where it would meet more of what is seen, explains what it meets here far worse.
TEST_F(MovedMesh, APartOfTheSceneIsInItsPlace) {
  for (const double most_x : {5.0, 6.0, 7.0}) {
    TriangleMesh part = ReadMesh(DemoFolder() / "scene.obj");
    std::erase_if(part.triangles, [&](const auto& triangle) {
      return std::ranges::any_of(triangle,
                                 [&](uint32_t i) { return part.VertexInWorld(i).x() > most_x; });
    });
    const Diagnosis diagnosis = ExamineMesh(scene_, std::move(part));
    EXPECT_EQ(diagnosis.verdict, InputVerdict::kAsMeant) << Describe(diagnosis);
    EXPECT_EQ(diagnosis.fault, InputFault::kNone) << Describe(diagnosis);
  }
}

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

TEST_F(MovedMesh, RepairStandsInPlaceOfTheKeysAsRead) {
  const std::string mesh = "mesh:" + (DemoFolder() / "scene.obj").string();
  const auto examine = [&](const std::string& spec) {
    const NamedGeometry geometry = MakeGeometrySource(spec);
    return Diagnose(MakeDoctorInput(geometry, scene_.references, scene_.matches,
                                    PoseConvention::kCamFromWorld));
  };
  // The file is right: no key is.
  for (const std::string keys : {"scale=1000", "shift=3/0/0", "axes=x/-z/y"}) {
    const Diagnosis diagnosis = examine(mesh + "," + keys);
    EXPECT_EQ(diagnosis.verdict, InputVerdict::kRepair) << Describe(diagnosis);
    EXPECT_EQ(ToString(diagnosis.repair), "in the geometry: leave out " + keys);
  }
  // What is printed is right when it is read again.
  const fs::path file = TestFolder() / "moved.obj";
  {
    std::ofstream out(file);
    const TriangleMesh moved =
        Placed(ReadMesh(DemoFolder() / "scene.obj"),
               Inverse({.scale = 0.001, .axes = *AxesFromName("x/-z/y"), .shift = {2, 0, 0}}));
    for (uint32_t i = 0; i < moved.vertices.size(); ++i) {
      const Eigen::Vector3d v = moved.VertexInWorld(i);
      out << fmt::format("v {} {} {}\n", v.x(), v.y(), v.z());
    }
    for (const auto& t : moved.triangles) {
      out << fmt::format("f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1);
    }
  }
  for (const std::string keys : {"", ",axes=x/z/-y", ",scale=0.01,shift=0/1/0"}) {
    const Diagnosis diagnosis = examine("mesh:" + file.string() + keys);
    ASSERT_EQ(diagnosis.verdict, InputVerdict::kRepair) << keys << Describe(diagnosis);
    ASSERT_EQ(diagnosis.repair.geometry_keys.size(), 1u) << ToString(diagnosis.repair);
    EXPECT_EQ(diagnosis.repair.replaced_keys.size(), keys.empty() ? 0u : 1u);
    const Diagnosis again =
        examine("mesh:" + file.string() + "," + diagnosis.repair.geometry_keys[0]);
    EXPECT_EQ(again.verdict, InputVerdict::kAsMeant)
        << ToString(diagnosis.repair) << Describe(again);
  }
}

TEST_F(MovedMesh, LimitsThatDropWhatIsSeenAreNoPlacement) {
  const NamedGeometry geometry =
      MakeGeometrySource("mesh:" + (DemoFolder() / "scene.obj").string() + ",near=50");
  const Diagnosis diagnosis = Diagnose(
      MakeDoctorInput(geometry, scene_.references, scene_.matches, PoseConvention::kCamFromWorld));
  EXPECT_EQ(diagnosis.verdict, InputVerdict::kNothingFits) << Describe(diagnosis);
  EXPECT_NE(diagnosis.reason.find("limits"), std::string::npos) << diagnosis.reason;
}

TEST(SymmetricRoom, HasNoRepair) {
  // A box that half a turn about z brings onto itself, shifted, and cameras inside.
  TriangleMesh box;
  const Eigen::Vector3f half(3, 2, 1.25f);
  for (int i = 0; i < 8; ++i) {
    box.vertices.push_back({(i & 1) ? half.x() : -half.x(), (i & 2) ? half.y() : -half.y(),
                            (i & 4) ? half.z() : -half.z()});
  }
  for (const std::array<uint32_t, 4> q : {std::array<uint32_t, 4>{0, 1, 3, 2},
                                          {4, 6, 7, 5},
                                          {0, 4, 5, 1},
                                          {2, 3, 7, 6},
                                          {0, 2, 6, 4},
                                          {1, 5, 7, 3}}) {
    box.triangles.push_back({q[0], q[1], q[2]});
    box.triangles.push_back({q[0], q[2], q[3]});
  }
  const fs::path demo = DemoFolder();
  const Camera camera = LoadReferences(demo / "model").references.images[0].camera;
  Scene scene;
  Rng rng(6);
  for (int i = 0; i < 20; ++i) {
    const Eigen::Vector3d center(rng.Uniform(-1, 1), rng.Uniform(-0.7, 0.7),
                                 rng.Uniform(-0.3, 0.3));
    const double angle = 0.32 * i;
    PosedImage image;
    image.name = fmt::format("{}.jpg", i);
    image.camera = camera;
    Eigen::Matrix3d rotation;
    rotation.row(2) = Eigen::Vector3d(std::cos(angle), std::sin(angle), -0.1).normalized();
    rotation.row(0) = Eigen::Vector3d(std::sin(angle), -std::cos(angle), 0);
    rotation.row(1) = rotation.row(2).cross(rotation.row(0));
    image.cam_from_world.rotation = Eigen::Quaterniond(rotation);
    image.cam_from_world.translation = -(rotation * center);
    scene.references.push_back(image);
  }
  scene.matches = MatchByMesh(MeshSource("mesh", CasterOf(box)), scene.references, 0.5, rng);
  const Diagnosis diagnosis = ExamineMesh(scene, Placed(box, {.shift = {1.5, 0.4, 0}}));
  EXPECT_EQ(diagnosis.verdict, InputVerdict::kNothingFits) << Describe(diagnosis);
  EXPECT_NE(diagnosis.reason.find("fit about as well"), std::string::npos) << diagnosis.reason;
}

TEST_F(DemoDoctor, TrianglesAtRandomAreNotSearched) {
  TriangleMesh mesh;
  Rng rng(7);
  for (uint32_t i = 0; i < 30000; ++i) {
    for (int corner = 0; corner < 3; ++corner) {
      mesh.vertices.push_back({static_cast<float>(rng.Uniform(-9, 9)),
                               static_cast<float>(rng.Uniform(-9, 9)),
                               static_cast<float>(rng.Uniform(-9, 9))});
    }
    mesh.triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
  }
  const Diagnosis diagnosis = ExamineMesh(scene_, std::move(mesh));
  EXPECT_EQ(diagnosis.verdict, InputVerdict::kNothingFits) << Describe(diagnosis);
  EXPECT_NE(diagnosis.reason.find("overlap too much"), std::string::npos) << diagnosis.reason;
}

TEST_F(MovedMesh, NotFoundIsNothingFits) {
  // No similarity.
  TriangleMesh mesh = ReadMesh(DemoFolder() / "scene.obj");
  for (Eigen::Vector3f& v : mesh.vertices) v = {v.x() * 2, v.y() + 0.3f * v.x(), v.z() * 0.6f};
  const Diagnosis diagnosis = ExamineMesh(scene_, std::move(mesh));
  EXPECT_EQ(diagnosis.verdict, InputVerdict::kNothingFits) << Describe(diagnosis);
}

TEST_F(DemoDoctor, ThreadsDoNotChangeTheResult) {
  const Scene wrong = Plant(scene_, {.kind = DepthKind::kRay});
  EXPECT_EQ(Describe(Examine(wrong, {}, {.max_matches = 1000, .threads = 1})),
            Describe(Examine(wrong, {}, {.max_matches = 1000, .threads = 3})));
}

}  // namespace
}  // namespace raylift
