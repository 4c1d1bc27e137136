// hloc's files, those of other matchers, and packed maps.

#include <array>

#include "fuzz/fuzz_targets.h"
#include "io/map/map_codec.h"
#include "io/map/packed_map.h"
#include "io/scene/pair_pixels.h"
#include "support/match_file.h"

#include "raylift/io/depth_file.h"
#include "raylift/io/hloc_files.h"

namespace raylift {
namespace {

void ReadFeatures(std::string_view bytes) {
  const FeatureFile file(PutFile("features.h5", bytes));
  for (const std::string& name : file.ImageNames()) file.Read(name);
}

Features TwoFeatures() {
  Features features;
  features.image_width_px = 64;
  features.image_height_px = 48;
  features.keypoints_px = {{1.5, 2.5}, {3, 4}};
  features.descriptors = Eigen::MatrixXf::Constant(4, 2, 0.5f);
  features.scores = {0.5f, 1};
  return features;
}

std::vector<std::string> FeatureSeeds() {
  const auto file = ScratchFolder() / "seed.h5";
  WriteFeatureFile(file, {{"a/b.jpg", TwoFeatures()}}, true);
  return {TakeFile(file)};
}

void ReadGlobal(std::string_view bytes) {
  const GlobalFeatureFile file(PutFile("global.h5", bytes));
  file.Read(file.ImageNames());
}

std::vector<std::string> GlobalSeeds() {
  const std::vector<std::string> names = {"a.jpg", "b.jpg"};
  const auto file = ScratchFolder() / "seed.h5";
  WriteGlobalDescriptors(file, names, Eigen::MatrixXf::Ones(4, 2));
  return {TakeFile(file)};
}

void ReadMatchesOfHloc(std::string_view bytes) {
  MatchFile(PutFile("matches.h5", bytes)).Read("a.jpg", "b.jpg");
}

std::vector<std::string> MatchSeeds() {
  const std::vector<MatchedPair> pairs = {{"a.jpg", "b.jpg", 3, {{0, 1, 0.5f}, {2, 0, 1}}}};
  const auto file = ScratchFolder() / "seed.h5";
  WriteMatchFile(file, pairs);
  return {TakeFile(file)};
}

// Two matches. A map of four columns is such an array.
std::string PairSeed(const std::string& name) {
  const std::array<float, 8> values = {1, 2, 3, 4, 5, 6, 7, 8};
  const auto file = ScratchFolder() / name;
  WriteDepthFile(file, FloatPlane(4, 2, values), {.layer = name.ends_with("z") ? "matches" : ""});
  return TakeFile(file);
}

std::string DepthSeed() { return EncodeDepth({3, 2, {0, 1, 2, 2, 1.5f, 4}}); }

std::vector<std::string> FeatureEntrySeeds() {
  std::vector<std::string> seeds;
  for (const auto precision : AllValues<DescriptorPrecision>()) {
    seeds.push_back(EncodeFeatures(TwoFeatures(), precision));
  }
  return seeds;
}

void ReadMap(std::string_view bytes) {
  const PackedMap map(PutFile("scene.raymap", bytes));
  for (const PosedImage& image : map.references()) {
    if (map.HasDepth(image.name)) map.ReadDepth(image.name);
    if (map.HasFeatures(image.name)) map.ReadFeatures(image.name);
  }
  map.ReadRetrieval();
  map.ReadCalibration();
}

std::vector<std::string> MapSeeds() {
  const auto file = ScratchFolder() / "seed.raymap";
  const Camera camera(CameraModel::kPinhole, 64, 48, std::vector<double>{50, 50, 32, 24});
  WritePackedMap(file, {.header = {},
                        .references = {{"a.jpg", camera, {}}},
                        .has_depth = {true},
                        .has_features = {true},
                        .depth = [](size_t) { return DepthSeed(); },
                        .features = [](size_t) { return FeatureEntrySeeds().front(); },
                        .retrieval = PackedRetrieval{Eigen::MatrixXf::Ones(2, 2),
                                                     Eigen::MatrixXf::Ones(4, 1)}});
  return {TakeFile(file)};
}

}  // namespace

std::vector<FuzzTarget> FeatureFuzzTargets() {
  return {
      {"packed_map", ReadMap, MapSeeds,
       "PK map.json references.txt retrieval depth/ features/ format descriptors seed rootsift"},
      {"map_depth", [](std::string_view bytes) { DecodeDepth("map", "depth", bytes); },
       [] { return std::vector<std::string>{DepthSeed()}; }, "RIFF WEBPVP8L"},
      {"map_features", [](std::string_view bytes) { DecodeFeatures("map", "features", bytes); },
       FeatureEntrySeeds},
      {"hloc_features", ReadFeatures, FeatureSeeds, "keypoints scores descriptors image_size"},
      {"hloc_global", ReadGlobal, GlobalSeeds, "global_descriptor"},
      {"hloc_matches", ReadMatchesOfHloc, MatchSeeds, "matches0 matching_scores0"},
      {"pair_pixels_npy",
       [](std::string_view bytes) { ReadPairPixels(PutFile("pair.npy", bytes)); },
       [] { return std::vector<std::string>{PairSeed("seed.npy")}; },
       "NUMPY {'descr': '<f2' '>f8' '|O' 'fortran_order': True, 'shape': (2, 4), (1, (0, 4) } "
       "18446744073709551615"},
      {"pair_pixels_npz",
       [](std::string_view bytes) { ReadPairPixels(PutFile("pair.npz", bytes)); },
       [] { return std::vector<std::string>{PairSeed("seed.npz")}; },
       "PK matches.npy mkpts0.npy keypoints0.npy"},
  };
}

}  // namespace raylift
