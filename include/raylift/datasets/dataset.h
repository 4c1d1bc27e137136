// Imports the field's data sets, each in the layout in which it is published, as scenes. All of
// their conventions (camera to world, camera centers, quaternions with w last, OpenGL's axes) are
// converted here, once. Photographs and depth maps stay where they are.

#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "raylift/base/enum_names.h"
#include "raylift/geometry/camera.h"
#include "raylift/io/query_list.h"
#include "raylift/io/scene_file.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// The poses of the photographs of 7-Scenes, which are published for the depth camera.
enum class SensorCalibration {
  kColor,  // moved to the color camera
  kRaw,    // as published, as if both cameras stood in one place
};
template <>
inline constexpr auto kEnumNames<SensorCalibration> = std::to_array<EnumName<SensorCalibration>>({
    {SensorCalibration::kColor, "color"},
    {SensorCalibration::kRaw, "raw"},
});

struct ImportOptions {
  // Every N-th frame is a query, the N-th first, in data sets that have no queries of their own.
  int query_every = 8;
  // The part of Gangnam Station whose photographs are the queries.
  std::string split = "validation";
  SensorCalibration calibration = SensorCalibration::kColor;
  // A folder of SCENE_train.txt and SCENE_test.txt with poses and focal lengths for 7-Scenes or 12
  // Scenes (Brachmann et al., ICCV 2021), which replace those of the data set.
  std::filesystem::path pseudo_ground_truth = {};
  // Replaces the data set's intrinsics, for all images.
  std::optional<Camera> camera = std::nullopt;
};

struct ImportedScene {
  std::string name;
  std::filesystem::path folder;  // of its files, below the output folder; empty: that itself
  // References are either images with poses or a COLMAP model that is used where it is.
  std::vector<PosedImage> references;
  std::filesystem::path reference_model;
  std::filesystem::path images;
  std::vector<Query> queries;
  std::filesystem::path query_images;
  std::vector<NamedPose> ground_truth;        // of queries, where it is public
  std::map<std::string, double> times;        // seconds, of references and queries
  std::map<std::string, std::string> groups;  // of queries
  std::string thresholds;                     // as --thresholds takes them
  std::vector<SceneGeometry> geometries;
  std::vector<std::string> warnings;  // what was skipped, what does not agree
  std::vector<std::string> notes;     // what holds for every copy of the data set
};

struct Dataset {
  std::string_view name;    // as the command takes it
  std::string_view title;   // "7-Scenes"
  std::string_view layout;  // what its folder must hold
  std::vector<ImportedScene> (*import)(const std::filesystem::path& folder,
                                       const ImportOptions& options);
};

// Returns all data sets that can be imported.
std::span<const Dataset> AllDatasets();
std::string DatasetNames();  // "7scenes|12scenes|..."

// Returns the scenes in a folder of the data set of this name: one, except for Extended CMU
// Seasons, where a folder of several slices is one scene each. Throws OptionError for an unknown
// name, InputError naming file and field where the folder does not have the layout, or where no
// image is left.
std::vector<ImportedScene> ImportDataset(std::string_view name, const std::filesystem::path& folder,
                                         const ImportOptions& options = {});

// Returns the frames of a transforms.json of nerfstudio or instant-ngp, by name, in the world that
// the images were in before nerfstudio moved them. Of photographs only the sizes are read, and only
// where the file has none. Appends to `warnings` what was left out and what was assumed. Throws
// InputError naming file and field.
std::vector<PosedImage> ReadTransforms(const std::filesystem::path& file,
                                       std::vector<std::string>& warnings);

// Writes scene.toml, the query list and, where there are any, references, ground truth (COLMAP
// models, binary), times and groups into `folder`. Returns the scene file.
std::filesystem::path WriteImportedScene(const std::filesystem::path& folder,
                                         const ImportedScene& scene, std::string_view dataset);

}  // namespace raylift
