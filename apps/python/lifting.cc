// Geometry that keypoints are lifted by, and the filter of lifted points.

#include <algorithm>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "apps/python/conversions.h"
#include "apps/python/estimate_state.h"
#include "apps/python/geometry_source.h"
#include "lifting/depth_convention.h"
#include "lifting/fields.h"
#include "pictures/picture_codec.h"
#include "report/page.h"

#include "raylift/base/parallel.h"
#include "raylift/base/text.h"
#include "raylift/lifting/depth_source.h"
#include "raylift/lifting/lifter.h"
#include "raylift/lifting/mesh_source.h"
#include "raylift/localization/localizer.h"

namespace raylift::python {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// Holds columns of what pixels show; where there is no surface, they are NaN and the source is -1.
class SurfaceColumns {
 public:
  explicit SurfaceColumns(py::ssize_t count)
      : points_({count, py::ssize_t{3}}),
        normals_({count, py::ssize_t{3}}),
        depth_(count),
        incidence_deg_(count),
        sigma_(count),
        depth_jump_(count),
        back_face_(count),
        source_(count) {}

  // Touches no Python object: may be called without the interpreter's lock.
  void Set(size_t i, const std::optional<SurfacePoint>& point, int64_t source) {
    const Eigen::Vector3d none = Eigen::Vector3d::Constant(kNaN);
    Eigen::Map<Eigen::Vector3d>(points_.mutable_data() + 3 * i) =
        point ? point->point_in_world : none;
    Eigen::Map<Eigen::Vector3d>(normals_.mutable_data() + 3 * i) =
        point ? point->normal_in_world : none;
    depth_.mutable_data()[i] = point ? point->depth_z : kNaN;
    incidence_deg_.mutable_data()[i] = point ? point->incidence_deg : kNaN;
    sigma_.mutable_data()[i] = point ? point->point_sigma.value_or(kNaN) : kNaN;
    depth_jump_.mutable_data()[i] = point ? point->depth_jump.value_or(kNaN) : kNaN;
    back_face_.mutable_data()[i] = point && point->back_face;
    source_.mutable_data()[i] = source;
  }

  py::dict ToDict() const {
    py::dict dict;
    dict["points"] = points_;
    dict["normals"] = normals_;
    dict["depth"] = depth_;
    dict["incidence_deg"] = incidence_deg_;
    dict["sigma"] = sigma_;
    dict["depth_jump"] = depth_jump_;
    dict["back_face"] = back_face_;
    return dict;
  }
  const py::array_t<int64_t>& source() const { return source_; }

 private:
  py::array_t<double> points_, normals_, depth_, incidence_deg_, sigma_, depth_jump_;
  py::array_t<bool> back_face_;
  py::array_t<int64_t> source_;
};

// Returns for each pixel the point of the first source that has one, and the index of this source.
// The call can be ended after each block of pixels.
SurfaceColumns LiftByFirst(std::span<const std::shared_ptr<const GeometrySource>> sources,
                           const PosedImageLike& reference, const ArrayLike& given_pixels) {
  constexpr size_t kBlock = size_t{1} << 16;
  const PosedImage image = ToPosedImage(reference);
  const PlaneSize size = SizeOf(image.camera);
  const auto pixels = Rows<2>(given_pixels, "pixels").ToVector();
  SurfaceColumns columns(std::ssize(pixels));
  WithoutLock([&] {
    for (size_t begin = 0; begin < pixels.size(); begin += kBlock) {
      std::vector<size_t> left;
      for (size_t i = begin; i < std::min(begin + kBlock, pixels.size()); ++i) {
        if (Shows(size, pixels[i])) {
          left.push_back(i);
        } else {
          columns.Set(i, std::nullopt, -1);
        }
      }
      for (size_t s = 0; s < sources.size() && !left.empty(); ++s) {
        if (CallWatch* const watch = CallWatch::Current()) watch->Check();
        std::vector<Eigen::Vector2d> asked;
        for (const size_t i : left) asked.push_back(pixels[i]);
        const auto lifted = sources[s]->Lift(image, asked);
        std::vector<size_t> without;
        for (size_t k = 0; k < left.size(); ++k) {
          if (lifted[k]) {
            columns.Set(left[k], lifted[k], static_cast<int64_t>(s));
          } else {
            without.push_back(left[k]);
          }
        }
        left = std::move(without);
      }
      for (const size_t i : left) columns.Set(i, std::nullopt, -1);
    }
  });
  return columns;
}

constexpr const char* kLiftDoc =
    R"(The surface points that pixels (N, 2) of a reference show. A dict: points and normals (N, 3) in
the world (unit, toward the camera), NaN where there is no surface, and outside of the image;
and (N,) each: depth along
the optical axis, sigma (standard deviation of the point, where it is known) in scene units,
incidence_deg, depth_jump (largest relative jump of depth around the pixel, where it was looked
for), back_face (bool).)";

// Depth maps from memory, by the names of their references.
class DepthInMemory final : public GeometrySource {
 public:
  DepthInMemory(std::map<std::string, DepthMap> maps, const DepthSamplingOptions& sampling)
      : maps_(std::move(maps)), sampling_(sampling) {}

  std::string Description() const override { return fmt::format("depth{}", kFromMemory); }
  std::vector<std::optional<SurfacePoint>> Lift(
      const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const override {
    const auto map = maps_.find(reference.name);
    if (map == maps_.end()) return std::vector<std::optional<SurfacePoint>>(pixels.size());
    return LiftByDepthMap(map->second, reference, pixels, sampling_);
  }
  const std::map<std::string, DepthMap>& maps() const { return maps_; }
  const DepthSamplingOptions& sampling() const { return sampling_; }

 private:
  std::map<std::string, DepthMap> maps_;
  DepthSamplingOptions sampling_;
};

DepthMap ToDepthMapOf(const ArrayLike& argument, const std::string& name, const Camera& camera,
                      const DepthConvention& convention) {
  const auto array = internal::ArrayOf<float>(argument, name, "an array of shape (height, width)");
  if (array.ndim() != 2) internal::ThrowShape(name, "an array of shape (height, width)", array);
  StoredDepth stored;
  stored.width_px = static_cast<int>(array.shape(1));
  stored.height_px = static_cast<int>(array.shape(0));
  stored.values.assign(array.data(), array.data() + array.size());
  return WithoutLock([&] { return ToDepthMap(stored, camera, convention); });
}

NamedGeometry OfMaps(std::map<std::string, DepthMap> maps, const DepthSamplingOptions& sampling) {
  NamedGeometry geometry;
  geometry.kind = GeometryKind::kDepth;
  geometry.source = std::make_shared<DepthInMemory>(std::move(maps), sampling);
  return geometry;
}

std::shared_ptr<DepthMaps> DepthFromArrays(const py::dict& maps,
                                           const std::vector<PosedImageLike>& references,
                                           const py::kwargs& given) {
  DepthConvention convention;
  DepthSamplingOptions sampling;
  Keywords keywords(given);
  keywords.Take("kind", convention.kind);
  keywords.Take("scale", convention.scale);
  keywords.Take("max_depth", convention.max_depth);
  keywords.Take("interpolation", sampling.interpolation);
  keywords.Take("max_jump", sampling.max_jump);
  keywords.RequireAllTaken();
  convention.unit = 1;
  std::map<std::string, DepthMap> converted;
  for (const PosedImage& reference : ToPosedImages(references)) {
    if (!maps.contains(reference.name)) continue;
    converted.emplace(
        reference.name,
        ToDepthMapOf(py::reinterpret_borrow<ArrayLike>(maps[py::str(reference.name)]),
                     fmt::format("maps[\"{}\"]", reference.name), reference.camera, convention));
  }
  if (converted.empty()) throw InputError("maps: none is of a reference");
  auto geometry = std::make_shared<DepthMaps>(OfMaps(std::move(converted), sampling));
  geometry->references = ToPosedImages(references);
  return geometry;
}

// Returns the reference's map; null where there is none.
std::shared_ptr<const DepthMap> HeldMap(const DepthMaps& maps, const PosedImage& reference) {
  if (maps.named.maps) return maps.named.maps->Load(reference);
  const auto* const memory = dynamic_cast<const DepthInMemory*>(maps.named.source.get());
  if (memory == nullptr) return nullptr;
  const auto found = memory->maps().find(reference.name);
  if (found == memory->maps().end()) return nullptr;
  return {maps.named.source, &found->second};
}

// Returns the map as it is held, not to be written to; None where there is none.
py::object LoadMap(const DepthMaps& maps, const PosedImageLike& reference) {
  const PosedImage image = ToPosedImage(reference);
  const auto map = WithoutLock([&] { return HeldMap(maps, image); });
  if (!map) return py::none();
  auto* owned = new std::shared_ptr<const DepthMap>(map);
  const py::capsule owner(owned,
                          [](void* p) { delete static_cast<std::shared_ptr<const DepthMap>*>(p); });
  py::array_t<float> array({py::ssize_t{map->height_px}, py::ssize_t{map->width_px}}, map->z.data(),
                           owner);
  py::detail::array_proxy(array.ptr())->flags &= ~py::detail::npy_api::NPY_ARRAY_WRITEABLE_;
  return array;
}

// Returns each N-th pixel, so that the map is no larger than a notebook's pictures.
DepthMap Thumbnail(const DepthMap& map) {
  const int step = (std::max(map.width_px, map.height_px) + kPictureSidePx - 1) / kPictureSidePx;
  DepthMap small{.width_px = map.width_px / step, .height_px = map.height_px / step, .z = {}};
  for (int y = 0; y < small.height_px; ++y) {
    for (int x = 0; x < small.width_px; ++x) small.z.push_back(map.At(x * step, y * step));
  }
  return small;
}

// Returns a PNG of the first map that there is, near surfaces dark and far ones bright; nullopt
// without one.
std::optional<py::bytes> PictureOf(const DepthMaps& maps) {
  const auto picture = WithoutLock([&]() -> std::optional<std::string> {
    for (const PosedImage& reference : maps.references) {
      try {
        const auto map = HeldMap(maps, reference);
        if (!map || map->z.empty()) continue;
        const DepthMap small = Thumbnail(*map);
        std::vector<float> known;
        std::copy_if(small.z.begin(), small.z.end(), std::back_inserter(known),
                     [](float z) { return z > 0; });
        if (known.empty()) continue;
        const auto [near, far] = std::minmax_element(known.begin(), known.end());
        return EncodePng(ColorizeDepth(small, double{*near}, double{*far}));
      } catch (const InputError&) {
        continue;  // a notebook shows what it can
      }
    }
    return std::nullopt;
  });
  if (!picture) return std::nullopt;
  return py::bytes(*picture);
}

// Makes a class pickle by its state; copies share what they hold.
template <typename T, typename... Bound>
void BindGeometryState(py::class_<T, Bound...>& bound) {
  BindState(
      bound, [](const T& geometry) { return StateOf(geometry); },
      [](const py::tuple& state) {
        Geometry geometry = GeometryOf(state);
        auto made = std::make_shared<T>(std::move(geometry.named));
        made->spec = std::move(geometry.spec);
        made->model = std::move(geometry.model);
        made->references = std::move(geometry.references);
        return made;
      });
  BindCopies(bound);
}

void BindSources(py::module_& module) {
  py::class_<Geometry, std::shared_ptr<Geometry>> geometry_class(
      module, "Geometry",
      "A source of geometry: which point of the scene a reference's pixel shows.");
  geometry_class
      .def(py::init([](const GeometryLike& geometry, const std::optional<PathLike>& model,
                       const std::vector<PosedImageLike>& references, int threads) {
             const std::vector<PosedImage> images = ToPosedImages(references);
             const GeometryContext context{
                 .model = model ? ToPath(*model, "model") : std::filesystem::path(),
                 .references = images,
                 .threads = threads};
             if (py::isinstance<Geometry>(geometry)) {
               return std::make_shared<Geometry>(geometry.cast<const Geometry&>());
             }
             const bool is_text = py::isinstance<py::str>(geometry);
             return std::make_shared<Geometry>(
                 ToGeometry(geometry, context),
                 is_text ? geometry.cast<std::string>() : std::string(), context);
           }),
           py::arg("geometry"), py::kw_only(), py::arg("model") = py::none(),
           py::arg("references") = std::vector<PosedImageLike>(), py::arg("threads") = 0,
           R"(From a Mesh, a RayCaster, or a text as the option --geometry takes it:
"mesh:PATH[,key=value...]", "depth:PATH[,...]" (needs the references), "sfm[:DIR][,...]"
(without DIR, the points of `model`). Raises OptionError for what is none.)")
      .def_property_readonly(
          "description",
          [](const Geometry& geometry) { return geometry.named.source->Description(); })
      .def_property_readonly(
          "interpretation", [](const Geometry& geometry) { return geometry.named.interpretation; },
          "How the files were read (\"PNG uint16 640 x 480, z\").")
      .def_property_readonly("warnings",
                             [](const Geometry& geometry) { return geometry.named.warnings; })
      .def(
          "lift",
          [](const Geometry& geometry, const PosedImageLike& reference, const ArrayLike& pixels) {
            return LiftByFirst({&geometry.named.source, 1}, reference, pixels).ToDict();
          },
          py::arg("reference"), py::arg("pixels"), kLiftDoc)
      .def("__repr__", [](const Geometry& geometry) {
        return fmt::format("<raylift.Geometry {}>", geometry.named.source->Description());
      });
  BindGeometryState(geometry_class);
  py::class_<DepthMaps, Geometry, std::shared_ptr<DepthMaps>> maps_class(
      module, "DepthMaps", "Depth maps of references.");
  maps_class
      .def(
          py::init([](const PathLike& folder, const std::vector<PosedImageLike>& references,
                      const py::kwargs& keys) {
            const std::vector<PosedImage> images = ToPosedImages(references);
            const std::string spec = SpecOf("depth", ToPath(folder, "folder"), keys);
            return WithoutLock([&] {
              const GeometryContext context{.references = images};
              return std::make_shared<DepthMaps>(MakeGeometrySource(spec, context), spec, context);
            });
          }),
          py::arg("folder"), py::arg("references"),
          R"(Finds the references' maps in a folder or file. Keywords are the keys of --geometry depth:...
(preset, kind, unit, scale, pattern, ...; `raylift localize --help` lists them). Raises
InputError where there is no map.)")
      .def_static(
          "from_arrays", &DepthFromArrays, py::arg("maps"), py::arg("references"),
          R"(From a dict of (height, width) arrays by the references' names, of the image's size
or another; what is not finite or not positive is no surface. They are copied.
Keywords: kind="z" (or "ray", "inverse"), scale=1, max_depth, interpolation="edge"
(or "nearest"), max_jump=0.05.)")
      .def("load", &LoadMap, py::arg("reference"),
           "The map of a reference (height, width), float32, z in scene units, 0: no surface; or "
           "None.\n"
           "It is the library's own memory, which cannot be written to.")
      .def(
          "_repr_png_", [](const DepthMaps& maps) { return PictureOf(maps); },
          "The first reference's map, dark where it is near.");
  BindGeometryState(maps_class);
  py::class_<SfmPoints, Geometry, std::shared_ptr<SfmPoints>> points_class(
      module, "SfmPoints", "The points of a COLMAP model, lifted by its own keypoints.");
  points_class.def(py::init([](const PathLike& model, const std::vector<PosedImageLike>& references,
                               const py::kwargs& keys) {
                     const std::vector<PosedImage> images = ToPosedImages(references);
                     const std::string spec = SpecOf("sfm", ToPath(model, "model"), keys);
                     return WithoutLock([&] {
                       const GeometryContext context{.references = images};
                       return std::make_shared<SfmPoints>(MakeGeometrySource(spec, context), spec,
                                                          context);
                     });
                   }),
                   py::arg("model"), py::arg("references") = std::vector<PosedImageLike>(),
                   "Keywords are the keys of --geometry sfm:... (radius, min_track, ...).");
  BindGeometryState(points_class);
}

// Several sources as one.
class Lifter {
 public:
  Lifter(const py::tuple& geometry, GeometryMode mode) : geometry_(geometry), mode_(mode) {
    for (const py::handle one : geometry) {
      sources_.push_back(ToGeometry(py::reinterpret_borrow<GeometryLike>(one)).source);
    }
    if (sources_.empty()) throw OptionError("give at least one source of geometry");
  }

  LiftResult LiftAll(const PoseProblem& problem) const {
    std::vector<const GeometrySource*> sources;
    for (const auto& source : sources_) sources.push_back(source.get());
    return LiftMatches(sources, mode_, problem.references, problem.matches_2d2d);
  }

  const std::vector<std::shared_ptr<const GeometrySource>>& sources() const { return sources_; }
  py::tuple State() const { return py::make_tuple(geometry_, std::string(ToString(mode_))); }

 private:
  py::tuple geometry_;  // as given by the caller
  std::vector<std::shared_ptr<const GeometrySource>> sources_;
  GeometryMode mode_;
};

void BindLifter(py::module_& module) {
  py::class_<Lifter, std::shared_ptr<Lifter>>(
      module, "Lifter",
      "Lifts keypoints of references to the scene by one source of geometry or several.")
      .def(
          py::init([](const py::args& geometry, const std::string& mode) {
            return std::make_shared<Lifter>(geometry, ToEnum<GeometryMode>("geometry_mode", mode));
          }),
          py::arg("geometry_mode") = "first",
          R"(Each source is a Mesh, RayCaster, DepthMaps, SfmPoints, Geometry or "mesh:PATH"; they are
asked in order. geometry_mode: of lift_matches(), the point of the "first" that has one,
or those of "all".)")
      .def(
          "lift",
          [](const Lifter& lifter, const PosedImageLike& reference, const ArrayLike& pixels) {
            const SurfaceColumns columns = LiftByFirst(lifter.sources(), reference, pixels);
            py::dict dict = columns.ToDict();
            dict["source"] = columns.source();
            return dict;
          },
          py::arg("reference"), py::arg("pixels"),
          (std::string(kLiftDoc) + " source: index of the source (N,), -1: none.").c_str())
      .def(
          "lift_matches",
          [](const Lifter& lifter, const KnownProblem& problem) {
            return WithoutLock([&] {
              auto lifted = std::make_shared<KnownProblem>(problem);
              lifted->matches_2d3d = Matches2D3D(lifter.LiftAll(problem));
              return lifted;
            });
          },
          py::arg("problem"),
          "The PoseProblem with the 2D-3D matches that its 2D-2D matches give, in place of its "
          "own.")
      .def("__repr__",
           [](const Lifter& lifter) {
             std::vector<std::string> sources;
             for (const auto& source : lifter.sources()) sources.push_back(source->Description());
             return fmt::format("<raylift.Lifter {}>", fmt::join(sources, ", "));
           })
      .def(py::pickle([](const Lifter& lifter) { return lifter.State(); },
                      [](const py::tuple& state) {
                        return std::make_shared<Lifter>(
                            state[0].cast<py::tuple>(),
                            ToEnum<GeometryMode>("geometry_mode", state[1].cast<std::string>()));
                      }));
}

py::tuple Filter(const KnownProblem& problem, const std::string& mode, const std::string& method,
                 const py::kwargs& given) {
  FilterOptions options;
  options.mode = ToEnum<FilterMode>("filter", mode);
  options.few_points = FewPointsFor(ToEnum<Method>("method", method));
  Keywords keywords(given);
  keywords.Take(FieldsOf(options.thresholds));
  keywords.RequireAllTaken();
  options.thresholds.Validate();
  auto filtered = std::make_shared<KnownProblem>(problem);
  const FilterResult result = WithoutLock([&] { return FilterProblem(options, *filtered); });
  return py::make_tuple(filtered, ToArray(result.keep),
                        NumbersOf<uint64_t>(ConstFieldsOf(result.counts)));
}

std::shared_ptr<KnownProblem> WithCandidates(const KnownProblem& problem, const py::kwargs& given) {
  CandidateOptions options{.mode = CandidateMode::kMerge};
  Keywords keywords(given);
  keywords.Take(FieldsOf(options));
  keywords.RequireAllTaken();
  options.Validate();
  return WithoutLock([&] {
    auto changed = std::make_shared<KnownProblem>(problem);
    if (options.mode == CandidateMode::kMerge) {
      changed->matches_2d3d =
          MergeCandidates(problem.references, problem.matches_2d2d, problem.matches_2d3d, options);
    } else if (options.mode == CandidateMode::kTriangulate) {
      changed->matches_2d3d = TriangulateMatches(problem.references, problem.matches_2d2d, options);
    }
    return changed;
  });
}

// Returns the text of a value as in a specification: "0.5", "true", "a/b" for a list.
std::string KeyText(const py::handle& value) {
  if (py::isinstance<py::bool_>(value)) return value.cast<bool>() ? "true" : "false";
  if (py::isinstance<py::float_>(value)) return FormatDouble(value.cast<double>());
  if (py::isinstance<py::list>(value) || py::isinstance<py::tuple>(value)) {
    std::vector<std::string> parts;
    for (const py::handle part : value) parts.push_back(KeyText(part));
    return fmt::format("{}", fmt::join(parts, "/"));
  }
  return py::cast<std::string>(py::str(value));
}

}  // namespace

NamedGeometry ToGeometry(const GeometryLike& geometry, const GeometryContext& context) {
  const auto of_caster = [](std::shared_ptr<const RayCaster> caster) {
    NamedGeometry named;
    const bool is_mesh = caster->kind() == SurfaceKind::kMesh;
    const bool is_cloud = caster->kind() == SurfaceKind::kCloud;
    named.kind = is_mesh    ? GeometryKind::kMesh
                 : is_cloud ? GeometryKind::kCloud
                            : GeometryKind::kSplats;
    const char* const name = is_mesh ? "mesh" : is_cloud ? "cloud" : "splats";
    named.source =
        std::make_shared<const MeshSource>(fmt::format("{}{}", name, kFromMemory), caster);
    (is_mesh ? named.mesh : named.cloud) = std::move(caster);
    return named;
  };
  if (py::isinstance<Geometry>(geometry)) return geometry.cast<const Geometry&>().named;
  if (py::isinstance<Caster>(geometry)) return of_caster(geometry.cast<const Caster&>().caster);
  if (py::isinstance<TriangleMesh>(geometry)) {
    const auto mesh = geometry.cast<std::shared_ptr<TriangleMesh>>();
    return of_caster(WithoutLock([&] {
      return std::make_shared<const RayCaster>(
          mesh, RayCasterOptions{.build_quality = RayCasterOptions::BuildQuality::kLow});
    }));
  }
  if (py::isinstance<py::str>(geometry)) {
    const auto spec = geometry.cast<std::string>();
    return WithoutLock([&] { return MakeGeometrySource(spec, context); });
  }
  throw WrongType(fmt::format(
      "geometry: expected a Mesh, RayCaster, Geometry or \"KIND:PATH[,key=value...]\", found {}",
      py::cast<std::string>(py::type::handle_of(geometry).attr("__name__"))));
}

using MapState = std::tuple<std::string, int, int, py::bytes>;

py::tuple StateOf(const Geometry& geometry) {
  if (!geometry.spec.empty()) {
    return py::make_tuple(geometry.spec, geometry.model.string(), geometry.references);
  }
  // Geometry that was opened by a text, or is corrected, is more than its mesh.
  const bool is_memory = geometry.named.source->Description().ends_with(kFromMemory);
  if (const auto& caster = geometry.named.mesh; caster && is_memory) {
    return py::make_tuple(std::const_pointer_cast<TriangleMesh>(std::shared_ptr<const TriangleMesh>(
                              caster, &caster->mesh())),  // nothing changes it
                          "", geometry.references);
  }
  if (const auto* maps = dynamic_cast<const DepthInMemory*>(geometry.named.source.get())) {
    std::vector<MapState> states;
    for (const auto& [name, map] : maps->maps()) {
      states.emplace_back(name, map.width_px, map.height_px, ToBytes(map.z));
    }
    return py::make_tuple(states, std::string(ToString(maps->sampling().interpolation)),
                          geometry.references, maps->sampling().max_jump);
  }
  throw InputError(
      fmt::format("geometry: {} has no state; meshes, depth maps and what is opened by "
                  "a text have one",
                  geometry.named.source->Description()));
}

namespace {

void RequireWhole(const DepthMap& map, const std::string& name) {
  if (map.width_px > 0 && map.height_px > 0 &&
      map.z.size() == static_cast<size_t>(map.width_px) * static_cast<size_t>(map.height_px)) {
    return;
  }
  throw InputError(fmt::format("state, map of {}: expected {} x {} numbers, found {}", name,
                               map.width_px, map.height_px, map.z.size()));
}

}  // namespace

Geometry GeometryOf(const py::tuple& state) {
  const auto references = state[2].cast<std::vector<PosedImage>>();
  if (py::isinstance<py::list>(state[0])) {
    std::map<std::string, DepthMap> maps;
    for (const auto& [name, width, height, z] : state[0].cast<std::vector<MapState>>()) {
      DepthMap& map = maps[name];
      map.width_px = width;
      map.height_px = height;
      FromBytes(z, map.z);
      RequireWhole(map, name);
    }
    Geometry geometry(OfMaps(std::move(maps), {.interpolation = ToEnum<DepthInterpolation>(
                                                   "interpolation", state[1].cast<std::string>()),
                                               .max_jump = state[3].cast<double>()}));
    geometry.references = references;
    return geometry;
  }
  const auto model = state[1].cast<std::string>();
  const GeometryContext context{.model = model, .references = references};
  const py::object opened = state[0];
  const bool is_text = py::isinstance<py::str>(opened);
  return {ToGeometry(opened.cast<GeometryLike>(), context),
          is_text ? opened.cast<std::string>() : std::string(), context};
}

std::string SpecOf(const std::string& kind, const std::filesystem::path& path,
                   const py::kwargs& keys) {
  std::string spec = fmt::format("{}:{}", kind, path.string());
  for (const auto& [key, value] : keys) {
    spec += fmt::format(",{}={}", key.cast<std::string>(), KeyText(value));
  }
  return spec;
}

void BindLifting(py::module_& module) {
  BindSources(module);
  BindLifter(module);
  module.def(
      "filter_points", &Filter, py::arg("problem"), py::arg("filter") = "auto", py::kw_only(),
      py::arg("method") = "adaptive",
      "Drops the 2D-3D matches of a PoseProblem that its references disagree on. filter: \"off\",\n"
      "\"fixed\" (with filter_reprojection_px=4, filter_min_views=3, filter_min_ratio=0.8) or\n"
      "\"auto\", which leaves accurate geometry alone. method: what the points are for (some keep\n"
      "the best where few are left).\n\n"
      "Returns the problem without them, which were kept (N,) bool, and a dict of counts.");
  module.def(
      "merge_candidates", &WithCandidates, py::arg("problem"),
      R"(The PoseProblem with one 3D point per query keypoint. candidates="merge": the one that
the references agree on best; "triangulate": from the 2D-2D matches alone; "keep": all.
Also candidates_error_px=4, candidates_min_angle_deg=1.)");
}

}  // namespace raylift::python
