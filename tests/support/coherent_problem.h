// Pose problems from one scene whose mistakes come together: a query keypoint is matched with
// several references, so that its noise is in all of its matches; a repeated element is matched one
// element further in several references; a reference's depths are off by one factor and its pose by
// one motion; a surface is off alike for all references.

#pragma once

#include <string>
#include <vector>

#include "base/rng.h"

#include "raylift/geometry/rigid3.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

struct CoherentOptions {
  int num_keypoints = 300;  // of the query, 1600 x 1200 pixels, some 20 m before a facade
  int num_references = 8;
  double baseline = 5;  // references lie within this distance of the query, most of them beside it
  double vertical = 0.1;  // of it upwards
  double seen = 0.55;     // share of the keypoints that a reference is matched with
  double wrong = 0.2;     // share of matches that show another keypoint
  double repeated = 0;    // share of keypoints that look like their neighbors 2.4 m away
  double sigma_px = 0.7;
  int tail_degrees = 0;      // of freedom, where a keypoint's noise is Student's t; 0: it is normal
  double reference_deg = 0;  // standard deviations of the known poses
  double reference_position = 0;
  double reference_factor = 0;  // of the logarithm of a reference's depths
  double surface = 0;           // of the logarithm of a keypoint's depths, alike in all references
  // Of a rig, each with so many keypoints; the others are within `rig_extent` of the query's own.
  int num_cameras = 1;
  double rig_extent = 1;
};

struct CoherentProblem {
  PoseProblem problem;
  Rigid3 query_from_world;
};

CoherentProblem MakeCoherentProblem(const std::string& name, const CoherentOptions& options,
                                    Rng& rng);

}  // namespace raylift
