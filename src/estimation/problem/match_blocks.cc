// Lays matches out for the kernels, and computes their exact residuals.

#include <cstring>

#include "estimation/kernels/kernel_table.h"
#include "estimation/problem/normalized_problem.h"

namespace raylift {
namespace {

// Returns how many blocks the selected matches fill, each with matches of one `group`.
template <typename Match>
size_t CountBlocks(const std::vector<Match>& matches, int Match::*group,
                   const std::vector<int>& selection, int lanes) {
  size_t count = 0;
  int used = 0;
  for (size_t i = 0; i < selection.size(); ++i) {
    const bool same = i > 0 && matches[selection[i]].*group == matches[selection[i - 1]].*group;
    used = same && used < lanes ? used + 1 : 1;
    count += used == 1 ? 1 : 0;
  }
  return count;
}

}  // namespace

template <typename T>
Blocks2D3D<T> MakeBlocks2D3D(const std::vector<NormalizedMatch2D3D>& points,
                             const std::vector<int>& selection) {
  constexpr int kLanes = kernels::kLanes<T>;
  Blocks2D3D<T> result;
  const size_t num_blocks = CountBlocks(points, &NormalizedMatch2D3D::camera, selection, kLanes);
  result.blocks.resize(num_blocks);
  if (num_blocks > 0) {
    std::memset(static_cast<void*>(result.blocks.data()), 0, num_blocks * sizeof(result.blocks[0]));
  }
  result.block_camera.reserve(num_blocks);
  result.lane_match.assign(num_blocks * kLanes, -1);
  int lane = kLanes;
  for (const int index : selection) {
    const NormalizedMatch2D3D& point = points[index];
    if (lane == kLanes || result.block_camera.back() != point.camera) {
      lane = 0;
      result.block_camera.push_back(point.camera);
    }
    const size_t last = result.block_camera.size() - 1;
    kernels::Block2D3D<T>& block = result.blocks[last];
    result.lane_match[last * kLanes + lane] = index;
    block.variance_at_unit_depth[lane] = static_cast<T>(point.variance_at_unit_depth);
    for (int k = 0; k < 3; ++k) {
      block.x[k][lane] = static_cast<T>(point.point[k]);
      for (int c = 0; c < 3; ++c) {
        block.image_from_ray[3 * k + c][lane] = static_cast<T>(point.image_from_ray(k, c));
      }
    }
    ++lane;
  }
  return result;
}

template <typename T>
Blocks2D2D<T> MakeBlocks2D2D(const std::vector<NormalizedMatch2D2D>& pairs,
                             const std::vector<int>& selection) {
  constexpr int kLanes = kernels::kLanes<T>;
  Blocks2D2D<T> result;
  const size_t num_blocks =
      CountBlocks(pairs, &NormalizedMatch2D2D::camera_reference, selection, kLanes);
  result.blocks.reserve(num_blocks);
  result.block_camera_reference.reserve(num_blocks);
  result.lane_match.reserve(num_blocks * kLanes);
  int lane = kLanes;
  for (const int index : selection) {
    const NormalizedMatch2D2D& pair = pairs[index];
    if (lane == kLanes || result.block_camera_reference.back() != pair.camera_reference) {
      lane = 0;
      result.blocks.emplace_back();
      std::memset(static_cast<void*>(&result.blocks.back()), 0, sizeof(result.blocks.back()));
      result.block_camera_reference.push_back(pair.camera_reference);
      result.lane_match.insert(result.lane_match.end(), kLanes, -1);
    }
    kernels::Block2D2D<T>& block = result.blocks.back();
    result.lane_match[(result.blocks.size() - 1) * kLanes + lane] = index;
    for (int k = 0; k < 3; ++k) {
      block.query_ray[k][lane] = static_cast<T>(pair.query_ray[k]);
      block.reference_ray[k][lane] = static_cast<T>(pair.reference_ray[k]);
      for (int g = 0; g < 2; ++g) {
        block.query_gradient[3 * g + k][lane] = static_cast<T>(pair.query_gradient(k, g));
        block.reference_gradient[3 * g + k][lane] = static_cast<T>(pair.reference_gradient(k, g));
      }
    }
    block.parallax[lane] = static_cast<T>(pair.parallax);
    ++lane;
  }
  return result;
}

template Blocks2D3D<float> MakeBlocks2D3D<float>(const std::vector<NormalizedMatch2D3D>&,
                                                 const std::vector<int>&);
template Blocks2D3D<double> MakeBlocks2D3D<double>(const std::vector<NormalizedMatch2D3D>&,
                                                   const std::vector<int>&);
template Blocks2D2D<float> MakeBlocks2D2D<float>(const std::vector<NormalizedMatch2D2D>&,
                                                 const std::vector<int>&);
template Blocks2D2D<double> MakeBlocks2D2D<double>(const std::vector<NormalizedMatch2D2D>&,
                                                   const std::vector<int>&);

template <typename T>
kernels::KernelPose<T> ToKernelPose(const CamFromLocal& pose) {
  kernels::KernelPose<T> result;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) {
      result.rotation[3 * r + c] = static_cast<T>(pose.rotation(r, c));
    }
    result.translation[r] = static_cast<T>(pose.translation[r]);
  }
  return result;
}
template kernels::KernelPose<float> ToKernelPose<float>(const CamFromLocal&);
template kernels::KernelPose<double> ToKernelPose<double>(const CamFromLocal&);

template <typename T>
std::vector<T> CentersInCam(const NormalizedProblem& problem, const CamFromLocal& pose) {
  const size_t num_references = problem.centers.size();
  std::vector<T> centers(3 * problem.num_camera_references());
  for (size_t i = 0; i < num_references; ++i) {
    const Eigen::Vector3d from_query = pose.rotation * problem.centers[i] + pose.translation;
    for (size_t camera = 0; camera < problem.camera_centers.size(); ++camera) {
      const Eigen::Vector3d center = from_query - problem.camera_centers[camera];
      T* of_view = &centers[3 * (camera * num_references + i)];
      for (int k = 0; k < 3; ++k) of_view[k] = static_cast<T>(center[k]);
    }
  }
  return centers;
}
template std::vector<float> CentersInCam<float>(const NormalizedProblem&, const CamFromLocal&);
template std::vector<double> CentersInCam<double>(const NormalizedProblem&, const CamFromLocal&);

namespace {

std::vector<double> ByMatch(const std::vector<double>& lanes, const std::vector<int>& match_of_lane,
                            size_t count) {
  std::vector<double> by_match(count);
  for (size_t i = 0; i < lanes.size(); ++i) {
    if (match_of_lane[i] >= 0) by_match[match_of_lane[i]] = lanes[i];
  }
  return by_match;
}

std::vector<double> Residuals2D3D(const NormalizedProblem& problem, const CamFromLocal& pose) {
  const Blocks2D3D<double>& blocks = problem.exact_2d3d;
  std::vector<double> lanes(blocks.lane_match.size());
  ForEachCamera(
      0, static_cast<int>(blocks.blocks.size()),
      [&](int block) { return blocks.block_camera[block]; },
      [&](int camera, int first, int num_blocks) {
        kernels::ActiveKernels().residuals_2d3d(
            &blocks.blocks[first], num_blocks,
            ToKernelPose<double>(problem.PoseOfCamera(pose, camera)),
            &lanes[static_cast<size_t>(first) * kernels::kLanes<double>]);
      });
  return ByMatch(lanes, blocks.lane_match, problem.matches_2d3d.size());
}

std::vector<double> Residuals2D2D(const NormalizedProblem& problem, const CamFromLocal& pose) {
  const Blocks2D2D<double>& blocks = problem.exact_2d2d;
  const auto centers = CentersInCam<double>(problem, pose);
  std::vector<double> lanes(blocks.lane_match.size());
  kernels::ActiveKernels().residuals_2d2d(blocks.blocks.data(),
                                          blocks.block_camera_reference.data(),
                                          static_cast<int>(blocks.blocks.size()),
                                          ToKernelPose<double>(pose), centers.data(), lanes.data());
  return ByMatch(lanes, blocks.lane_match, problem.matches_2d2d.size());
}

}  // namespace

Residuals ComputeResiduals(const NormalizedProblem& problem, const CamFromLocal& pose,
                           MatchSets sets) {
  Residuals residuals;
  if (Has2D3D(sets)) residuals.of_2d3d = Residuals2D3D(problem, pose);
  if (Has2D2D(sets)) residuals.of_2d2d = Residuals2D2D(problem, pose);
  return residuals;
}

}  // namespace raylift
