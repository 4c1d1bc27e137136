// Tells without ground truth whether a scene's input is read as it was meant. Under each reading of
// the depth maps and poses (z, ray length or inverse depth, unit, flips, half a pixel, inverted
// poses, OpenGL's axes) the references' keypoints are lifted to other points; under the right one
// these project onto their matches in the other references.
//
// Only matches that agree with the poses are asked: where too few do, no depth is to blame.
//
// Readings are compared in pairs over the same matches by c = log(1 + e^2 / px^2) of the
// reprojection errors e: the difference's mean over its standard error, in which the matches of one
// pair of images count as one (they share the errors of poses). Another reading explains the data
// far better where this exceeds 5 and errors shrink by at least a hundredth. As the
// readings are few and discrete, that is so only where the data are nearer to the other one. Each
// map's scale is left free in these comparisons: monocular depth is inconsistent between maps
// whatever its reading. Then the unit is what the maps' scales have in common.
//
// The best reading may still be bad in itself. So its errors are held against two others, neither
// of which is a constant: the distances of matches from their epipolar lines, which no depth
// changes, and the errors of depths that are dealt out at random among the keypoints of each map.
// Where it is bad, faults are looked for that no reading repairs (values that are cut off, that
// start again at zero, or that are an affine map of inverse depth; a mesh in another frame), and
// else nothing fits.

#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/base/enum_names.h"
#include "raylift/lifting/depth_alignment.h"
#include "raylift/lifting/geometry_source.h"
#include "raylift/lifting/geometry_spec.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/scene/image.h"

namespace raylift {

// Gives the maps themselves, to find faults in the values that they store.
struct StoredMaps {
  std::function<std::shared_ptr<const DepthMap>(const PosedImage&)> load;
  double unit = 1;  // what a stored 1 is as read
  std::vector<double> invalid_values = {};
};

struct DoctorInput {
  const GeometrySource& source;  // as it is read
  std::span<const PosedImage> references;
  std::span<const ReferenceMatch> matches;
  DataConvention as_read = {};
  // The size of the depth maps; nullopt for a surface in the world (a mesh), for which only the
  // poses are in doubt.
  std::optional<PlaneSize> map_size_px = std::nullopt;
  std::optional<StoredMaps> stored = std::nullopt;
  // The mesh, for the test whether it lies where the references are; may be null.
  std::shared_ptr<const RayCaster> mesh = nullptr;
  MeshPlacement as_placed = {};  // of the mesh, which has it already
};

// Returns the input for a mesh or depth maps; what is passed must outlive it.
DoctorInput MakeDoctorInput(const NamedGeometry& geometry, std::span<const PosedImage> references,
                            std::span<const ReferenceMatch> matches, PoseConvention poses);

struct DoctorOptions {
  size_t max_matches = 20000;  // evenly out of all
  bool half_pixels = true;     // also tests these, which take many matches
  int threads = 0;
};

// The evidence of the matches for a convention: errors of keypoints that are lifted in one
// reference and projected into another.
struct ConventionEvidence {
  DataConvention convention;
  size_t num_keypoints = 0;  // that have a depth under this reading
  double median_px = 0;      // their distance from their matches
  double share_within_5px = 0;
  double median_own_scale_px = 0;  // with each map at the scale that suits it best
  // These are the mean in c of the gain over the input as read, negative where it is worse, and
  // that over its standard error.
  double gain = 0;
  double sigmas = 0;
};

// Returns how a convention differs from `as_read` ("ray length, not z; depth x 0.001").
std::string DescribeDifference(const DataConvention& as_read, const DataConvention& other);

// The options that change `as_read` into the other convention: keys of the geometry's
// specification, and the convention of the model's poses.
struct RepairOptions {
  std::vector<std::string> geometry_keys;  // "kind=ray"
  std::optional<PoseConvention> model_poses = std::nullopt;
  // These keys of the specification are replaced by the others, or are to be removed.
  std::vector<std::string> replaced_keys = {};
};
RepairOptions FindRepair(const DataConvention& as_read, const DataConvention& other);

// Returns "in the geometry: kind=ray,scale=0.001; model_poses = opengl".
std::string ToString(const RepairOptions& repair);

enum class InputVerdict {
  kAsMeant,        // the input as read fits the matches
  kRepair,         // another reading fits them, and is far better
  kNothingFits,    // none does
  kTooFewMatches,  // that agree with the poses and tell depth, for any conclusion
};
template <>
inline constexpr auto kEnumNames<InputVerdict> = std::to_array<EnumName<InputVerdict>>({
    {InputVerdict::kAsMeant, "as_meant"},
    {InputVerdict::kRepair, "repair"},
    {InputVerdict::kNothingFits, "nothing_fits"},
    {InputVerdict::kTooFewMatches, "too_few_matches"},
});

// Faults that no other convention repairs.
enum class InputFault {
  kNone,
  kPoses,      // they do not agree with the matches
  kClamp,      // many pixels hold the largest or smallest value, which is not their depth
  kWrap,       // values start again at zero
  kDisparity,  // an affine map of inverse depth
  kAffine,     // an affine map of depth
  kMeshFrame,  // the mesh is in another frame than the references
};
template <>
inline constexpr auto kEnumNames<InputFault> = std::to_array<EnumName<InputFault>>({
    {InputFault::kNone, "none"},
    {InputFault::kPoses, "poses"},
    {InputFault::kClamp, "clamp"},
    {InputFault::kWrap, "wrap"},
    {InputFault::kDisparity, "disparity"},
    {InputFault::kAffine, "affine"},
    {InputFault::kMeshFrame, "mesh_frame"},
});

// The fit of a convention to the matches in itself, each map at its own scale: the errors of
// keypoints whose depth the matches tell, beside those of depths that are dealt out at random among
// the keypoints of each map. What has nothing to do with the scene fits no better than chance.
struct ConventionFit {
  size_t asked = 0;     // keypoints whose depth the matches tell
  size_t count = 0;     // of those that have a depth as read
  double coverage = 0;  // their share
  double median_px = 0;
  double median_chance_px = 0;
  double upper_px = 0;  // three quarters are below
  double upper_chance_px = 0;
};

struct Diagnosis {
  InputVerdict verdict = InputVerdict::kAsMeant;
  InputFault fault = InputFault::kNone;
  std::string reason;  // one clause: why nothing fits or nothing can be said, what is repaired
  DataConvention as_read;
  DataConvention best;  // as read, unless `verdict` is to repair it
  std::vector<ConventionEvidence>
      conventions;       // `best` first, then by how well they explain the data
  RepairOptions repair;  // empty unless that is the verdict
  // The placement that repairs the mesh; it replaces the one with which the mesh was read.
  std::optional<MeshPlacement> mesh_placement = std::nullopt;
  ConventionFit fit;  // of the best

  size_t num_matches = 0;
  size_t num_agreeing = 0;  // with the poses
  double epipolar_px = 0;   // their median distance from their epipolar lines

  bool suspicious() const {
    return verdict == InputVerdict::kRepair || verdict == InputVerdict::kNothingFits;
  }
  const ConventionEvidence& EvidenceOf(
      const DataConvention& convention) const;  // one that is listed
};

// Finds out which reading fits. The result does not depend on the number of threads.
Diagnosis Diagnose(const DoctorInput& input, const DoctorOptions& options = {});

// Returns one line that says what is suspected, why, and what repairs it.
std::string Summary(const Diagnosis& diagnosis);

}  // namespace raylift
