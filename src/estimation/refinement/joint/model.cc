#include "estimation/refinement/joint/model.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace raylift {

using Eigen::Vector3d;

Eigen::Matrix<double, 3, 6> DisplacementJacobian(const Vector3d& point) {
  Eigen::Matrix<double, 3, 6> jacobian;
  jacobian << -Skew(point), Eigen::Matrix3d::Identity();
  return jacobian;
}

namespace {

constexpr size_t kLanes = kernels::kLanes<double>;

template <typename Vector>
void Put(const Vector& values, size_t lane, kernels::Row* rows) {
  for (int i = 0; i < Vector::SizeAtCompileTime; ++i) rows[i][lane] = values[i];
}
void PutRowMajor(const Eigen::Matrix3d& matrix, size_t lane, kernels::Row* rows) {
  for (Eigen::Index row = 0; row < 3; ++row) {
    Put(Eigen::Vector3d(matrix.row(row)), lane, rows + 3 * row);
  }
}

// Returns a slot whose lanes see all points at finite pixels, as zero times them is added by those
// without an observation.
kernels::JointObservations EmptySlot() {
  kernels::JointObservations slot{};
  for (size_t lane = 0; lane < kLanes; ++lane) {
    PutRowMajor(Eigen::Matrix3d::Identity(), lane, slot.image_from_ray);
  }
  return slot;
}

// Returns the keypoints in an order that has those with the same kinds and numbers of pieces
// together.
std::vector<size_t> BySize(const KeypointEvidence& evidence) {
  std::vector<uint64_t> keys;
  keys.reserve(evidence.keypoints.size());
  for (size_t k = 0; k < evidence.keypoints.size(); ++k) {
    const KeypointObservations& keypoint = evidence.keypoints[k];
    const auto observations = evidence.ObservationsOf(keypoint);
    const bool has_depths = std::any_of(observations.begin(), observations.end(),
                                        [](const Observation& o) { return o.has_depth; });
    keys.push_back(evidence.UnanchoredOf(keypoint).size() << 49 | observations.size() << 33 |
                   uint64_t{has_depths} << 32 | k);
  }
  std::sort(keys.begin(), keys.end());
  std::vector<size_t> order;
  order.reserve(keys.size());
  for (const uint64_t key : keys) order.push_back(key & 0xffffffff);
  return order;
}

}  // namespace

EvidenceBlocks::EvidenceBlocks(const KeypointEvidence& evidence)
    : places_(evidence.keypoints.size()),
      keypoints_((evidence.keypoints.size() + kLanes - 1) / kLanes) {
  // There are as many slots as if all blocks were full, and some.
  observations_.reserve(evidence.observations.size() / kLanes + 64);
  unanchored_.reserve(evidence.unanchored.size() / kLanes + 16);
  size_t place = 0;
  for (const size_t k : BySize(evidence)) {
    places_[k] = place++;
    Append(evidence, k);
  }
  for (; place < keypoints_.size() * kLanes; ++place) {
    PutRowMajor(Eigen::Matrix3d::Identity(), place % kLanes, keypoints_.back().image_from_cam);
  }
}

void EvidenceBlocks::Append(const KeypointEvidence& evidence, size_t k) {
  const auto [index, lane] = LaneOf(k);
  const KeypointObservations& keypoint = evidence.keypoints[k];
  kernels::JointKeypoints& block = keypoints_[index];
  PutRowMajor(keypoint.image_from_cam, lane, block.image_from_cam);
  Put(keypoint.camera_center, lane, block.camera_center);
  Put(keypoint.px_by_log_focal, lane, block.px_by_log_focal);
  // The last keypoints have the most pieces.
  if (lane == 0) {
    block.first_observation = static_cast<int>(observations_.size());
    block.first_unanchored = static_cast<int>(unanchored_.size());
  }
  const auto observations = evidence.ObservationsOf(keypoint);
  const auto unanchored = evidence.UnanchoredOf(keypoint);
  const size_t first_observation = static_cast<size_t>(block.first_observation);
  static const kernels::JointObservations kEmptySlot = EmptySlot();
  observations_.resize(std::max(observations_.size(), first_observation + observations.size()),
                       kEmptySlot);
  const size_t first_unanchored = static_cast<size_t>(block.first_unanchored);
  unanchored_.resize(std::max(unanchored_.size(), first_unanchored + unanchored.size()));
  block.end_observation = static_cast<int>(observations_.size());
  block.end_unanchored = static_cast<int>(unanchored_.size());
  for (size_t i = 0; i < observations.size(); ++i) {
    const Observation& observation = observations[i];
    kernels::JointObservations& slot = ObservationAt(index, static_cast<int>(i));
    slot.is_there[lane] = 1;
    PutRowMajor(observation.image_from_ray, lane, slot.image_from_ray);
    Put(observation.center, lane, slot.center);
    Put(observation.ray, lane, slot.ray);
    slot.extra_variance_px2[lane] = observation.extra_variance_px2;
    slot.has_depth[lane] = observation.has_depth ? 1 : 0;
    slot.log_distance[lane] = observation.log_distance;
    slot.depth_variance[lane] = observation.depth_variance;
    block.has_depths = block.has_depths || observation.has_depth;
  }
  for (size_t i = 0; i < unanchored.size(); ++i) {
    kernels::JointUnanchored& slot = unanchored_[static_cast<size_t>(block.first_unanchored) + i];
    slot.is_there[lane] = 1;
    Put(unanchored[i].point, lane, slot.point);
    slot.variance[lane] = unanchored[i].variance;
  }
}

kernels::JointParameters JointModel::ForKernels() {
  kernels::JointParameters parameters = {.focal_error = focal_error,
                                         .is_focal_unknown = false,
                                         .have_references_errors = have_references_errors,
                                         .keypoint_px2 = noise.keypoint_px2,
                                         .keypoint_tail = noise.keypoint_tail,
                                         .depth = noise.depth,
                                         .common_depth = noise.common_depth,
                                         .unanchored = noise.unanchored,
                                         .right = noise.right,
                                         .depth_right = noise.depth_right,
                                         .unanchored_right = noise.unanchored_right,
                                         .log_distance_mean = noise.log_distance_mean,
                                         .log_distance_variance = noise.log_distance_variance,
                                         .matched_area_px2 = evidence.matched_area_px2,
                                         .least_weight = kLeastWeight};
  Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(parameters.rotation) = pose.rotation;
  Eigen::Map<Vector3d>(parameters.translation) = pose.translation;
  if (!have_references_errors) return parameters;
  const ReferenceError& unanchored = references[UnanchoredFrame()];
  Eigen::Map<Eigen::Matrix<double, 6, 1>>(parameters.unanchored_error)
      << unanchored.rotation_vector,
      unanchored.translation;
  for (size_t k = 0; k < evidence.keypoints.size(); ++k) {
    const auto [block, lane] = blocks.LaneOf(k);
    int n = 0;
    for (const Observation& observation : evidence.ObservationsOf(evidence.keypoints[k])) {
      const ReferenceError& error = references[static_cast<size_t>(observation.reference)];
      auto& rows = blocks.ObservationAt(block, n++).reference_error;
      Put(error.rotation_vector, lane, rows);
      Put(error.translation, lane, rows + 3);
      rows[6][lane] = error.log_scale;
    }
  }
  return parameters;
}

}  // namespace raylift
