// The scene file: the paths of a scene's references, queries, times, groups, ground truth and
// geometry, and the thresholds for its results. It gives commands what their options do not say.
// TOML:
//
//   format = "raylift-scene/1"
//   name = "chess"
//   references = "references"        # COLMAP model
//   images = "../7scenes/chess"      # folder of the references' photographs
//   queries = "queries.txt"          # name MODEL width height params...
//   query_images = "../7scenes/chess"
//   ground_truth = "ground_truth"    # COLMAP model or pose file of the queries, where public
//   times = "times.txt"              # name seconds, of references and queries
//   groups = "groups.txt"            # name group, of queries
//   priors = "priors.txt"            # known of the queries' poses (io/query_list.h)
//   thresholds = "7scenes"           # as --thresholds takes them
//   crs = "EPSG:25832@460000,5420000,0"  # what the world's coordinates are, as --crs takes it
//   [[geometry]]                     # the first is the default
//   name = "sensor"
//   spec = "depth:../7scenes/chess,preset=7scenes"
//   [provenance]                     # any strings
//   dataset = "7scenes"
//
// Only `format` is required. Paths are relative to the file. A packed map (mapping/map_packing.h)
// is a scene file, too: of its references and their depth.

#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace raylift {

struct SceneGeometry {
  std::string name;
  std::string spec;  // as --geometry takes it
};

// The contents of a scene file; fields are empty where the file does not say them. In memory, paths
// (also those within `spec`) are relative to the working directory, not to the file.
struct SceneFile {
  std::string name;
  std::filesystem::path references;
  std::filesystem::path images;
  std::filesystem::path queries;
  std::filesystem::path query_images;
  std::filesystem::path ground_truth;
  std::filesystem::path times;
  std::filesystem::path groups;
  std::filesystem::path priors;
  std::string thresholds;
  std::string crs;
  std::vector<SceneGeometry> geometries;                        // in the file's order
  std::vector<std::pair<std::string, std::string>> provenance;  // by key
};

// Reads a scene file. Throws InputError with the line for anything else than the above, also for a
// geometry's name that stands twice. Does not check that the files are there; their readers do.
SceneFile ReadSceneFile(const std::filesystem::path& file);

// Writes a scene file with paths relative to `file`, so that a scene can be moved with its files.
void WriteSceneFile(const std::filesystem::path& file, const SceneFile& scene);

// Reads lines `name seconds`: when images were taken, from any origin. `#` comments and empty lines
// are skipped. Throws InputError for anything else, and for a name that stands twice.
std::map<std::string, double> ReadTimes(const std::filesystem::path& file);
void WriteTimes(const std::filesystem::path& file, const std::map<std::string, double>& times);

// Reads and writes lines `name group`, such as day or night, likewise.
std::map<std::string, std::string> ReadGroups(const std::filesystem::path& file);
void WriteGroups(const std::filesystem::path& file,
                 const std::map<std::string, std::string>& groups);

// Returns the specification with `move` applied to each path: those after the kind, and those of
// keys that name a file (an orthophoto, a list of names, a transform). Keys that hold patterns
// within a folder or no paths, and other forms, stay as they are.
std::string MapSpecPaths(
    const std::string& spec,
    const std::function<std::filesystem::path(const std::filesystem::path&)>& move);

}  // namespace raylift
