// Tells whether a scene's input is read as it was meant, without ground truth. Each reading of the
// depth maps and poses (z or ray length or inverse, unit, flips, half a pixel, inverted poses,
// OpenGL's axes) lifts the references' keypoints elsewhere; under the right one they project onto
// their matches in the other references.
//
// Readings are compared in pairs over the same matches by c = log(1 + e^2 / px^2) of the
// reprojection errors e: the difference's mean over its standard error, in which the matches of one
// pair of images count as one (they share the errors of poses). Another reading explains the data
// far better where this exceeds `min_sigmas` and errors shrink by at least a hundredth. As the
// readings are few and discrete, that is so only where the data are nearer to the other one. Each
// map's scale is left free in these comparisons: monocular depth is inconsistent between maps
// whatever its reading. Then the unit is what the maps' scales have in common.

#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/lifting/geometry_source.h"
#include "raylift/lifting/geometry_spec.h"
#include "raylift/lifting/input_reading.h"
#include "raylift/lifting/reference_matches.h"
#include "raylift/scene/plane_size.h"

namespace raylift {

struct DoctorInput {
  const GeometrySource& source;  // as it is read
  std::span<const PosedImage> references;
  std::span<const ReferenceMatch> matches;
  InputReading as_read = {};
  // Of depth maps. None: a surface in the world (a mesh), of which only the poses are in doubt.
  std::optional<PlaneSize> map_size_px = std::nullopt;
};

// Of a mesh or depth maps; what is passed must outlive the input.
DoctorInput MakeDoctorInput(const NamedGeometry& geometry, std::span<const PosedImage> references,
                            std::span<const ReferenceMatch> matches, PoseConvention poses);

struct DoctorOptions {
  size_t max_matches = 20000;  // evenly out of all
  double min_sigmas = 5;
  bool shifts = true;  // also test half a pixel, which takes many matches
  int threads = 0;
};

// How well a reading explains the matches: a keypoint lifted in one reference, seen in another.
struct ReadingEvidence {
  InputReading reading;
  size_t num_keypoints = 0;  // that have a depth under this reading
  double median_px = 0;      // their distance from their matches
  double share_within_5px = 0;
  double median_own_scale_px = 0;  // with each map at the scale that suits it best
  // Better than as read (negative: worse): the mean gain in c, and over its standard error.
  double gain = 0;
  double sigmas = 0;
};

struct Diagnosis {
  // Fewer maps or matches than any conclusion needs.
  bool too_few_matches = false;
  InputReading as_read;
  InputReading best;                      // as read, unless another explains the data far better
  std::vector<ReadingEvidence> readings;  // `best` first, then by how well they explain the data

  bool suspicious() const { return !(best == as_read); }
  const ReadingEvidence& EvidenceOf(const InputReading& reading) const;  // one that is listed
};

// The same for any number of threads.
Diagnosis Diagnose(const DoctorInput& input, const DoctorOptions& options = {});

// One line that says what is suspected, why, and what repairs it.
std::string Summary(const Diagnosis& diagnosis);

}  // namespace raylift
