// Scenes: references, and the geometry that their keypoints are lifted by.

#include "raylift/localization/scene.h"

#include <algorithm>

#include "apps/python/geometry_source.h"
#include "io/map/packed_map.h"
#include "lifting/mesh_spec.h"

#include "raylift/base/error.h"
#include "raylift/geometry/geodesy.h"
#include "raylift/io/scene_file.h"
#include "raylift/localization/scene_calibration.h"

namespace raylift::python {
namespace {

using ScenePointer = std::shared_ptr<Scene>;
using SourceList = std::vector<GeometryLike>;

// Returns whether the source's text tells all of it: it was opened from the text, is not corrected,
// and is of no model that is thinned out or was in memory.
bool HasText(const Scene& scene, const SceneSource& source) {
  if (source.spec.ends_with(kFromMemory) || source.as_read != nullptr) return false;
  if (source.geometry.kind != GeometryKind::kSfm) return true;
  const ReferenceSet& references = scene.references;
  return references.thinned_out.empty() &&
         (references.model.empty() || std::filesystem::exists(references.model));
}

// Returns a scene's source as one that was opened by itself.
std::shared_ptr<Geometry> GeometryOf(const Scene& scene, const SceneSource& source) {
  if (!HasText(scene, source)) return std::make_shared<Geometry>(source.geometry);
  const bool has_context =
      source.geometry.kind == GeometryKind::kDepth || source.geometry.kind == GeometryKind::kSfm;
  if (!has_context) {
    return std::make_shared<Geometry>(source.geometry, source.spec, GeometryContext());
  }
  const GeometryContext context{.model = scene.references.model,
                                .references = scene.references.images};
  return std::make_shared<Geometry>(source.geometry, source.spec, context);
}

// Returns the text by which a scene opens geometry that was opened by itself. The text of geometry
// that cannot be opened again says that it is from memory.
std::string SpecInScene(const Geometry& geometry, const Scene& scene) {
  constexpr std::string_view kSfm = "sfm";
  const std::string& spec = geometry.spec;
  if (spec.empty()) {
    const std::string description = geometry.named.source->Description();
    return description.ends_with(kFromMemory) ? description
                                              : fmt::format("{}{}", description, kFromMemory);
  }
  if (geometry.named.kind != GeometryKind::kSfm) return spec;
  const std::string rest = spec.substr(kSfm.size());
  const bool has_path = rest.size() > 1 && rest[0] == ':' && rest[1] != ',';
  if (has_path || geometry.model == scene.references.model) return spec;
  const size_t path_end = std::min(rest.find(','), rest.size());
  return fmt::format("{}:{}{}", kSfm, geometry.model.string(), rest.substr(path_end));
}

// Adds sources; texts are opened for the scene's references, as --geometry is.
void AddSources(Scene& scene, const SourceList& geometry, int threads) {
  for (const GeometryLike& one : geometry) {
    if (py::isinstance<py::str>(one)) {
      const auto spec = one.cast<std::string>();
      WithoutLock([&] { OpenGeometry(scene, spec, {.threads = threads}); });
      continue;
    }
    NamedGeometry named = ToGeometry(one);
    const std::string description = named.source->Description();
    const std::string spec = py::isinstance<Geometry>(one)
                                 ? SpecInScene(one.cast<const Geometry&>(), scene)
                                 : description;
    scene.sources.push_back({std::move(named), spec, description});
  }
}

// Returns the temporary folder into which an object that has a COLMAP model
// (pycolmap.Reconstruction, ColmapModel) has written it; None for a path, and for other objects: an
// open file writes, too.
py::object WrittenModel(const ModelLike& model) {
  if (!py::hasattr(model, "write") || py::hasattr(model, "fileno")) return py::none();
  const py::object folder = py::module_::import("tempfile").attr("TemporaryDirectory")();
  model.attr("write")(folder.attr("name"));
  return folder;
}

ScenePointer OpenModelScene(const ModelLike& model, const SourceList& geometry,
                            const std::optional<PathLike>& images, const std::string& model_poses,
                            const Subsampling& subsampling, int threads) {
  const py::object written = WrittenModel(model);
  const py::object path = written.is_none() ? py::object(model) : written.attr("name");
  SceneOptions options{.model = ToPath(py::reinterpret_borrow<PathLike>(path), "model"),
                       .model_poses = ToEnum<PoseConvention>("model_poses", model_poses),
                       .subsampling = subsampling,
                       .images = images ? ToPath(*images, "images") : std::filesystem::path(),
                       .threads = threads};
  RequireAtLeast("every", subsampling.every, 1);
  auto scene = WithoutLock([&] { return std::make_shared<Scene>(OpenScene(options)); });
  AddSources(*scene, geometry, threads);  // "sfm" reads the model's points
  if (!written.is_none()) written.attr("cleanup")();
  return scene;
}

ScenePointer MakeScene(const std::vector<PosedImageLike>& references, const SourceList& geometry,
                       const std::optional<PathLike>& images, int threads) {
  auto scene = std::make_shared<Scene>();
  scene->references.images = ToPosedImages(references);
  if (images) scene->images = ToPath(*images, "images");
  AddSources(*scene, geometry, threads);
  return scene;
}

// Returns the text that the geometry was opened from, or what it holds in memory.
py::object StateOf(const SceneSource& source) {
  if (!source.spec.ends_with(kFromMemory)) return py::str(source.spec);
  NamedGeometry as_read = source.geometry;  // its corrections are of the scene's calibration
  if (source.as_read != nullptr) as_read.source = source.as_read;
  return python::StateOf(Geometry(std::move(as_read)));
}

// Returns the references with their poses, the texts of what is read anew, and what is known of the
// scene.
py::tuple StateOf(const Scene& scene) {
  const ReferenceSet& references = scene.references;
  const bool has_model = scene.covisibility != nullptr;
  if (has_model && !std::filesystem::exists(references.model)) {
    throw InputError(
        "scene: its model was in memory; one that is opened from a folder has a state");
  }
  py::list sources;
  for (const SceneSource& source : scene.sources) sources.append(StateOf(source));
  return py::make_tuple(references.images, references.model.string(), references.thinned_out,
                        std::string(ToString(scene.model_poses)), scene.images.string(), has_model,
                        sources, scene.warnings,
                        scene.calibration ? FormatSceneCalibration(*scene.calibration) : "");
}

ScenePointer SceneOf(const py::tuple& state) {
  auto scene = std::make_shared<Scene>();
  scene->references = {state[1].cast<std::string>(), state[0].cast<std::vector<PosedImage>>(),
                       state[2].cast<std::vector<std::string>>()};
  scene->references.map = WithoutLock([&] { return OpenPackedMap(scene->references.model); });
  scene->model_poses = ToEnum<PoseConvention>("model_poses", state[3].cast<std::string>());
  scene->images = state[4].cast<std::string>();
  if (state[5].cast<bool>()) {
    scene->covisibility =
        WithoutLock([&] { return LoadReferences(scene->references.model).covisibility; });
  }
  for (const py::handle& one : state[6].cast<py::list>()) {
    if (py::isinstance<py::str>(one)) {
      const auto spec = one.cast<std::string>();
      WithoutLock([&] { OpenGeometry(*scene, spec); });
    } else {
      NamedGeometry named = python::GeometryOf(one.cast<py::tuple>()).named;
      const std::string description = named.source->Description();
      scene->sources.push_back({std::move(named), description, description});
    }
  }
  scene->warnings = state[7].cast<std::vector<std::string>>();
  const auto calibration = state[8].cast<std::string>();
  if (calibration.empty()) return scene;
  return std::make_shared<Scene>(Calibrated(
      *scene, std::make_shared<const SceneCalibration>(ParseSceneCalibration(calibration))));
}

}  // namespace

void BindScene(py::module_& module) {
  const auto no_sources = SourceList();
  py::class_<Scene, ScenePointer> bound(
      module, "Scene",
      "What photographs are localized in: references with known poses, and\n"
      "the geometry that their keypoints are lifted by.");
  bound
      .def(
          py::init([](const ModelLike& model, const SourceList& geometry,
                      const std::optional<PathLike>& images, const std::string& model_poses,
                      int every, int every_offset, bool every_per_camera, int threads) {
            return OpenModelScene(model, geometry, images, model_poses,
                                  {every, every_offset, every_per_camera}, threads);
          }),
          py::arg("model"), py::arg("geometry") = no_sources, py::kw_only(),
          py::arg("images") = py::none(), py::arg("model_poses") = "cam_from_world",
          py::arg("every") = 1, py::arg("every_offset") = 0, py::arg("every_per_camera") = false,
          py::arg("threads") = 0,
          R"(From a COLMAP model: a folder (text or binary), a pycolmap.Reconstruction or a ColmapModel.

geometry: Mesh, RayCaster, Geometry, or texts as the option --geometry takes them, asked in
order. images: folder of the references' photographs. every: only each N-th reference. Raises
InputError where a file cannot be read.)")
      .def_static("of", &MakeScene, py::arg("references"), py::arg("geometry") = no_sources,
                  py::kw_only(), py::arg("images") = py::none(), py::arg("threads") = 0,
                  "From references in memory.")
      .def_static(
          "read",
          [](const PathLike& file, const std::vector<std::string>& geometry, int threads) {
            const std::filesystem::path path = ToPath(file, "file");
            return WithoutLock([&] {
              const SceneFile scene = ReadSceneFile(path);
              SceneOptions options = SceneOptionsOf(scene, geometry);
              if (!scene.crs.empty()) {
                options.geometry = InWorld(options.geometry, WorldFrame::Parse(scene.crs));
              }
              options.threads = threads;
              return std::make_shared<Scene>(OpenScene(options));
            });
          },
          py::arg("file"), py::kw_only(), py::arg("geometry") = std::vector<std::string>(),
          py::arg("threads") = 0,
          "From a scene file (TOML); geometry: names of its geometries, by default the first one.")
      .def_property_readonly(
          "references", [](const Scene& scene) { return scene.references.images; },
          "A list of PosedImage.")
      .def_property_readonly(
          "geometry",
          [](const Scene& scene) {
            std::vector<std::shared_ptr<Geometry>> sources;
            for (const SceneSource& source : scene.sources) {
              sources.push_back(GeometryOf(scene, source));
            }
            return sources;
          },
          "A list of Geometry.")
      .def_property_readonly(
          "mesh",
          [](const Scene& scene) -> std::shared_ptr<Caster> {
            const auto mesh = scene.Mesh();
            return mesh ? std::make_shared<Caster>(mesh) : nullptr;
          },
          "The RayCaster of the first geometry that is a mesh, or None.")
      .def_readonly("warnings", &Scene::warnings)
      .def("__repr__", [](const Scene& scene) {
        return fmt::format("<raylift.Scene {} references, {} sources of geometry>",
                           scene.references.images.size(), scene.sources.size());
      });
  BindState(bound, py::overload_cast<const Scene&>(&StateOf), &SceneOf);
  BindCopies(bound);
}

}  // namespace raylift::python
