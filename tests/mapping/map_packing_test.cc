// Maps in one file: what is packed is read back, whatever way the map grew.

#include "raylift/mapping/map_packing.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

#include "base/rng.h"
#include "io/map/map_codec.h"
#include "io/map/packed_map.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/io/hloc_files.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

// A wall that a sensor sees in millimeters, with holes.
DepthMap SensorMap(Rng& rng, int width, int height) {
  DepthMap map{width, height, {}};
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const double z = 1.5 + 0.01 * x + 0.004 * y + (x > width / 2 ? 2 : 0) + 0.003 * rng.Normal();
      const bool is_hole = rng.UniformIndex(20) == 0;
      map.z.push_back(is_hole ? 0 : static_cast<float>(std::round(1000 * z) / 1000));
    }
  }
  return map;
}

DepthMap ThroughTheFile(const DepthMap& map) {
  return DecodeDepth("town.raymap", "depth/a", EncodeDepth(map));
}

TEST(MapCodec, DepthIsRightToHalfAStepOfItsLogarithm) {
  Rng rng = TestRng();
  const DepthMap map = SensorMap(rng, 61, 47);
  const auto [least, largest] =
      std::ranges::minmax(map.z, {}, [](float z) { return z > 0 ? z : 2.0f; });
  const double step = std::log(largest / least) / 65534;
  const DepthMap read = ThroughTheFile(map);
  ASSERT_EQ(read.z.size(), map.z.size());
  for (size_t i = 0; i < map.z.size(); ++i) {
    ASSERT_EQ(read.z[i] > 0, map.z[i] > 0);
    if (map.z[i] > 0) {
      // Half a step, and what float rounds off.
      ASSERT_LE(std::abs(std::log(read.z[i] / map.z[i])), 0.5 * step + 2e-7);
    }
  }
}

TEST(MapCodec, AllDepthsAreTakenAsTheyCome) {
  Rng rng = TestRng();
  const float inf = std::numeric_limits<float>::infinity();
  const DepthMap odd{3, 2, {-1, 0, inf, std::nanf(""), 1e-30f, 1e30f}};
  const DepthMap read = ThroughTheFile(odd);
  EXPECT_EQ(std::vector<float>(read.z.begin(), read.z.begin() + 4), std::vector<float>(4, 0));
  EXPECT_FLOAT_EQ(read.z[4], 1e-30f);
  EXPECT_FLOAT_EQ(read.z[5], 1e30f);
  for (const float same : {0.0f, 2.5f}) {
    const DepthMap wall{1000, 900, std::vector<float>(900000, same)};
    EXPECT_EQ(ThroughTheFile(wall).z, wall.z);
  }
  // As many depths as there are codes, in no order.
  DepthMap noise{300, 300, {}};
  for (int i = 0; i < 90000; ++i) noise.z.push_back(std::exp(static_cast<float>(rng.Normal())));
  const DepthMap noise_read = ThroughTheFile(noise);
  for (size_t i = 0; i < noise.z.size(); ++i) {
    ASSERT_NEAR(noise_read.z[i] / noise.z[i], 1, 1e-4);
  }
}

Features RandomFeatures(Rng& rng, int count, bool of_colmap) {
  Features features;
  features.image_width_px = 640;
  features.image_height_px = 480;
  features.uncertainty_px = 1.5f;
  features.descriptors.resize(16, count);
  for (int i = 0; i < count; ++i) {
    features.keypoints_px.emplace_back(rng.Uniform(0, 640), rng.Uniform(0, 480));
    features.scores.push_back(static_cast<float>(rng.Uniform(0, 1)));
  }
  for (float& value : features.descriptors.reshaped()) {
    value = of_colmap ? static_cast<float>(rng.UniformIndex(200)) / 512
                      : static_cast<float>(rng.Normal());
  }
  return AsStored(std::move(features), !of_colmap);
}

Features ThroughTheFile(const Features& features, DescriptorPrecision precision) {
  return DecodeFeatures("town.raymap", "features/a", EncodeFeatures(features, precision));
}

void ExpectEqual(const Features& a, const Features& b) {
  EXPECT_EQ(a.keypoints_px, b.keypoints_px);
  EXPECT_EQ(a.descriptors, b.descriptors);
  EXPECT_EQ(a.scores, b.scores);
  EXPECT_EQ(a.image_width_px, b.image_width_px);
  EXPECT_EQ(a.image_height_px, b.image_height_px);
  EXPECT_EQ(a.uncertainty_px, b.uncertainty_px);
}

TEST(MapCodec, FeaturesAreAsPreciseAsIsSaid) {
  Rng rng = TestRng();
  const Features halves = RandomFeatures(rng, 200, false);
  ExpectEqual(ThroughTheFile(halves, DescriptorPrecision::kExact), halves);
  Features floats = halves;
  floats.descriptors *= 1.0001f;
  ExpectEqual(ThroughTheFile(floats, DescriptorPrecision::kExact), floats);
  // COLMAP's eight bits are eight bits here.
  const Features bytes = RandomFeatures(rng, 200, true);
  ExpectEqual(ThroughTheFile(bytes, DescriptorPrecision::kBytes), bytes);

  const Features rounded = ThroughTheFile(halves, DescriptorPrecision::kBytes);
  EXPECT_EQ(rounded.keypoints_px, halves.keypoints_px);
  const float range = halves.descriptors.maxCoeff() - halves.descriptors.minCoeff();
  EXPECT_LE((rounded.descriptors - halves.descriptors).cwiseAbs().maxCoeff(), 0.501f * range / 255);

  // The least mean squared error of eight uniform levels of a normal distribution is .0375 (Max
  // 1960).
  const Features compact = ThroughTheFile(halves, DescriptorPrecision::kCompact);
  const Eigen::MatrixXf off = compact.descriptors - halves.descriptors;
  EXPECT_NEAR(off.squaredNorm() / static_cast<float>(off.size()), 0.0375, 0.004);
  for (size_t i = 0; i < halves.keypoints_px.size(); ++i) {
    EXPECT_LE((compact.keypoints_px[i] - halves.keypoints_px[i]).cwiseAbs().maxCoeff(),
              0.501 * 640 / 65535);
  }
  Features none;
  none.image_width_px = 640;
  none.image_height_px = 480;
  for (const auto precision : AllValues<DescriptorPrecision>()) {
    ExpectEqual(ThroughTheFile(none, precision), none);
  }
}

class MapPacking : public ::testing::Test {
 protected:
  MapPacking() {
    Rng rng = TestRng();
    const Camera camera =
        Camera(CameraModel::kPinhole, 61, 47, std::vector<double>{50, 51, 30, 24});
    for (const char* name : {"b/2.jpg", "a/1.jpg", "with blank.jpg", "b/1.jpg", "c.jpg"}) {
      images_.push_back({name, camera,
                         Rigid3{Eigen::Quaterniond(Eigen::AngleAxisd(
                                    rng.Normal(), Eigen::Vector3d(1, 2, 3).normalized())),
                                Eigen::Vector3d(rng.Normal(), rng.Normal(), rng.Normal() + 5e6)}});
      depths_[name] = SensorMap(rng, 61, 47);
      features_[name] = RandomFeatures(rng, 300, true);
    }
    depths_.erase("c.jpg");
  }

  ReferencesToPack References(std::span<const PosedImage> images) const {
    return {images,
            [this](const PosedImage& image) {
              const auto found = depths_.find(image.name);
              return found == depths_.end() ? std::nullopt : std::optional(found->second);
            },
            [this](const PosedImage& image) { return features_.at(image.name); }};
  }
  std::string Packed(std::span<const PosedImage> images, int threads = 2) const {
    PackMap(file_, References(images), options_, {.threads = threads});
    return ReadFile(file_);
  }

  std::vector<PosedImage> images_;
  std::map<std::string, DepthMap> depths_;
  std::map<std::string, Features> features_;
  MapOptions options_{.seed = 3,
                      .depth_keys = ",first_sample_px=0",
                      .crs = "EPSG:25832",
                      .calibration = "{\"some\": \"JSON\"}"};
  fs::path file_ = TestFolder() / "town.raymap";
};

TEST_F(MapPacking, WhatIsPackedIsReadBack) {
  Packed(images_);
  EXPECT_TRUE(IsPackedMap(file_));
  const PackedMap map(file_);
  EXPECT_EQ(map.header().depth_keys, options_.depth_keys);
  EXPECT_EQ(map.header().crs, options_.crs);
  EXPECT_EQ(map.header().seed, 3u);
  EXPECT_EQ(map.ReadCalibration(), options_.calibration);
  ASSERT_EQ(map.references().size(), images_.size());
  EXPECT_TRUE(std::ranges::is_sorted(map.references(), {}, &PosedImage::name));
  for (const PosedImage& image : images_) {
    const auto found = std::ranges::find(map.references(), image.name, &PosedImage::name);
    ASSERT_NE(found, map.references().end());
    EXPECT_TRUE(found->camera == image.camera);
    EXPECT_EQ(found->cam_from_world.rotation.coeffs(), image.cam_from_world.rotation.coeffs());
    EXPECT_EQ(found->cam_from_world.translation, image.cam_from_world.translation);
    ExpectEqual(map.ReadFeatures(image.name), features_.at(image.name));
    EXPECT_EQ(map.HasDepth(image.name), depths_.contains(image.name));
  }
  EXPECT_EQ(map.ReadDepth("a/1.jpg").z, ThroughTheFile(depths_.at("a/1.jpg")).z);
  const auto retrieval = map.ReadRetrieval();
  ASSERT_TRUE(retrieval.has_value());
  EXPECT_EQ(retrieval->vectors.cols(), 5);
  EXPECT_EQ(retrieval->vectors.rows(), retrieval->words.size());
}

TEST_F(MapPacking, APhotographWithoutFeaturesIsLikeNone) {
  Features& none = features_.at("b/1.jpg");
  none.keypoints_px.clear();
  none.scores.clear();
  none.descriptors.resize(0, 0);
  Packed(images_);
  const auto retrieval = PackedMap(file_).ReadRetrieval();
  ASSERT_TRUE(retrieval.has_value());
  for (int i = 0; i < 5; ++i) {
    EXPECT_NEAR(retrieval->vectors.col(i).norm(), i == 1 ? 0 : 1, 1e-5) << i;  // sorted by name
  }
}

TEST_F(MapPacking, AMapThatGrewOrShrankIsTheOneThatWasMadeAtOnce) {
  const std::string whole = Packed(images_, 1);
  const std::string three = Packed(std::span(images_).first(3), 4);
  EXPECT_EQ(AddToMap(file_, References(images_)), 2u);
  EXPECT_EQ(ReadFile(file_), whole);
  EXPECT_EQ(AddToMap(file_, References(images_)), 0u);
  EXPECT_EQ(ReadFile(file_), whole);
  RemoveFromMap(file_, std::vector<std::string>{"c.jpg", "b/1.jpg"});
  EXPECT_EQ(ReadFile(file_), three);
}

TEST_F(MapPacking, WhoReadsTheFormerMapGoesOnReadingIt) {
  Packed(images_);
  const PackedMap former(file_);
  RemoveFromMap(file_, std::vector<std::string>{"b/1.jpg"});
  ExpectEqual(former.ReadFeatures("b/1.jpg"), features_.at("b/1.jpg"));
}

template <typename Work>
std::string ErrorOf(const Work& work) {
  try {
    work();
  } catch (const InputError& error) {
    return error.what();
  }
  return {};
}

TEST_F(MapPacking, WhatCannotBeIsNamed) {
  const std::string packed = Packed(images_);
  const auto remove = [&](std::vector<std::string> names) {
    return ErrorOf([&] { RemoveFromMap(file_, names); });
  };
  EXPECT_NE(remove({"c.jpg", "no.jpg"}).find("has no reference \"no.jpg\""), std::string::npos);
  EXPECT_NE(remove({"b/2.jpg", "a/1.jpg", "with blank.jpg", "b/1.jpg", "c.jpg"})
                .find("no reference would be left"),
            std::string::npos);
  EXPECT_EQ(ReadFile(file_), packed);
  images_.push_back(images_.front());
  EXPECT_NE(ErrorOf([&] { Packed(images_); }).find("\"b/2.jpg\" stands twice"), std::string::npos);
  EXPECT_EQ(ReadFile(file_), packed);
  EXPECT_NE(ErrorOf([&] { PackedMap(TestFolder() / "none"); }), "");
  EXPECT_FALSE(IsPackedMap(TestFolder()));
}

TEST_F(MapPacking, ADamagedMapIsAnError) {
  const std::string packed = Packed(std::span(images_).first(2));
  const auto read_all = [&] {
    const PackedMap map(file_);
    for (const PosedImage& image : map.references()) {
      map.ReadFeatures(image.name);
      if (map.HasDepth(image.name)) map.ReadDepth(image.name);
    }
    map.ReadRetrieval();
    map.ReadCalibration();
  };
  for (size_t size = 0; size < packed.size(); size += packed.size() / 50) {
    WriteFile(file_, packed.substr(0, size));
    EXPECT_NE(ErrorOf(read_all), "") << size;
  }
  Rng rng = TestRng();
  for (int i = 0; i < 200; ++i) {
    std::string damaged = packed;
    damaged[rng.UniformIndex(packed.size())] ^= static_cast<char>(1 + rng.UniformIndex(255));
    WriteFile(file_, damaged);
    ErrorOf(read_all);  // of a name's letter nobody can tell: it must only end
  }
}

TEST(MapCodec, BytesThatAreNoEntriesAreErrors) {
  Rng rng = TestRng();
  const std::string depth = EncodeDepth(SensorMap(rng, 61, 47));
  const std::string features =
      EncodeFeatures(RandomFeatures(rng, 50, true), DescriptorPrecision::kBytes);
  int errors = 0;
  for (int i = 0; i < 400; ++i) {
    std::string bytes = i % 2 == 0 ? depth : features;
    bytes[rng.UniformIndex(i % 4 < 2 ? 40 : bytes.size())] ^=
        static_cast<char>(1 + rng.UniformIndex(255));
    if (i % 3 == 0) bytes.resize(rng.UniformIndex(bytes.size()));
    errors += ErrorOf([&] {
                if (i % 2 == 0) {
                  DecodeDepth("town.raymap", "depth/a", bytes);
                } else {
                  DecodeFeatures("town.raymap", "features/a", bytes);
                }
              }) == ""
                  ? 0
                  : 1;
  }
  EXPECT_GT(errors, 200);
}

}  // namespace
}  // namespace raylift
