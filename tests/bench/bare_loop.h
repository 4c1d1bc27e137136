// The fastest loops that Embree allows, with nothing around them. What renderers are compared with:
// pinhole rays in float, rtcIntersect16 on 4 x 4 pixels in 8 x 8 tiles with the coherent flag, the
// depth stored. What lifting is compared with: rtcIntersect1, the length of the ray stored.

#pragma once

#include <memory>
#include <span>
#include <vector>

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/surfaces/triangle_mesh.h"

namespace raylift {

struct BareRay {
  Eigen::Vector3f origin;
  Eigen::Vector3f direction;
};

class BareLoop {
 public:
  enum class SceneFlag { kNone, kRobust };

  // `mesh` must outlive the loop; its vertices must have room for one more.
  BareLoop(const TriangleMesh& mesh, SceneFlag flag);
  ~BareLoop();

  // A pinhole camera whose sides are multiples of 8; depth is infinite where nothing is hit.
  void Render(const Camera& camera, const Rigid3& cam_from_world, std::vector<float>& depth) const;

  // One ray after the other, in the given order; ray_t is infinite where nothing is hit.
  void Cast(std::span<const BareRay> rays, std::span<float> ray_t) const;
  // The same, and makes the rays of a pinhole camera's pixels.
  void CastPixels(const Camera& camera, const Rigid3& cam_from_world,
                  std::span<const Eigen::Vector2d> pixels, std::span<float> ray_t) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace raylift
