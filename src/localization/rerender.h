// Sharpens a pose against a mesh or splats: they are rendered as the query saw them from the
// estimated pose, and from a few poses around that; the query is matched with these pictures, which
// differ less in viewpoint than any reference, and its pose is estimated anew. From there one more
// picture is rendered, whose patches are found in the photograph (AlignPatches), and the pose
// is estimated with these, too. The new pose is kept only where the matches support it better.

#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "raylift/lifting/mesh_source.h"
#include "raylift/localization/localizer.h"
#include "raylift/renderers/frame_renderer.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/scene/image.h"

namespace raylift {

struct RerenderOptions {
  int rounds = 1;  // at most; a pose that is not kept ends them
  // Poses are tried around the estimated one, to the left, right, above and below of it, on a
  // circle of this angle around the middle of what the query shows; with 0 there are none.
  double around_deg = 6;
  // The farthest that the point of a match with a picture, projected by the pose so far, may lie
  // from the query's keypoint, as a share of the longer side: a pose that is roughly right tells
  // where to look, which is why the ratio test can be weaker than among the references.
  double search_radius = 0.05;
  double max_ratio = 0.9;
  // With this the 2D-2D matches with the pictures are used, too, for estimators that take nothing
  // else. The pictures are taken from nearly one place, that of the query, where such matches say
  // little on its position, and the 2D-3D matches hold all they know: without them poses are
  // sharper.
  bool use_pairs = false;
  // Larger queries are rendered at this size.
  int max_image_side_px = 1600;
  int max_features = 4096;
  double reprojection_threshold_px = 8;  // the estimator's
};

// Returns how well 2D-3D matches support a pose: the sum over the query's keypoints of 1 - e^2 /
// t^2, not below 0, e being the smallest reprojection error of the keypoint's matches and t the
// threshold. A keypoint with many matches counts once.
double KeypointSupport(const Camera& camera, const Rigid3& cam_from_world,
                       std::span<const Match2D3D> matches, double threshold_px);

// Finds pieces of a rendering in a photograph that was taken from nearly the same pose. Where a
// mesh is coarse, a descriptor has few keypoints that are where the photograph's are; a piece of
// the rendering has all that both show, and its place is known to a fraction of a pixel.
struct PatchMatch {
  Eigen::Vector2d rendering_px;
  Eigen::Vector2d photograph_px;
};

// Returns the rendering's corners, the best first, whose patch is a peak of normalized
// cross-correlation in the photograph. Both are gray, and the photograph is shrunk to the
// rendering's size where it is larger; `mask` is 0 where the rendering shows nothing, and no patch
// holds such a pixel.
std::vector<PatchMatch> AlignPatches(const Image& photograph, const Image& rendering,
                                     const Image& mask);

class Rerenderer {
 public:
  // Renders with the colors and light of `look`.
  Rerenderer(const std::shared_ptr<const RayCaster>& mesh, const ColorOptions& look,
             std::filesystem::path query_images, const RerenderOptions& options);

  // Does nothing for a query that is not localized. Otherwise it goes through rounds: each takes
  // the matches with the retrieved references and the 2D-3D matches with the pictures of this
  // round, and its pose is kept where it is at least as sure as `min_confidence` and
  // KeypointSupport by these 2D-3D matches is above that of the pose before. Patches are looked for
  // only where the pose has them, and so make it sharper but not surer. The result then is that of
  // the kept round, with its matches, and counts the rounds. It is the same on any thread. Throws
  // InputError where the query's photograph cannot be read or does not have its camera's size.
  void Improve(const Query& query, const PoseEstimator& estimator, QueryResult& result,
               double min_confidence = 0) const;
  // Does the same with a photograph in memory, gray or RGB.
  void Improve(const Query& query, const Image& photograph, const PoseEstimator& estimator,
               QueryResult& result, double min_confidence = 0) const;

 private:
  MeshSource source_;
  FrameRenderer renderer_;
  std::filesystem::path query_images_;
  RerenderOptions options_;
};

}  // namespace raylift
