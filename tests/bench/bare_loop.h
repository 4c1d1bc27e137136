// The fastest loop that Embree allows, with nothing around it: pinhole rays in float,
// rtcIntersect16 on 4 x 4 pixels in 8 x 8 tiles with the coherent flag, the depth stored. What
// renderers are compared with.

#pragma once

#include <memory>
#include <vector>

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/renderers/triangle_mesh.h"

namespace raylift {

class BareLoop {
 public:
  enum class SceneFlag { kNone, kRobust };

  // `mesh` must outlive the loop; its vertices must have room for one more.
  BareLoop(const TriangleMesh& mesh, SceneFlag flag);
  ~BareLoop();

  // A pinhole camera whose sides are multiples of 8; depth is infinite where nothing is hit.
  void Render(const Camera& camera, const Rigid3& cam_from_world, std::vector<float>& depth) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace raylift
