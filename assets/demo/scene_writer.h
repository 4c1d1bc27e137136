// Writes what every made scene has: the mesh as OBJ with its textures, and models.

#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "mesh_builder.h"

#include "raylift/renderers/ray_caster.h"
#include "raylift/scene/photographs.h"

namespace raylift::demo {

struct TexturedScene {
  std::vector<std::string> texture_names;
  std::vector<Image> textures;
  MeshBuilder mesh;
};

// scene.obj, scene.mtl and one JPEG per texture. `origin` is added to all vertices.
void WriteScene(const std::filesystem::path& folder, const TexturedScene& scene,
                const std::string& title, const Eigen::Vector3d& origin = Eigen::Vector3d::Zero());

// Takes the photographs of references, in the morning, and of queries, in the afternoon, and prints
// their names. Poses are those in the mesh's frame.
void TakeReferences(const std::filesystem::path& images, const RayCaster& caster,
                    const std::vector<PosedImage>& views, uint64_t seed, int samples_per_side);
// With changing exposures; the last two in bad conditions, dark and shaken.
void TakeQueries(const std::filesystem::path& images, const RayCaster& caster,
                 const std::vector<PosedImage>& views, uint64_t seed, int samples_per_side);

// Names and cameras.
void WriteQueries(const std::filesystem::path& list, const std::vector<PosedImage>& views);
// A COLMAP text model without points.
void WriteViews(const std::filesystem::path& folder, const std::vector<PosedImage>& views);

}  // namespace raylift::demo
