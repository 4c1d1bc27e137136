// Points and cameras for the page's 3D view.

#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <nlohmann/json.hpp>

#include "raylift/scene/image.h"
#include "raylift/scene/photographs.h"
#include "raylift/surfaces/triangle_mesh.h"

namespace raylift {

struct ScenePoint {
  Eigen::Vector3d point_in_world;
  std::array<uint8_t, 3> color_rgb;
};

// Returns points of a depth map on a grid over the image, colored by a picture of the same view, of
// any size.
std::vector<ScenePoint> PointsOf(const PosedImage& view, const DepthMap& depth,
                                 const Image& picture);

class SceneJson {
 public:
  void AddPoints(std::span<const ScenePoint> points);
  // Adds a camera. `kind`: "reference", "true", "estimated", or a verdict. `from`: the start of a
  // line to the camera.
  void AddCamera(const std::string& kind, const PosedImage& image,
                 const std::optional<Eigen::Vector3d>& from = std::nullopt);
  // Adds a coarse copy of the mesh, of the colors of its vertices or gray.
  void AddMesh(const TriangleMesh& mesh);
  // Adds a camera without intrinsics.
  void AddCamera(const std::string& kind, const std::string& name, const Rigid3& cam_from_world,
                 const std::optional<Eigen::Vector3d>& from = std::nullopt);

  // Returns the JSON. Coordinates are relative to the first camera, so that float is enough for any
  // world.
  nlohmann::ordered_json Build() const;

 private:
  nlohmann::ordered_json MeshJson(const Eigen::Vector3d& origin) const;

  struct Camera3D {
    std::string kind, name;
    Rigid3 cam_from_world;
    double ratio;  // of height to width
    std::optional<Eigen::Vector3d> from;
  };
  std::vector<Eigen::Vector3d> points_;
  std::string colors_;
  std::vector<Camera3D> cameras_;
  TriangleMesh mesh_;  // small
};

}  // namespace raylift
