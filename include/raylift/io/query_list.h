// Reads and writes the field's plain text files: lists of query photographs with intrinsics, of
// poses, of views and of points; and tells which photographs one rig has taken.

#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/scene/image.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// Reads lines `name MODEL width height params...`; `#` comments and empty lines are skipped. A name
// may hold blanks, and stands in quotes where it looks like something else. The file name may hold
// `*` and `?` (several lists, in the order of their names). Names that stand twice and lists of no
// photograph are errors. A camera's line may end in `focal_sigma S`, the standard deviation of its
// focal length as a share of it.
//
// Where the folder of the photographs is given, a line may be a name alone: then the camera is a
// pinhole with the principal point in the middle and a focal length of 1.2 times the longer side,
// as COLMAP has it, which the query's priors say to be known up to a factor of two; or the one that
// EXIF says in millimeters on film, up to a factor of 1.2. Where a drone wrote its lens's
// calibration (DJI's DewarpData), the camera is that (FULL_OPENCV), its focal length right to .5 %.
// In place of a list, a folder stands for the photographs in and below it, so listed by name: it
// lies in that of the photographs, or is it where none is given.
std::vector<Query> ReadQueryList(const std::filesystem::path& path_or_pattern,
                                 const std::filesystem::path& images = {});
// Makes the query of a photograph of an unknown camera, as if listed by its name alone; or of one
// in memory, by its size and the tags of its lens.
Query QueryOfUnknownCamera(const std::string& name, const std::filesystem::path& images);
Query QueryOfUnknownCamera(const std::string& name, PlaneSize size, const LensTags& lens = {});
// Gives a query the camera of such a line: "MODEL width height params... [focal_sigma S]". Throws
// InputError for anything else.
void TakeCamera(const std::string& text, Query& query);
void WriteQueryList(const std::filesystem::path& path, const std::vector<Query>& queries);

// Reads one image name per line.
std::vector<std::string> ReadImageList(const std::filesystem::path& path);

struct NamedPose {
  std::string name;
  Rigid3 cam_from_world;
};

// Reads lines `name qw qx qy qz tx ty tz`, world to camera. Quaternions are normalized; one that is
// not of unit length within 1e-3 is an error, as is a NaN. Numbers behind the pose are ignored:
// pGT's focal length, the errors and inliers of DSAC* and ACE.
std::vector<NamedPose> ReadPoseFile(const std::filesystem::path& path);
// Writes a pose file, with numbers in their shortest form that reads back as the same double.
void WritePoseFile(const std::filesystem::path& path, const std::vector<NamedPose>& poses);

// Reads a pose file as poses by the names of their images. Throws InputError where a name stands
// twice.
std::map<std::string, Rigid3> ReadNamedPoses(const std::filesystem::path& file);
// Reads them from a COLMAP model's folder or a pose file.
std::map<std::string, Rigid3> ReadModelOrPoses(const std::filesystem::path& model_or_file);

// Gives each query that was taken by a rig its frame and its pose in the rig. The file is COLMAP's
// rig configuration (rig_config.json of its rig_configurator), a list of rigs
//
//   [{"cameras": [{"image_prefix": "left/", "ref_sensor": true},
//                 {"image_prefix": "right/", "cam_from_rig_rotation": [qw, qx, qy, qz],
//                  "cam_from_rig_translation": [tx, ty, tz]}]}]
//
// where photographs whose names are alike after the prefix are of one frame; or a model with rigs
// and frames (COLMAP >= 3.12), whose poses are not looked at. Queries that share their frame with
// no other query, or that the file does not know, stay as they are. Throws InputError where it
// knows none at all, and for a camera without known pose in its rig.
void TakeRigs(const std::filesystem::path& file_or_model, std::span<Query> queries);

// Reads lines `name qw qx qy qz tx ty tz MODEL width height params...` (a line of a pose file,
// world to camera, followed by one of COLMAP's cameras, or by EQUIRECTANGULAR width height); `#`
// comments and empty lines are skipped. Throws InputError for anything else, and for a name that
// stands twice.
std::vector<PosedImage> ReadViewList(const std::filesystem::path& path);

// Parses "MODEL width height params..." as in the lists. Throws InputError naming `what` for
// anything else.
Camera ParseCamera(const std::string& what, const std::string& text);

// Reads lines `x y z`; `#` comments and empty lines are skipped.
std::vector<Eigen::Vector3d> ReadPointList(const std::filesystem::path& path);

}  // namespace raylift
