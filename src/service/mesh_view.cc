#include "service/mesh_view.h"

#include <algorithm>

#include "io/text/json_document.h"
#include "pictures/picture_codec.h"
#include "service/localize_request.h"
#include "service/problem.h"

#include "raylift/io/query_list.h"
#include "raylift/renderers/frame_renderer.h"

namespace raylift {
namespace {

// Reads a rotation as "qvec" has it: of length 1, but for rounding.
Eigen::Quaterniond ReadRotation(const JsonPlace& qvec) {
  const Eigen::Vector4d q = qvec.Vector<4>();
  if (!(q.norm() > 0.99 && q.norm() < 1.01)) qvec.Fail("expected a quaternion of length 1");
  return Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized();
}

Camera Shrunk(const Camera& camera) {
  constexpr int kMaxSidePx = 960;
  const double longest = std::max(camera.width_px(), camera.height_px());
  const double factor = std::min(1.0, kMaxSidePx / longest);
  const auto side = [&](int px) { return std::max(1, static_cast<int>(factor * px)); };
  return camera.Scaled(side(camera.width_px()), side(camera.height_px()));
}

}  // namespace

ViewRequest ReadViewRequest(std::string_view body) {
  CheckJson(body);
  const JsonDocument document(body, "body");
  const JsonPlace json = document.Root();
  json.ExpectMembers({"camera", "cam_from_world"});
  const JsonPlace camera = json.Member("camera"), pose = json.Member("cam_from_world"),
                  qvec = pose.Member("qvec"), tvec = pose.Member("tvec");
  Query query;
  InField("body", [&] { TakeCamera(camera.String(), query); });
  return {query.camera, Rigid3(ReadRotation(qvec), tvec.Vector<3>())};
}

std::string RenderView(const ViewRequest& view, const Scene& scene) {
  const auto surface = scene.Surface();
  if (!surface) throw Problem(404, "scene", "scene: has no mesh or cloud to be seen");
  constexpr int kQuality = 85;
  ColorOptions colors = PictureColors(*surface);
  colors.samples_per_pixel_side = 2;
  return EncodeJpeg(RenderColor(*surface, Shrunk(view.camera), view.cam_from_world, colors, 1),
                    kQuality);
}

}  // namespace raylift
