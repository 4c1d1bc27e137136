// Opens the mesh, point cloud or splats that a job renders, by specifications of geometry.

#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "raylift/renderers/ray_caster.h"

namespace raylift {

struct MeshScene {
  std::shared_ptr<const RayCaster> caster;
  std::vector<std::string> warnings;
  double read_s = 0;
  double build_s = 0;
  size_t mesh_bytes = 0;
  size_t tree_bytes = 0;  // what the rays are traced through
};

struct MeshSceneOptions {
  int threads = 0;                       // to read the files; <= 0: all
  std::filesystem::path semantics = {};  // file of a table (ReadSemanticRules()); empty: none
  // Is called with the present step ("reading a.ply", "building, 40 %"), from any thread, one call
  // at a time.
  std::function<void(const std::string&)> on_step = {};
};

// Loads "mesh:PATH[,build=low|medium]" (by default medium) of one or several meshes, all of which
// are one scene, or a single "cloud:PATH" or "splat:FILE". Throws OptionError for a specification
// that is wrong or contradicts another one, InputError where a file cannot be read or is no mesh.
MeshScene LoadMeshScene(const std::vector<std::string>& specs,
                        const MeshSceneOptions& options = {});

}  // namespace raylift
