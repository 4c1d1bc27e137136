#include "surfaces/surface_samples.h"

#include <algorithm>

#include "base/rng.h"
#include <Eigen/Geometry>

namespace raylift {

std::vector<SurfaceSample> SampleSurface(const TriangleMesh& mesh, size_t count, uint64_t seed) {
  std::vector<double> area_up_to;  // of the triangles, summed up, twice
  area_up_to.reserve(mesh.triangles.size());
  double area = 0;
  for (const auto& [a, b, c] : mesh.triangles) {
    const Eigen::Vector3f cross =
        (mesh.vertices[b] - mesh.vertices[a]).cross(mesh.vertices[c] - mesh.vertices[a]);
    area += cross.cast<double>().norm();
    area_up_to.push_back(area);
  }
  std::vector<SurfaceSample> samples;
  if (!(area > 0)) return samples;
  Rng rng(StreamSeed(seed, "surface", "samples"));
  for (size_t i = 0; i < count; ++i) {
    const auto at =
        std::upper_bound(area_up_to.begin(), area_up_to.end() - 1, rng.Uniform() * area);
    const auto& [a, b, c] = mesh.triangles[static_cast<size_t>(at - area_up_to.begin())];
    double u = rng.Uniform();
    double v = rng.Uniform();
    if (u + v > 1) {
      u = 1 - u;
      v = 1 - v;
    }
    const Eigen::Vector3d origin = mesh.VertexInWorld(a);
    const Eigen::Vector3d ab = mesh.VertexInWorld(b) - origin;
    const Eigen::Vector3d ac = mesh.VertexInWorld(c) - origin;
    samples.push_back({origin + u * ab + v * ac, ab.cross(ac).normalized()});
  }
  return samples;
}

}  // namespace raylift
