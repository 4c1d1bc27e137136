// The unknowns of the joint refinement, and how they explain the evidence: each sighting, each
// loose point and the query's view as a quadratic in the unknowns of its keypoint and of its view.

#pragma once

#include <vector>

#include "estimation/joint_noise.h"
#include "estimation/keypoint_consensus.h"
#include "estimation/keypoint_evidence.h"
#include "estimation/keypoint_sight.h"
#include "estimation/solvers/p3p.h"
#include <Eigen/Core>

namespace raylift {

using Matrix7d = Eigen::Matrix<double, 7, 7>;
using Matrix47d = Eigen::Matrix<double, 4, 7>;

// The unknowns of a view, by how they displace a point: by a turn about the local origin, and a
// shift. (Common to all views of a point, so that one matrix serves them all.)
Eigen::Matrix<double, 3, 6> DisplacementJacobian(const Eigen::Vector3d& point);

// Evidence with less weight is left out.
inline constexpr double kLeastWeight = 1e-3;

// What is wrong with a reference: points seem displaced to it by turn x point + shift, and its
// depths have a factor.
struct ReferenceError {
  Eigen::Vector3d turn = Eigen::Vector3d::Zero();
  Eigen::Vector3d shift = Eigen::Vector3d::Zero();
  double log_factor = 0;

  Eigen::Vector3d Displaced(const Eigen::Vector3d& point) const {
    return point + turn.cross(point) + shift;
  }
};

// Of a quadratic in a point's displacement and the logarithm of its depths' common factor.
struct Quadratic {
  Eigen::Matrix4d hessian = Eigen::Matrix4d::Zero();
  Eigen::Vector4d gradient = Eigen::Vector4d::Zero();

  void Add(const Quadratic& other) {
    hessian += other.hessian;
    gradient += other.gradient;
  }
};

// A sighting, linearized.
struct SightingTerm {
  PixelResidual seen;
  double pixel_variance = 0;
  Eigen::Vector3d log_gradient = Eigen::Vector3d::Zero();  // of the logarithm of the distance
  double depth_error = 0;
  double depth_variance = 0;
  double weight = 0;        // of the pixel, over its variance
  double depth_weight = 0;  // of the depth, over its variance

  Quadratic Cost() const;
};

// The query's view, with the prior of the point's distance.
struct QueryTerm {
  PixelResidual seen;
  Eigen::Matrix<double, 2, 3> jacobian = Eigen::Matrix<double, 2, 3>::Zero();  // by the point
  double weight = 0;                                                           // over its variance
  Eigen::Vector3d log_gradient = Eigen::Vector3d::Zero();
  double distance_error = 0;     // logarithm of the distance less the prior's mean
  double prior_information = 0;  // of the distance's logarithm

  // In the point's displacement and the prior's mean, which is an unknown of the query.
  Quadratic Cost() const;
};

struct JointModel {
  const KeypointEvidence& evidence;
  SolverPose pose;
  JointNoise noise;
  std::vector<KeypointState> keypoints;
  EvidenceWeights weights;
  std::vector<ReferenceError> references;  // and last of the loose points, as of one more

  JointModel(const KeypointEvidence& of, const SolverPose& start)
      : evidence(of), pose(start), references(of.centers.size()) {}

  size_t LooseView() const { return evidence.num_references(); }

  QueryTerm LookFromQuery(size_t keypoint) const;
  SightingTerm LookFromReference(int sighting, const KeypointState& state) const;
  Quadratic LooseCost(const KeypointParts& keypoint, const Eigen::Vector3d& point) const;
  Quadratic CommonPrior(const KeypointState& state) const;
  // Of all that references and loose points say of it.
  double TotalWeight(const KeypointParts& keypoint) const;
};

}  // namespace raylift
