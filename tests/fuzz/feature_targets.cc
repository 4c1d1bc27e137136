// hloc's files.

#include "fuzz/fuzz_targets.h"

#include "raylift/io/hloc_features.h"
#include "raylift/io/hloc_global_features.h"
#include "raylift/io/hloc_matches.h"

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

void ReadGlobal(std::string_view bytes) { ReadGlobalDescriptors(PutFile("global.h5", bytes)); }

std::vector<std::string> GlobalSeeds() {
  GlobalDescriptors global;
  global.names = {"a.jpg", "b.jpg"};
  global.descriptors.setOnes(2, 4);
  const auto file = ScratchFolder() / "seed.h5";
  WriteGlobalDescriptors(file, global);
  return {TakeFile(file)};
}

void ReadMatchesOfHloc(std::string_view bytes) {
  MatchFile(PutFile("matches.h5", bytes)).Read("a.jpg", "b.jpg");
}

std::vector<std::string> MatchSeeds() {
  const std::vector<PairMatches> pairs = {{"a.jpg", "b.jpg", 3, {{0, 1, 0.5f}, {2, 0, 1}}}};
  const auto file = ScratchFolder() / "seed.h5";
  WriteMatchFile(file, pairs);
  return {TakeFile(file)};
}

}  // namespace

std::vector<FuzzTarget> FeatureFuzzTargets() {
  return {
      {"hloc_features", ReadFeatures, FeatureSeeds, "keypoints scores descriptors image_size"},
      {"hloc_global", ReadGlobal, GlobalSeeds, "global_descriptor"},
      {"hloc_matches", ReadMatchesOfHloc, MatchSeeds, "matches0 matching_scores0"},
  };
}

}  // namespace raylift
