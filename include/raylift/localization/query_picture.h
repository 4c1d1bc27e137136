// A picture to judge a pose by: the photograph beside the mesh as seen from the estimated pose,
// with the inliers drawn in both.

#pragma once

#include "raylift/localization/localizer.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/scene/image.h"

namespace raylift {

// The query must be localized and `photograph` be its RGB image. Keypoints of 2D-3D inliers are
// drawn in the photograph, their 3D points projected by the estimated pose in the rendering: both
// are at the same place where the pose is right.
Image DrawQueryPicture(const QueryResult& result, const Image& photograph, const RayCaster& mesh,
                       int threads);

}  // namespace raylift
