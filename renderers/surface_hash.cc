#include "raylift/renderers/surface_hash.h"

#include <span>
#include <vector>

#include "raylift/base/hash.h"

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

}  // namespace

uint64_t SurfaceHash(const RayCaster& scene, int threads) {
  const VectorHasher hash_of(threads);
  const Surfels* surfels = scene.surfels();
  return surfels != nullptr ? HashOf(*surfels, hash_of) : HashOf(scene.mesh(), hash_of);
}

}  // namespace raylift
