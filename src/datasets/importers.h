// Declares one importer per data set, and what they share.

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

// Returns a scene that is named after its folder.
ImportedScene SceneOfFolder(const std::filesystem::path& folder);

// Counts what cannot be used, by reason.
class Skipped {
 public:
  void Add(const std::string& reason, const std::string& name);
  // Returns whether the photograph is there, and counts it where it is missing.
  bool HasPhotograph(const std::filesystem::path& folder, const std::string& name);
  // Adds "3 frames are skipped: REASON (first: NAME)", one for each reason.
  void AddWarnings(std::vector<std::string>& warnings) const;

 private:
  struct Entry {
    size_t count = 0;
    std::string first;
  };
  std::map<std::string, Entry> entries_;
};

// Adds a query with its true pose.
void AddQuery(const PosedImage& image, ImportedScene& scene);

// Notes how many queries have poses, where not all have.
void NotePublicPoses(ImportedScene& scene);

// Makes every N-th frame a query, the others references. Throws InputError in the name of `source`
// where that leaves none of either, with the scene's warnings: they say what was skipped.
void SplitFrames(const std::vector<PosedImage>& frames, int query_every,
                 const std::filesystem::path& source, ImportedScene& scene);

// Throws InputError in the name of the folder where there are no references or no queries.
void RequireImages(const std::filesystem::path& folder, const ImportedScene& scene);

// The camera of all frames of a data set.
class SharedCamera {
 public:
  // Takes the given camera, if there is one.
  explicit SharedCamera(const ImportOptions& options);
  // Returns the camera; where none was given, it is made for the first photograph that asks.
  const Camera& Get(const std::function<Camera()>& make);

 private:
  bool known_;
  Camera camera_;
};

// Returns the camera scaled to the photograph's size, as for folders of resized pictures.
Camera FitToPhotograph(const Camera& camera, const std::filesystem::path& photograph);

// Returns the rigid motion of a 4x4 matrix with its last row 0 0 0 1; nullopt where it is not one.
// Its rotation is orthogonal only within the rounding of text files, and is made so.
std::optional<Rigid3> RigidFromMatrix(const Eigen::Matrix4d& matrix);

// Returns the pose with this rotation, world to camera and of any length, and this camera center.
Rigid3 PoseByCenter(const Eigen::Vector4d& qvec_wxyz, const Eigen::Vector3d& center_in_world);

// Reads a text file of a 4x4 matrix, a row per line, of a camera in the world. nullopt where a
// number is infinite or NaN, as in frames that were not tracked. Throws InputError for anything
// else.
std::optional<Rigid3> ReadWorldFromCam(const std::filesystem::path& file);

// Reads the same matrix as it is, all numbers finite.
Eigen::Matrix4d ReadMatrix(const std::filesystem::path& file);

// Returns the file names in a folder that end in `suffix`, by the number in front of it if that is
// one, else by name. Throws InputError where the folder is missing.
std::vector<std::string> ListFiles(const std::filesystem::path& folder, const std::string& suffix);

// Reads the color camera. Throws InputError naming file and key for anything else.
Camera ReadColorCamera(const std::filesystem::path& info);

// Reads the sensors, records and trajectories of a kapture data set (format 1.x): CSV files below
// `sensors`; and those of a capture (github.com/microsoft/lamar-benchmark, CAPTURE.md), which have
// other names, no header, and all poses the other way round.

struct KaptureImage {
  std::string name;  // below sensors/records_data
  uint64_t timestamp = 0;
  std::optional<Camera> camera;          // nullopt: its model is unknown
  std::optional<Rigid3> cam_from_world;  // nullopt: not in the trajectories, or only a part of it
};

// Returns all records of cameras, by name. Poses of rigs are composed with the sensors' places in
// them. `folder` holds the folder `sensors`. Throws InputError naming file and line for anything
// else.
std::vector<KaptureImage> ReadKapture(const std::filesystem::path& folder);

// Returns the same of a session of a capture, whose names are below `session`/raw_data. With
// `keys`, a file of lines "timestamp, sensor or rig", returns those images alone.
std::vector<KaptureImage> ReadCaptureSession(const std::filesystem::path& session,
                                             const std::filesystem::path& keys = {});

// Returns when images were taken, by name, in seconds.
std::map<std::string, double> TimesOf(std::span<const KaptureImage> images);

// Returns the camera of a frame of transforms.json, `root` being the whole file.
// `size_of_photograph` is asked where neither says the size. Throws InputError naming frame and
// member where it cannot be one of COLMAP's.
Camera CameraOfTransforms(const JsonPlace& frame, const JsonPlace& root,
                          const std::function<PlaneSize()>& size_of_photograph);

}  // namespace raylift
