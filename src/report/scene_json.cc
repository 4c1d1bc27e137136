#include "report/scene_json.h"

#include <algorithm>
#include <cmath>
#include <span>

#include "base/bytes.h"
#include "lifting/source_view.h"
#include "report/page.h"
#include "surfaces/resampled_mesh.h"

#include "raylift/base/text.h"

namespace raylift {
namespace {

using Json = nlohmann::ordered_json;

// A page of a few MB shows them at once.
constexpr size_t kMeshTriangles = 60'000;
constexpr int kPointsPerImage = 1600;

// Returns short numbers: five digits are plenty for a drawing.
Json RoundedJson(const Eigen::Vector3d& v) {
  Json json = Json::array();
  for (const double value : {v.x(), v.y(), v.z()}) {
    json.push_back(std::round(value * 1e5) / 1e5);
  }
  return json;
}

}  // namespace

std::vector<ScenePoint> PointsOf(const PosedImage& view, const DepthMap& depth,
                                 const Image& picture) {
  const Rigid3 world_from_cam = view.cam_from_world.Inverse();
  std::vector<ScenePoint> points;
  for (const Eigen::Vector2d& pixel : GridPixels(view.camera, kPointsPerImage)) {
    const float z = depth.At(static_cast<int>(pixel.x()), static_cast<int>(pixel.y()));
    const auto ray = view.camera.RayInCam(pixel);
    if (!(z > 0) || !ray || !(ray->z() > 0)) continue;
    const int x = std::min(picture.width_px - 1,
                           static_cast<int>(pixel.x() * picture.width_px / view.camera.width_px()));
    const int y = std::min(picture.height_px - 1, static_cast<int>(pixel.y() * picture.height_px /
                                                                   view.camera.height_px()));
    const uint8_t* color = picture.Pixel(x, y);
    points.push_back({world_from_cam * (*ray * (static_cast<double>(z) / ray->z())),
                      {color[0], color[1], color[2]}});
  }
  return points;
}

void SceneJson::AddPoints(std::span<const ScenePoint> points) {
  for (const ScenePoint& point : points) {
    points_.push_back(point.point_in_world);
    for (const uint8_t channel : point.color_rgb) colors_ += static_cast<char>(channel);
  }
}

void SceneJson::AddCamera(const std::string& kind, const PosedImage& image,
                          const std::optional<Eigen::Vector3d>& from) {
  cameras_.push_back({kind, image.name, image.cam_from_world,
                      static_cast<double>(image.camera.height_px()) / image.camera.width_px(),
                      from});
}

void SceneJson::AddCamera(const std::string& kind, const std::string& name,
                          const Rigid3& cam_from_world,
                          const std::optional<Eigen::Vector3d>& from) {
  constexpr double kUsualRatio = 0.75;
  cameras_.push_back({kind, name, cam_from_world, kUsualRatio, from});
}

void SceneJson::AddMesh(const TriangleMesh& mesh) {
  if (mesh.triangles.empty()) return;
  // The colors of the corners say little of large triangles with a texture.
  const bool is_coarse = mesh.triangles.size() < kMeshTriangles && !mesh.textures.empty();
  const double edge = std::sqrt(AreaOf(mesh) / kMeshTriangles);
  mesh_ = DecimatedMesh(is_coarse && edge > 0 ? SplitLongEdges(mesh, edge) : mesh, kMeshTriangles);
}

Json SceneJson::MeshJson(const Eigen::Vector3d& origin) const {
  std::string floats, colors, corners;
  for (size_t i = 0; i < mesh_.vertices.size(); ++i) {
    const Eigen::Vector3f place =
        (mesh_.VertexInWorld(static_cast<uint32_t>(i)) - origin).cast<float>();
    floats += AsBytes(std::span(place.data(), 3));
    const std::array<uint8_t, 3> color = mesh_.vertex_colors_rgb.empty()
                                             ? std::array<uint8_t, 3>{190, 190, 190}
                                             : mesh_.vertex_colors_rgb[i];
    colors += AsBytes(std::span(color));
  }
  for (const auto& triangle : mesh_.triangles) corners += AsBytes(std::span(triangle));
  return {{"vertices", EncodeBase64(floats)},
          {"colors", EncodeBase64(colors)},
          {"triangles", EncodeBase64(corners)}};
}

Json SceneJson::Build() const {
  const Eigen::Vector3d origin =
      cameras_.empty() ? Eigen::Vector3d::Zero() : cameras_.front().cam_from_world.OriginInSource();
  std::string floats;
  for (const Eigen::Vector3d& point : points_) {
    const Eigen::Vector3f relative = (point - origin).cast<float>();
    floats += AsBytes(std::span(relative.data(), 3));
  }
  Eigen::Vector3d up = Eigen::Vector3d::Zero();
  nlohmann::ordered_json cameras = nlohmann::ordered_json::array();
  for (const Camera3D& camera : cameras_) {
    const Eigen::Matrix3d axes = camera.cam_from_world.rotation.toRotationMatrix();
    up -= axes.row(1).transpose();
    nlohmann::ordered_json json = {
        {"kind", camera.kind},
        {"name", camera.name},
        {"center", RoundedJson(camera.cam_from_world.OriginInSource() - origin)},
        {"axes",
         {RoundedJson(axes.row(0).transpose()), RoundedJson(axes.row(1).transpose()),
          RoundedJson(axes.row(2).transpose())}},
        {"ratio", camera.ratio}};
    if (camera.from) json["from"] = RoundedJson(*camera.from - origin);
    cameras.push_back(std::move(json));
  }
  if (!(up.norm() > 0)) up = Eigen::Vector3d::UnitZ();
  up.normalize();
  const Eigen::Vector3d first = up.unitOrthogonal();
  Json scene = {{"points", EncodeBase64(floats)},
                {"colors", EncodeBase64(colors_)},
                {"cameras", cameras},
                {"up", {RoundedJson(first), RoundedJson(up.cross(first)), RoundedJson(up)}}};
  if (!mesh_.triangles.empty()) scene["mesh"] = MeshJson(origin);
  return scene;
}

}  // namespace raylift
