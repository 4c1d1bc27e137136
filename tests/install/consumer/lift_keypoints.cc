#include <cstdio>
#include <memory>

#include <raylift/lifting/mesh_source.h>

int main() {
  // A square of 2 x 2 before the camera; raylift::ReadMesh(path) reads a file.
  auto mesh = std::make_shared<raylift::TriangleMesh>();
  mesh->vertices = {{-1, -1, 5}, {1, -1, 5}, {1, 1, 5}, {-1, 1, 5}};
  mesh->triangles = {{0, 2, 1}, {0, 3, 2}};
  const raylift::MeshSource source("square", std::make_shared<raylift::RayCaster>(mesh));

  const double f_cx_cy[] = {500, 320, 240};
  raylift::PosedImage photograph;  // taken at the origin, along z
  photograph.camera = {raylift::CameraModel::kSimplePinhole, 640, 480, f_cx_cy};
  const Eigen::Vector2d keypoints_px[] = {{345, 265}, {370, 215}, {10, 10}};
  for (const auto& surface : source.Lift(photograph, keypoints_px)) {
    if (surface) {
      const Eigen::Vector3d point = surface->point_in_world;
      std::printf("(%.2f, %.2f, %.2f)\n", point.x(), point.y(), point.z());
    } else {
      std::puts("no surface");
    }
  }
}
