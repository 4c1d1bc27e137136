#include <set>

#include "base/index_sets.h"
#include "estimation/methods/methods.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/scene/keypoints.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {
namespace {

// Runs P3P for each covisibility cluster, as hloc does (Sarlin et al., CVPR 2019).
class HlocEstimator final : public PoseEstimator {
 public:
  explicit HlocEstimator(const EstimatorOptions& options) : p3p_(options, P3pMethod(options)) {}

  PoseEstimate Estimate(const PoseProblem& problem) const override {
    const std::vector<int> clusters = ClustersOf(problem);
    std::set<int> names(clusters.begin(), clusters.end());
    if (names.empty()) names.insert(0);  // of points that no reference has
    std::optional<PoseEstimate> best;
    int iterations = 0;
    for (const int cluster : names) {
      PoseEstimate estimate = EstimateCluster(problem, clusters, cluster);
      iterations += estimate.iterations;
      const bool better =
          best && estimate.cam_from_world &&
          (!best->cam_from_world || estimate.score_2d3d.num_inliers > best->score_2d3d.num_inliers);
      if (better || !best) {
        best = std::move(estimate);
      }
    }
    best->iterations = iterations;
    return *best;
  }

 private:
  static std::vector<int> ClustersOf(const PoseProblem& problem) {
    if (problem.reference_clusters.empty()) return ClusterBySharedKeypoints(problem);
    if (problem.reference_clusters.size() != problem.references.size()) {
      throw InputError(
          fmt::format("reference_clusters: expected one for each of {} references, found {}",
                      problem.references.size(), problem.reference_clusters.size()));
    }
    return problem.reference_clusters;
  }

  // Returns the estimate from the cluster's matches, its inliers counted among all matches of the
  // problem.
  PoseEstimate EstimateCluster(const PoseProblem& problem, const std::vector<int>& clusters,
                               int cluster) const {
    PoseProblem part = problem;
    part.matches_2d3d.clear();
    std::vector<size_t> kept;
    for (size_t i = 0; i < problem.matches_2d3d.size(); ++i) {
      const auto& reference = problem.matches_2d3d[i].reference;
      const bool exists =
          reference && *reference >= 0 && static_cast<size_t>(*reference) < clusters.size();
      if (!reference || (exists && clusters[static_cast<size_t>(*reference)] == cluster)) {
        kept.push_back(i);
        part.matches_2d3d.push_back(problem.matches_2d3d[i]);
      }
    }
    PoseEstimate estimate = p3p_.Estimate(part);
    std::vector<bool> inliers(problem.matches_2d3d.size(), false);
    for (size_t k = 0; k < kept.size(); ++k) {
      inliers[kept[k]] = estimate.inliers_2d3d[k];
    }
    estimate.inliers_2d3d = std::move(inliers);
    const int left_out = static_cast<int>(problem.matches_2d3d.size() - kept.size());
    estimate.score_2d3d.num_matches += left_out;
    estimate.score_2d3d.msac_cost += left_out;
    return estimate;
  }

  RansacEstimator p3p_;
};

}  // namespace

std::vector<int> ClusterBySharedKeypoints(const PoseProblem& problem) {
  const size_t count = problem.references.size();
  DisjointSets sets(count);
  const KeypointNumbers keypoints = NumberQueryKeypoints(problem.matches_2d2d, {});
  std::vector<std::optional<size_t>> reference_of_keypoint(keypoints.count);
  for (size_t i = 0; i < problem.matches_2d2d.size(); ++i) {
    const int index = problem.matches_2d2d[i].reference;
    if (index < 0 || static_cast<size_t>(index) >= count) {
      continue;
    }
    const auto reference = static_cast<size_t>(index);
    std::optional<size_t>& first = reference_of_keypoint[keypoints.of_2d2d[i]];
    if (first) {
      sets.Join(*first, reference);
    } else {
      first = reference;
    }
  }
  return sets.Numbers();
}

std::unique_ptr<PoseEstimator> MakeHlocEstimator(const EstimatorOptions& options) {
  return std::make_unique<HlocEstimator>(options);
}

}  // namespace raylift
