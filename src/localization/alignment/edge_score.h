// Scores how well a photograph shows the edges of a scene from a pose, and finds the pose of the
// best score.

#pragma once

#include <optional>
#include <span>
#include <vector>

#include "base/rng.h"
#include "localization/alignment/edge_image.h"
#include "localization/alignment/scene_edges.h"
#include <Eigen/Core>

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"

namespace raylift {

// The prior of a photograph's pose.
struct PosePrior {
  Rigid3 cam_from_world;
  // These are the standard deviations of the center along the world's axes and of the angles; they
  // are above 0.
  Eigen::Vector3d sigma_position;
  double sigma_deg;
};

// A piece of an edge in the picture.
struct SeenEdge {
  Eigen::Vector2d pixel;
  Eigen::Vector2d normal;                      // unit
  Eigen::Matrix<double, 2, 3> pixel_from_cam;  // its derivative
  Eigen::Vector3d point_in_cam;
};

class EdgeViewer {
 public:
  EdgeViewer(const Camera& camera, const Rigid3& cam_from_world)
      : camera_(camera),
        rotation_(cam_from_world.rotation.toRotationMatrix()),
        translation_(cam_from_world.translation) {}

  // Returns how the camera sees an edge, which may be outside of the picture; nullopt where the
  // lens shows it nowhere.
  std::optional<SeenEdge> See(const SceneEdge& edge) const;

 private:
  const Camera& camera_;
  Eigen::Matrix3d rotation_;
  Eigen::Vector3d translation_;
};

// Returns the logarithm of the likelihood ratio of all pieces, weighted by their lengths: the sum
// of log(1 + s e) with the evidence e (EdgeImage), s being the share of the scene's edges that the
// photograph shows, of each kind the likeliest.
double EdgeScore(const EdgeImage& image, std::span<const SceneEdge> edges,
                 const Rigid3& cam_from_world);

// Scores the cells of the picture, which are taken for independent of each other: neighbors on one
// edge are right or wrong together.
inline constexpr int kCellsPerSide = 8;
inline constexpr int kNumCells = kCellsPerSide * kCellsPerSide;
using CellScores = Eigen::Array<double, kNumCells, 1>;
CellScores EdgeScoreByCell(const EdgeImage& image, std::span<const SceneEdge> edges,
                           const Rigid3& cam_from_world);

// Returns the logarithm of the prior's density, up to a constant.
double LogPrior(const PosePrior& prior, const Rigid3& cam_from_world);

struct EdgeFit {
  Rigid3 cam_from_world;
  Eigen::Matrix<double, 6, 6> covariance;  // of the step (w, v), see geometry/residuals.h
};

// Fits the pose by Gauss-Newton, damped a little, to the distances of edges along their normals, up
// to `reach_px`, each weighted by the probability that it is not by chance; the distances' standard
// deviation is estimated. nullopt where the edges do not determine the pose.
std::optional<EdgeFit> FitEdges(const EdgeImage& image, std::span<const SceneEdge> edges,
                                const PosePrior& prior, const Rigid3& start, double reach_px);

// Adds to a fit's covariance, which takes pixels for independent, the scatter of fits in which
// blocks of the picture have other weights (the Bayesian bootstrap): edges of one thing err
// together, and from elsewhere other edges are the nearest ones.
void AddCovarianceByResampling(const EdgeImage& image, std::span<const SceneEdge> edges,
                               const PosePrior& prior, double reach_px, Rng& rng, EdgeFit& fit);

// Computes how often chance shows a scene's edges in a photograph as well as a pose does.

// Returns the probability that independent cells of random signs have as large a sum.
double ChanceOf(const CellScores& scores);

// Returns the lower bound of a score at two standard deviations (wrong once in 44), from its cells,
// which are taken for independent.
double LeastScore(const CellScores& cells);

// Returns the probability that a search finds a mode of this score by chance. `by_chance` are the
// best scores, best first, of searches by chance from so many `times` fewer positions. The largest
// of many exceed a threshold as often as a Poisson process says, by amounts that are distributed
// exponentially. As their mean is known from so many of them alone, the exponential becomes a
// power. 1 where fewer than three are given.
double ChanceOfScore(double score, std::span<const double> by_chance, double times);

// Returns the least probability that it was chance, if it was so or not with equal odds before and
// a search gives so good a mode with the probability p by chance: the odds are at least -e p log p
// (Sellke, Bayarri, Berger 2001).
double LeastProbabilityOfChance(double p);

}  // namespace raylift
