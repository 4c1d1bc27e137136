// Experiments from texts, for tests.

#pragma once

#include <filesystem>
#include <string>

#include "support/test_data.h"

#include "raylift/base/file.h"
#include "raylift/experiment/experiment.h"

namespace raylift {

// A scene "room" with two geometries and a scene "hall" without any; nothing of it exists.
inline const std::string kTwoScenes = R"(
[scenes.room]
title = "The room"
model = "room/model"
images = "room/images"
queries = "room/queries.txt"
ground_truth = "room/truth"
thresholds = "0.1,1:0.5,5"
[scenes.room.geometry]
mesh = "mesh:room/room.ply,back_faces=drop"
noisy = { spec = "mesh:room/room.ply", title = "noisy depth", scale_sigma = 0.1 }
[scenes.hall]
model = "hall/model"
images = "hall/images"
queries = "hall/queries.txt"
thresholds = "7scenes"
)";

// Written to `folder`, by default one that is empty.
inline Experiment ReadText(const std::string& text,
                           const std::filesystem::path& folder = TestFolder()) {
  const auto file = folder / "experiment.toml";
  WriteFile(file, text);
  return ReadExperiment(file, [](const std::string& name) {
    return name == "KNOWN" ? std::optional<std::string>("/known") : std::nullopt;
  });
}

// A setting of kTwoScenes' room, without geometry where it is empty.
inline Setting RoomSetting(size_t every, const std::string& geometry, const AxisValue& method,
                           const AxisValue& score = {}) {
  Setting setting;
  setting[Axis::kScene] = "room";
  setting[Axis::kEvery] = every;
  if (!geometry.empty()) {
    setting[Axis::kGeometry] = geometry;
    setting[Axis::kAlign] = AlignMode::kOff;
    setting[Axis::kFilter] = "off";
  }
  setting[Axis::kMethod] = method;
  setting[Axis::kScore] = score;
  if (Matters(score)) setting[Axis::kLo] = LocalOptimization::kHybrid;
  return setting;
}

}  // namespace raylift
