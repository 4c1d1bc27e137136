// hloc's files, and those of other matchers.

#include <array>

#include "fuzz/fuzz_targets.h"
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

std::vector<std::string> FeatureSeeds() {
  Features features;
  features.image_width_px = 64;
  features.image_height_px = 48;
  features.keypoints_px = {{1.5, 2.5}, {3, 4}};
  features.descriptors = Eigen::MatrixXf::Constant(4, 2, 0.5f);
  features.scores = {0.5f, 1};
  const auto file = ScratchFolder() / "seed.h5";
  WriteFeatureFile(file, {{"a/b.jpg", features}}, true);
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

}  // namespace

std::vector<FuzzTarget> FeatureFuzzTargets() {
  return {
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
