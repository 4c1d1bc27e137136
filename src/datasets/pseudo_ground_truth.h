// The SfM poses of 7-Scenes and 12 Scenes by Brachmann et al. (ICCV 2021, "On the limits of pseudo
// ground truth", folder pgt): SCENE_train.txt and SCENE_test.txt with rows `name qw qx qy qz tx ty
// tz f`, world to camera, f the photograph's focal length. Private to datasets.

#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "datasets/importers.h"

#include "raylift/scene/image.h"

namespace raylift {

class PseudoGroundTruth {
 public:
  // `scene` is the scene's folder: pgt/sfm/7scenes holds chess_train.txt, pgt/sfm/12scenes
  // apt1_kitchen_train.txt for apt1/kitchen.
  PseudoGroundTruth(const std::filesystem::path& pgt, const std::filesystem::path& scene);

  // The pose, and the camera with this focal length and its axis in the middle of the photograph,
  // which was published in one size and is here in that of `fitted`; none where the files lack it.
  std::optional<PosedImage> Find(const std::string& name, const PlaneSize& published,
                                 const Camera& fitted) const;

  const std::filesystem::path& file() const { return file_; }

 private:
  struct Row {
    Rigid3 cam_from_world;
    double focal_px;
  };

  void Read(const std::filesystem::path& file);

  std::filesystem::path file_;  // that of the references
  std::map<std::string, Row> rows_;
};

}  // namespace raylift
