#include <span>
#include <vector>

#include "base/hash.h"

#include "raylift/renderers/ray_caster.h"

namespace raylift {
namespace {

// Hashes vectors of plain values.
class VectorHasher {
 public:
  explicit VectorHasher(int threads) : threads_(threads) {}

  template <typename T>
  uint64_t operator()(const std::vector<T>& values) const {
    return HashLarge(AsBytes(std::span<const T>(values)), threads_);
  }
  uint64_t operator()(const Eigen::Vector3d& v) const {
    return HashBytes64(AsBytes(std::span<const double>(v.data(), 3)));
  }

 private:
  int threads_;
};

uint64_t HashOf(const TriangleMesh& mesh, const VectorHasher& hash_of) {
  std::vector<uint64_t> parts = {hash_of(mesh.origin_in_world),     hash_of(mesh.vertices),
                                 hash_of(mesh.triangles),           hash_of(mesh.vertex_colors_rgb),
                                 hash_of(mesh.texture_coordinates), hash_of(mesh.triangle_textures),
                                 hash_of(mesh.triangle_faces),      hash_of(mesh.object_begins)};
  for (const Image& texture : mesh.textures) {
    parts.push_back(hash_of(texture.data));
    parts.push_back(static_cast<uint64_t>(texture.width_px));
  }
  return hash_of(parts);
}

uint64_t HashOf(const Surfels& surfels, const VectorHasher& hash_of) {
  return hash_of(std::vector<uint64_t>{hash_of(surfels.origin_in_world), hash_of(surfels.discs),
                                       hash_of(surfels.normals), hash_of(surfels.sigmas),
                                       hash_of(surfels.colors_rgb)});
}

uint64_t HashOf(const Splats& splats, SplatDepth depth, const VectorHasher& hash_of) {
  const Eigen::Matrix3d& turn = splats.harmonics_from_world;
  return hash_of(std::vector<uint64_t>{
      hash_of(splats.origin_in_world), hash_of(splats.means), hash_of(splats.rotations),
      hash_of(splats.scales), hash_of(splats.opacities), hash_of(splats.harmonics),
      static_cast<uint64_t>(splats.degree), static_cast<uint64_t>(depth),
      hash_of(std::vector<double>(turn.data(), turn.data() + turn.size()))});
}

}  // namespace

uint64_t SurfaceHash(const RayCaster& scene, int threads) {
  const VectorHasher hash_of(threads);
  if (const Splats* splats = scene.splats()) return HashOf(*splats, scene.splat_depth(), hash_of);
  const Surfels* surfels = scene.surfels();
  return surfels != nullptr ? HashOf(*surfels, hash_of) : HashOf(scene.mesh(), hash_of);
}

}  // namespace raylift
