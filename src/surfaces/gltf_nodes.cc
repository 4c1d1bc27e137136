#include <algorithm>
#include <utility>

#include "base/read_limits.h"
#include "surfaces/gltf_file.h"
#include "surfaces/raw_mesh.h"
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

using Eigen::Affine3d;

// Returns translation * rotation (x, y, z, w) * scale.
Affine3d PlaceOf(const Eigen::Vector3d& translation, const Eigen::Vector4d& rotation,
                 const Eigen::Vector3d& scale) {
  return Affine3d(Eigen::Translation3d(translation))
      .rotate(Eigen::Quaterniond(rotation).normalized())
      .scale(scale);
}

Affine3d PlaceOf(const JsonPlace& node) {
  Affine3d parent_from_node = Affine3d::Identity();
  if (node.Has("matrix")) {  // by columns
    const JsonPlace matrix = node.Member("matrix");
    parent_from_node.matrix() = matrix.Vector<16>().reshaped(4, 4);
    return parent_from_node;
  }
  return PlaceOf(VectorOr<3>(node, "translation", {0, 0, 0}),
                 VectorOr<4>(node, "rotation", {0, 0, 0, 1}),
                 VectorOr<3>(node, "scale", {1, 1, 1}));
}

class NodePlacer {
 public:
  NodePlacer(const std::filesystem::path& path, GltfFile& file,
             const Eigen::Matrix3d& z_up_from_gltf)
      : path_(path), file_(file), z_up_from_gltf_(z_up_from_gltf) {}

  std::vector<GltfInstance> Place() {
    PlaceScene(RootFromScene());
    return std::move(placed_);
  }

 private:
  Affine3d RootFromScene() const {
    Eigen::Vector3d center = Eigen::Vector3d::Zero();  // in axes of which z is up
    IfThere(file_.root(), {"extensions", "CESIUM_RTC"}, [&](const JsonPlace& rtc) {
      center = VectorOr<3>(rtc, "center", {0, 0, 0});
    });
    return Affine3d(Eigen::Translation3d(z_up_from_gltf_.transpose() * center));
  }

  // Adds meshes in the order of the tree.
  void PlaceScene(const Affine3d& root_from_scene) {
    is_placed_.assign(file_.CountItems("nodes"), false);
    if (file_.CountItems("scenes") == 0) return PlaceRoots(root_from_scene);
    size_t shown = 0;
    IfThere(file_.root(), {"scene"},
            [&](const JsonPlace& scene) { shown = file_.Index("scenes", scene); });
    const JsonPlace scene = file_.Item("scenes", shown);
    PlaceNodes(scene, "nodes", {root_from_scene, ""}, 0);
  }

  // A file without scenes shows each node that is no other's child.
  void PlaceRoots(const Affine3d& root_from_scene) {
    std::vector<bool> is_child(is_placed_.size());
    for (size_t i = 0; i < is_child.size(); ++i) {
      const JsonPlace node = file_.Item("nodes", i);
      IfThere(node, {"children"}, [&](const JsonPlace& children) {
        for (size_t k = 0; k < children.ArraySize(); ++k) {
          is_child[file_.Index("nodes", children.At(k))] = true;
        }
      });
    }
    for (size_t i = 0; i < is_child.size(); ++i) {
      if (!is_child[i]) PlaceNode(i, {root_from_scene, ""}, 0);
    }
  }

  // The nodes above one.
  struct Above {
    Affine3d root_from_parent;
    std::string name;  // PartName()
  };

  void PlaceNodes(const JsonPlace& parent, std::string_view member, const Above& above,
                  size_t depth) {
    IfThere(parent, {member}, [&](const JsonPlace& nodes) {
      if (depth > kMaxGltfNodeNesting) {
        nodes.Fail(fmt::format("they are nested more than {} deep", kMaxGltfNodeNesting));
      }
      for (size_t i = 0; i < nodes.ArraySize(); ++i) {
        const JsonPlace index = nodes.At(i);
        const size_t node = file_.Index("nodes", index);
        if (is_placed_[node]) index.Fail("a node is the child of two");
        PlaceNode(node, above, depth);
      }
    });
  }

  void PlaceNode(size_t index, const Above& above, size_t depth) {
    is_placed_[index] = true;
    const JsonPlace node = file_.Item("nodes", index);
    const Affine3d root_from_node = above.root_from_parent * PlaceOf(node);
    const std::string name =
        PartName(above.name,
                 node.Has("name") ? node.Member("name").String() : fmt::format("nodes[{}]", index));
    IfThere(node, {"mesh"}, [&](const JsonPlace& mesh) {
      const size_t number = file_.Index("meshes", mesh);
      const std::vector<Affine3d> instances = Instances(node);
      for (size_t i = 0; i < instances.size(); ++i) {
        if (placed_.size() >= kMaxPlacedMeshes) FailOfManyMeshes(path_);
        placed_.push_back({number, root_from_node * instances[i],
                           instances.size() > 1 ? fmt::format("{}[{}]", name, i) : name});
      }
    });
    PlaceNodes(node, "children", {root_from_node, name}, depth + 1);
  }

  // Returns the places of a node's mesh by EXT_mesh_gpu_instancing; without that it stands once,
  // where the node is.
  std::vector<Affine3d> Instances(const JsonPlace& node) {
    std::vector<Affine3d> places = {Affine3d::Identity()};
    IfThere(
        node, {"extensions", "EXT_mesh_gpu_instancing", "attributes"},
        [&](const JsonPlace& attributes) {
          const VertexNumbers translations = file_.ReadAttribute(attributes, "TRANSLATION", 3);
          const VertexNumbers rotations = file_.ReadAttribute(attributes, "ROTATION", 4);
          const VertexNumbers scales = file_.ReadAttribute(attributes, "SCALE", 3);
          const size_t count = std::max({translations.count(), rotations.count(), scales.count()});
          for (const VertexNumbers* numbers : {&translations, &rotations, &scales}) {
            if (numbers->count() != 0 && numbers->count() != count) {
              attributes.Fail("expected as many of each");
            }
          }
          places.clear();
          for (size_t i = 0; i < count; ++i) {
            places.push_back(PlaceOf(ItemOr<3>(translations, i, {0, 0, 0}),
                                     ItemOr<4>(rotations, i, {0, 0, 0, 1}),
                                     ItemOr<3>(scales, i, {1, 1, 1})));
          }
        });
    return places;
  }

  template <int N>
  static Eigen::Matrix<double, N, 1> ItemOr(const VertexNumbers& numbers, size_t index,
                                            const Eigen::Matrix<double, N, 1>& missing) {
    return numbers.count() == 0 ? missing : ItemOf<N>(numbers, index);
  }

  const std::filesystem::path path_;
  GltfFile& file_;
  const Eigen::Matrix3d z_up_from_gltf_;
  std::vector<bool> is_placed_;  // each node
  std::vector<GltfInstance> placed_;
};

std::vector<GltfInstance> Copied(const std::filesystem::path& path,
                                 std::span<const GltfInstance> scene,
                                 std::span<const Affine3d> copies) {
  if (scene.size() * copies.size() > kMaxPlacedMeshes) FailOfManyMeshes(path);
  std::vector<GltfInstance> placed;
  for (size_t i = 0; i < copies.size(); ++i) {
    for (const GltfInstance& mesh : scene) {
      placed.push_back({mesh.index, copies[i] * mesh.root_from_mesh,
                        PartName(fmt::format("[{}]", i), mesh.name)});
    }
  }
  return placed;
}

}  // namespace

void FailOfManyMeshes(const std::filesystem::path& path) {
  throw InputError(path, fmt::format("its nodes and instances place more than {} meshes, or {} "
                                     "vertices and triangles",
                                     kMaxPlacedMeshes, kMaxPlacedParts));
}

std::vector<GltfInstance> PlaceMeshes(const std::filesystem::path& path, GltfFile& file,
                                      const Eigen::Matrix3d& z_up_from_gltf,
                                      std::span<const Affine3d> copies) {
  std::vector<GltfInstance> placed = NodePlacer(path, file, z_up_from_gltf).Place();
  return copies.empty() ? placed : Copied(path, placed, copies);
}

}  // namespace raylift
