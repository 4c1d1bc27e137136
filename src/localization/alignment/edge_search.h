// Searches the pose of a photograph in a scene of which only the shape is known, from a prior.

#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "localization/alignment/edge_score.h"

#include "raylift/estimation/pose_estimator.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/scene/image.h"

namespace raylift {

// A pose that explains the photograph better than those around it.
struct EdgeMode {
  EdgeFit fit;
  double score = 0;  // EdgeScore at the finest size, and the prior's
  CellScores cells;  // of the score
};

struct FoundByEdges {
  std::vector<EdgeMode> modes;  // best first; none where the scene shows too few edges
  // This is the probability that the best mode is chance: at most that by the number of poses
  // tried, where cells show their edges or not with equal odds, and less where the verdict depends
  // on it and the modes of pictures that show no place give less.
  double chance = 1;
};

// Looks for the modes within the prior and, where the verdict hangs on it, for those of the
// photograph mirrored and upside down: they have its edges and no pose, but where the scene is as
// symmetric, and tell what chance explains. The result is the same for the same seed.
FoundByEdges SearchByEdges(const std::shared_ptr<const RayCaster>& mesh, const Image& gray,
                           const Camera& camera, const PosePrior& prior, uint64_t seed);

// Returns the probability that the best mode is right. The cells of the picture are taken for
// independent; with z = sum / sqrt(sum of squares) of the differences of their scores between two
// modes, and Q the normal distribution's tail, it is
//   (1 - chance) product over the other modes of (1 - Q(z)).
double ConfidenceOf(const FoundByEdges& found);

// Returns the other modes that lower this probability below that of a localized pose, each with the
// probability that it and no other is right, the likeliest first. Their covariances are not known.
std::vector<AlternativePose> AlternativesOf(const FoundByEdges& found);

}  // namespace raylift
