// Mesh.

#include <limits>

#include "apps/python/conversions.h"
#include "apps/python/geometry_source.h"
#include "lifting/mesh_spec.h"

#include "raylift/surfaces/mesh_files.h"

namespace raylift::python {
namespace {

std::shared_ptr<TriangleMesh> MeshFromArrays(const ArrayLike& vertices, const ArrayLike& triangles,
                                             const std::optional<ArrayLike>& colors) {
  const Rows<3> positions(vertices, "vertices");
  const Rows<3, int64_t> corners(triangles, "triangles");
  std::vector<std::array<uint8_t, 3>> vertex_colors = ToColors(colors, "colors");
  std::vector<std::array<uint32_t, 3>> indices(corners.size());
  for (size_t i = 0; i < indices.size(); ++i) {
    for (size_t k = 0; k < 3; ++k) {
      const int64_t index = corners[i][static_cast<Eigen::Index>(k)];
      // A number that is not an index of a vertex in 32 bits either is reported as the largest one.
      constexpr int64_t kMost = std::numeric_limits<uint32_t>::max();
      indices[i][k] = static_cast<uint32_t>(index < 0 || index > kMost ? kMost : index);
    }
  }
  auto position_vector = positions.ToVector();
  return WithoutLock([&] {
    return std::make_shared<TriangleMesh>(
        MakeMesh(std::move(position_vector), std::move(indices), std::move(vertex_colors)));
  });
}

// Reads "mesh:...", as the option --geometry takes it, or files alone.
std::shared_ptr<TriangleMesh> ReadMeshOf(const std::string& files_or_spec, int threads) {
  return WithoutLock([&] {
    const MeshSpec spec = IsMeshSpec(files_or_spec) ? ParseMeshSpec(files_or_spec, MeshUse::kRender)
                                                    : MeshSpec{.files = files_or_spec};
    return std::make_shared<TriangleMesh>(OpenMesh(spec, threads));
  });
}

// Returns a view of memory that `owner` keeps alive; not to be written to.
template <typename T>
py::array_t<T> View(const T* data, const std::vector<py::ssize_t>& shape, const py::object& owner) {
  py::array_t<T> array(shape, data, owner);
  py::detail::array_proxy(array.ptr())->flags &= ~py::detail::npy_api::NPY_ARRAY_WRITEABLE_;
  return array;
}

// Calls a function with each list of numbers of a mesh.
template <typename Mesh, typename Function>
void ForEachList(Mesh& mesh, const Function& function) {
  function(mesh.vertices);
  function(mesh.triangles);
  function(mesh.vertex_colors_rgb);
  function(mesh.texture_coordinates);
  function(mesh.triangle_textures);
  function(mesh.triangle_faces);
  function(mesh.object_begins);
  function(mesh.triangle_labels);
}

using LabelState = std::tuple<uint32_t, py::bytes, py::bytes, uint32_t, py::bytes>;

// Returns the origin, the textures, the warnings, the lists of numbers, the labels and the number
// of instances.
py::tuple MeshState(const TriangleMesh& mesh) {
  py::list textures, lists;
  for (const Image& texture : mesh.textures) {
    textures.append(py::make_tuple(texture.width_px, texture.height_px, texture.channels,
                                   ToBytes(texture.data)));
  }
  ForEachList(mesh, [&](const auto& list) { lists.append(ToBytes(list)); });
  std::vector<LabelState> labels;
  for (const SurfaceLabel& label : mesh.labels) {
    labels.emplace_back(label.instance, label.instance_name, label.material, label.semantic,
                        label.semantic_name);
  }
  const Eigen::Vector3d& origin = mesh.origin_in_world;
  return py::make_tuple(std::array{origin.x(), origin.y(), origin.z()}, textures, mesh.warnings,
                        lists, labels, mesh.num_instances);
}

std::shared_ptr<TriangleMesh> MeshOf(const py::tuple& state) {
  auto mesh = std::make_shared<TriangleMesh>();
  const auto origin = state[0].cast<std::array<double, 3>>();
  mesh->origin_in_world = Eigen::Vector3d::Map(origin.data());
  for (const py::handle one : state[1]) {
    const auto texture = py::reinterpret_borrow<py::tuple>(one);
    Image& image = mesh->textures.emplace_back();
    image.width_px = texture[0].cast<int>();
    image.height_px = texture[1].cast<int>();
    image.channels = texture[2].cast<int>();
    FromBytes(texture[3], image.data);
  }
  mesh->warnings = state[2].cast<std::vector<std::string>>();
  py::ssize_t next = 0;
  const py::list lists = state[3];
  ForEachList(*mesh, [&](auto& list) { FromBytes(lists[next++], list); });
  for (const auto& [instance, name, material, semantic, semantic_name] :
       state[4].cast<std::vector<LabelState>>()) {
    mesh->labels.push_back(
        {instance, std::string(name), std::string(material), semantic, std::string(semantic_name)});
  }
  mesh->num_instances = state[5].cast<uint32_t>();
  return mesh;
}

}  // namespace

void BindMesh(py::module_& module) {
  py::class_<TriangleMesh, std::shared_ptr<TriangleMesh>> bound(module, "Mesh", "A triangle mesh.");
  bound
      .def(py::init(&MeshFromArrays), py::arg("vertices"), py::arg("triangles"),
           py::arg("colors") = py::none(),
           "From vertices (N, 3) in the world, triangles (M, 3) of indices and, where there are "
           "any,\n"
           "the vertices' colors (N, 3), uint8.\n\n"
           "Triangles without an area are left out, as are vertices that no triangle uses. Raises\n"
           "InputError for an index out of range.")
      .def_static(
          "read",
          [](const py::object& files, int threads) {
            const bool is_text = py::isinstance<py::str>(files);
            return ReadMeshOf(
                is_text ? files.cast<std::string>()
                        : ToPath(py::reinterpret_borrow<PathLike>(files), "files").string(),
                threads);
          },
          py::arg("files"), py::kw_only(), py::arg("threads") = 0,
          "Reads PLY, OBJ, glTF, STL, ...: a file, \"a.ply+b.obj\", \"tiles/*.ply\", a folder, or\n"
          "\"mesh:PATH[,key=value...]\" as the option --geometry takes it.\n\n"
          "Raises InputError where a file cannot be read.")
      .def_property_readonly(
          "vertices",
          [](const TriangleMesh& mesh) {
            return MakeRows(mesh.vertices.size(), 3,
                            [&](size_t i) { return mesh.VertexInWorld(static_cast<uint32_t>(i)); });
          },
          "(N, 3) in the world; a copy, as they are held in float around an origin.")
      .def_property_readonly(
          "triangles",
          [](TriangleMesh& mesh) {
            return View(mesh.triangles.empty() ? nullptr : mesh.triangles.front().data(),
                        {std::ssize(mesh.triangles), 3}, py::cast(&mesh));
          },
          "(M, 3), uint32: indices of vertices. A view.")
      .def_property_readonly(
          "colors",
          [](TriangleMesh& mesh) -> std::optional<py::array_t<uint8_t>> {
            if (mesh.vertex_colors_rgb.empty()) return std::nullopt;
            return View(mesh.vertex_colors_rgb.front().data(),
                        {std::ssize(mesh.vertex_colors_rgb), 3}, py::cast(&mesh));
          },
          "The vertices' colors (N, 3), uint8, or None. A view.")
      .def_property_readonly("has_texture",
                             [](const TriangleMesh& mesh) { return !mesh.textures.empty(); })
      .def_readonly("warnings", &TriangleMesh::warnings,
                    "What its reader has to say: triangles left out, a texture that is missing.")
      .def("__repr__",
           [](const TriangleMesh& mesh) {
             return fmt::format("<raylift.Mesh {} vertices, {} triangles>", mesh.vertices.size(),
                                mesh.triangles.size());
           })
      .def(
          "_repr_png_",
          [](TriangleMesh& mesh) {
            return PictureOf(*MakeCaster(py::cast(&mesh).cast<std::shared_ptr<TriangleMesh>>(),
                                         RayCasterOptions::BuildQuality::kLow));
          },
          "A picture of it from outside.");
  BindState(bound, &MeshState, &MeshOf);
}

}  // namespace raylift::python
