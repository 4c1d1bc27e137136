// Fingerprints of what a scene and its queries are read from, for the headers of jobs.

#pragma once

#include <filesystem>
#include <span>
#include <string>

#include "matching_options.h"
#include <nlohmann/json.hpp>

#include "raylift/localization/scene.h"
#include "raylift/scene/photographs.h"

namespace raylift {

struct SceneInputs {
  std::filesystem::path model;  // empty: the references are rendered
  std::filesystem::path images, query_images;
  std::filesystem::path out;  // what is below it is no input
  const MatchingFlags& matching;
  int threads = 0;
};

nlohmann::ordered_json InputsJson(const SceneInputs& inputs, const Scene& scene,
                                  std::span<const Query> queries);

// Of a file, or of a folder that holds a COLMAP model.
std::string FileOrModelFingerprint(const std::filesystem::path& file);

}  // namespace raylift
