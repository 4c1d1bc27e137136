// One importer per data set, and what they share.

#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "raylift/base/text.h"
#include "raylift/datasets/dataset.h"
#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/scene/image.h"

namespace raylift {

class JsonPlace;

using ImportedScenes = std::vector<ImportedScene>;

ImportedScenes Import7Scenes(const std::filesystem::path& folder, const ImportOptions& options);
ImportedScenes Import12Scenes(const std::filesystem::path& folder, const ImportOptions& options);
ImportedScenes ImportCambridge(const std::filesystem::path& folder, const ImportOptions& options);
ImportedScenes ImportAachen(const std::filesystem::path& folder, const ImportOptions& options);
ImportedScenes ImportCmu(const std::filesystem::path& folder, const ImportOptions& options);
ImportedScenes ImportGangnam(const std::filesystem::path& folder, const ImportOptions& options);
ImportedScenes ImportNerfstudio(const std::filesystem::path& folder, const ImportOptions& options);
ImportedScenes ImportTum(const std::filesystem::path& folder, const ImportOptions& options);
ImportedScenes ImportScanNet(const std::filesystem::path& folder, const ImportOptions& options);
ImportedScenes ImportScanNetPp(const std::filesystem::path& folder, const ImportOptions& options);
ImportedScenes ImportEth3d(const std::filesystem::path& folder, const ImportOptions& options);
ImportedScenes ImportLamar(const std::filesystem::path& folder, const ImportOptions& options);

// A scene named after its folder.
ImportedScene SceneOfFolder(const std::filesystem::path& folder);

// Counts what cannot be used, by reason.
class Skipped {
 public:
  void Add(const std::string& reason, const std::string& name);
  // Returns whether the photograph is there, and counts it where it is missing.
  bool HasPhotograph(const std::filesystem::path& folder, const std::string& name);
  // "3 frames are skipped: REASON (first: NAME)", by reason.
  void AddWarnings(std::vector<std::string>& warnings) const;

 private:
  struct Entry {
    size_t count = 0;
    std::string first;
  };
  std::map<std::string, Entry> entries_;
};

// A query with its true pose.
void AddQuery(const PosedImage& image, ImportedScene& scene);

// Notes how many queries have poses, where not all have.
void NotePublicPoses(ImportedScene& scene);

// Every N-th frame becomes a query, the others references. InputError in the name of `source` where
// that leaves none of either, with the scene's warnings: they say what was skipped.
void SplitFrames(const std::vector<PosedImage>& frames, int query_every,
                 const std::filesystem::path& source, ImportedScene& scene);

// InputError in the name of the folder where there are no references or no queries.
void RequireImages(const std::filesystem::path& folder, const ImportedScene& scene);

// The camera of all frames of a data set.
class SharedCamera {
 public:
  // The given one, if there is one.
  explicit SharedCamera(const ImportOptions& options);
  // Else made for the first photograph that asks.
  const Camera& Get(const std::function<Camera()>& make);

 private:
  bool known_;
  Camera camera_;
};

// The camera scaled to the photograph's size, as for folders of resized pictures.
Camera FitToPhotograph(const Camera& camera, const std::filesystem::path& photograph);

// The rigid motion of a 4x4 matrix with its last row 0 0 0 1. None where it is not one: its
// rotation is orthogonal only within the rounding of text files, and is made so.
std::optional<Rigid3> RigidFromMatrix(const Eigen::Matrix4d& matrix);

// A pose that is given by its rotation, world to camera and of any length, and the camera's center.
Rigid3 PoseByCenter(const Eigen::Vector4d& qvec_wxyz, const Eigen::Vector3d& center_in_world);

// A text file of a 4x4 matrix, a row per line, of a camera in the world. None where a number is
// infinite or not one, as in frames that were not tracked. Throws InputError for anything else.
std::optional<Rigid3> ReadWorldFromCam(const std::filesystem::path& file);

// The same matrix as it is, all numbers finite.
Eigen::Matrix4d ReadMatrix(const std::filesystem::path& file);

// The file names in a folder that end in `suffix`, by the number in front of it if that is one,
// else by name. Throws InputError where the folder is missing.
std::vector<std::string> ListFiles(const std::filesystem::path& folder, const std::string& suffix);

// The color camera. Throws InputError naming file and key for anything else.
Camera ReadColorCamera(const std::filesystem::path& info);

// The sensors, records and trajectories of a kapture data set (format 1.x): CSV files below
// `sensors`; and those of a capture (github.com/microsoft/lamar-benchmark, CAPTURE.md), which have
// other names, no header, and all poses the other way round.

struct KaptureImage {
  std::string name;  // below sensors/records_data
  uint64_t timestamp = 0;
  std::optional<Camera> camera;          // none: its model is unknown
  std::optional<Rigid3> cam_from_world;  // none: not in the trajectories, or only a part of it
};

// All records of cameras, by name. Poses of rigs are composed with the sensors' places in them.
// `folder` holds the folder `sensors`. Throws InputError naming file and line for anything else.
std::vector<KaptureImage> ReadKapture(const std::filesystem::path& folder);

// The same of a session of a capture, whose names are below `session`/raw_data. With a file of
// lines "timestamp, sensor or rig" those images alone.
std::vector<KaptureImage> ReadCaptureSession(const std::filesystem::path& session,
                                             const std::filesystem::path& keys = {});

// Returns when images were taken, by name, in seconds.
std::map<std::string, double> TimesOf(std::span<const KaptureImage> images);

// The camera of a frame of transforms.json, `root` being the whole file. `size_of_photograph` is
// asked where neither says it. Throws InputError naming frame and member where it cannot be one of
// COLMAP's.
Camera CameraOfTransforms(const JsonPlace& frame, const JsonPlace& root,
                          const std::function<PlaneSize()>& size_of_photograph);

}  // namespace raylift
