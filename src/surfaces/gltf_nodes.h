// The tree of a glTF file's nodes: which meshes are shown, and where.

#pragma once

#include <cstddef>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "surfaces/gltf_file.h"
#include <Eigen/Geometry>

namespace raylift {

// A mesh of the file where a node (or an instance of it) puts it.
struct GltfInstance {
  size_t index;
  Eigen::Affine3d root_from_mesh;
  std::string name;  // PartName()
};

// Returns the meshes of the shown scene in the order of its tree, those of instanced nodes
// (EXT_mesh_gpu_instancing) once for each, and all of them for each of `copies`, if there are any.
// `z_up_from_gltf`: of CESIUM_RTC's axes. Throws InputError where nodes are no tree or too many.
std::vector<GltfInstance> PlaceMeshes(const std::filesystem::path& path, GltfFile& file,
                                      const Eigen::Matrix3d& z_up_from_gltf,
                                      std::span<const Eigen::Affine3d> copies);

[[noreturn]] void FailOfManyMeshes(const std::filesystem::path& path);

}  // namespace raylift
