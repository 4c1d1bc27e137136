// A first guess, at a given pose, of where on its ray each query keypoint lies, of which of its
// matches agree on that, and of the noise.

#pragma once

#include <vector>

#include "estimation/joint_noise.h"
#include "estimation/keypoint_evidence.h"
#include "estimation/solvers/p3p.h"
#include <Eigen/Core>

namespace raylift {

// Of one keypoint.
struct KeypointState {
  Eigen::Vector3d point = Eigen::Vector3d::Zero();  // local frame
  double common = 0;                                // error of its depths, see JointNoise
  double query_right = 1;                           // probability that the query's pixel is
  double query_precision = 1;                       // of that pixel, as a sighting's
};

// The probability that each piece of evidence is right; of a depth, given that its sighting is.
struct EvidenceWeights {
  std::vector<double> sighting;
  std::vector<double> precision;  // of its pixel, over the mean one (StudentPrecision())
  std::vector<double> depth;
  std::vector<double> loose;
  // By how much wrong matches with each reference are denser near epipolar lines than anywhere in
  // the image, at least 1: those with the next window of a row lie near them.
  std::vector<double> crowding;
};

// The likeliest noise of depths and loose points, where they are compared with what the sightings
// alone say at this pose, and the distances' distribution.
JointNoise GuessNoise(const KeypointEvidence& evidence, const SolverPose& pose,
                      double keypoint_variance_px2);

// On each keypoint's ray the point that most of its evidence agrees on.
void FindConsensus(const KeypointEvidence& evidence, const SolverPose& pose,
                   const JointNoise& noise, std::vector<KeypointState>& states,
                   EvidenceWeights& weights);

}  // namespace raylift
