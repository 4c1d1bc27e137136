// The file of an experiment (TOML):
//
//   title = "The demo"
//   seeds = [0, 1, 2]
//   offsets = "all"                   # from each of the first N references every N-th, pooled
//
//   [scenes.demo]
//   scene = "demo/scene.toml"         # a scene file, and what it does not hold or shall not hold:
//   model = "demo/model"              # as the options of `raylift localize`: images, queries,
//   queries = "demo/queries.txt"      # query_images, features, matches, pairs, top_k, ...
//   ground_truth = "demo/truth"       # without: poses are written for a benchmark's server
//   thresholds = "0.1,1:0.25,2"
//   group = "night"                   # only the queries of this group
//   continuous = true                 # localized queries join the references
//   [scenes.demo.geometry]
//   mesh = "mesh:demo/scene.obj"
//   noisy = { spec = "mesh:demo/scene.obj", scale_sigma = 0.05 }   # as `raylift perturb`
//   both = { spec = ["sfm", "mesh:demo/scene.obj"], mode = "all", candidates = "merge" }
//
//   [filters."2 px"]
//   reprojection_px = 2
//
//   [[grid]]                          # all combinations; several blocks are joined
//   every = [1, 2, 5]
//   method = ["p3p", "e5p1", "adaptive", "oracle"]
//   score = ["sum_inl", "sum_msac"]
//
//   [[table]]
//   name = "methods"
//   rows = ["method", "score"]
//   columns = ["scene", "every"]
//
//   [[claim]]
//   text = "P3P wins where references are dense"
//   where = { every = 1 }
//   first = { method = "p3p" }
//   second = { method = "e5p1" }
//
// Paths are relative to the file; ${NAME} in any text stands for a variable.

#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "raylift/experiment/experiment.h"

namespace raylift {

using VariableLookup = std::function<std::optional<std::string>(const std::string& name)>;

// A scene file that is not there is only noted (ExperimentScene::file_is_missing), so that a file
// can be looked at without its data. InputError with the file and the key for what is missing,
// unknown, of the wrong kind or out of range.
Experiment ReadExperiment(const std::filesystem::path& file, const VariableLookup& variables);

}  // namespace raylift
