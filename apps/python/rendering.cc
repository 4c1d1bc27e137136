// Pictures of meshes, clouds and splats.

#include <algorithm>
#include <cmath>

#include "apps/python/geometry_source.h"
#include "base/progress.h"
#include "io/text/line_tokens.h"
#include "pictures/picture_codec.h"

#include "raylift/base/parallel.h"
#include "raylift/evaluation/depth_errors.h"
#include "raylift/io/query_list.h"
#include "raylift/renderers/frame_renderer.h"
#include "raylift/surfaces/splats.h"
#include "raylift/views/render_job.h"
#include "raylift/views/view_sampler.h"

namespace raylift::python {
namespace {

// Returns the shading that the program uses: a surface without colors needs light to show its
// shape.
ColorOptions::Shading ShadingOf(const RayCaster& caster) {
  return caster.HasColors() ? ColorOptions::Shading::kUnlit : ColorOptions::Shading::kHeadlight;
}

// Returns the mesh without const: nothing in Python can change it.
std::shared_ptr<TriangleMesh> SharedMesh(const Caster& caster) {
  return std::const_pointer_cast<TriangleMesh>(
      std::shared_ptr<const TriangleMesh>(caster.caster, &caster.caster->mesh()));
}

// The products and options that a call renders.
struct Pictures {
  std::vector<Product> products;
  FrameOptions frame;
};

Pictures ToPictures(const Caster& caster, const std::vector<std::string>& products,
                    const py::kwargs& given) {
  Pictures pictures;
  std::vector<ProductOutput> outputs;
  for (const std::string& name : products) {
    pictures.products.push_back(ToEnum<Product>("products", name));
    outputs.push_back({pictures.products.back(), ""});
  }
  Request(outputs, pictures.frame);
  ColorOptions& color = pictures.frame.color_options;
  color.shading = ShadingOf(*caster.caster);
  Keywords keywords(given);
  std::string shading = "auto";
  keywords.Take("shading", shading);
  if (shading != "auto") color.shading = ToEnum<ColorOptions::Shading>("shading", shading);
  keywords.Take("normals_in", pictures.frame.normals_in);
  keywords.Take("supersampling", color.samples_per_pixel_side);
  keywords.Take("background", color.background_rgb);
  keywords.RequireAllTaken();
  if (color.samples_per_pixel_side < 1 || color.samples_per_pixel_side > 16) {
    throw OptionError("supersampling", std::to_string(color.samples_per_pixel_side),
                      "must be 1 to 16");
  }
  return pictures;
}

py::object TakeMap(Product product, Frame& frame) {
  const py::ssize_t height = frame.height_px, width = frame.width_px;
  switch (product) {
    case Product::kDepth:
      return HandOver(std::move(frame.depth), {height, width});
    case Product::kDistance:
      return HandOver(std::move(frame.distance), {height, width});
    case Product::kInverseDepth:
      break;  // see TakeMaps
    case Product::kPoints:
      return HandOver(std::move(frame.points), {height, width, 3});
    case Product::kNormals:
      return HandOver(std::move(frame.normals), {height, width, 3});
    case Product::kColor:
      return HandOver(std::move(frame.color.data), {height, width, 3});
    case Product::kTriangle:
      return HandOver(std::move(frame.triangle), {height, width});
    case Product::kObject:
    case Product::kInstance:
    case Product::kSemantic:
      break;  // see TakeMaps
    case Product::kIncidence:
      return HandOver(std::move(frame.incidence_deg), {height, width});
    case Product::kMask:
      return HandOver(std::move(frame.mask.data), {height, width});
  }
  return py::none();
}

py::dict TakeMaps(const Pictures& pictures, const TriangleMesh& mesh, Frame& frame) {
  py::dict maps;
  const auto& products = pictures.products;
  // This comes before the maps of depth and triangles are handed over.
  if (std::find(products.begin(), products.end(), Product::kInverseDepth) != products.end()) {
    maps["inverse_depth"] = HandOver(InverseDepths(frame), {frame.height_px, frame.width_px});
  }
  for (const Product product : products) {
    if (!IsId(product) || product == Product::kTriangle) continue;
    maps[py::str(std::string(ToString(product)))] =
        HandOver(IdsOf(product, frame, mesh), {frame.height_px, frame.width_px});
  }
  for (const Product product : products) {
    const py::str name{std::string(ToString(product))};
    if (!maps.contains(name)) maps[name] = TakeMap(product, frame);
  }
  return maps;
}

py::dict Render(Caster& caster, const CameraLike& camera, const PoseLike& pose,
                const std::vector<std::string>& products, int threads, const py::kwargs& options) {
  const Pictures pictures = ToPictures(caster, products, options);
  const Camera lens = ToCamera(camera);
  const Rigid3 cam_from_world = ToPose(pose);
  Frame frame;
  WithoutLock([&] {
    const auto renderer = caster.renderer.Of(caster.caster, pictures.frame);
    renderer->Render(*caster.rays.Of(lens, threads), cam_from_world, threads, frame);
  });
  return TakeMaps(pictures, caster.caster->mesh(), frame);
}

struct Views {
  std::vector<std::shared_ptr<const PixelRays>> rays;  // one per pose
  std::vector<Rigid3> poses;
};

// Makes views of one camera for all poses, or of one for each.
Views ToViews(Caster& caster, const py::object& cameras, const std::vector<PoseLike>& poses,
              int threads) {
  Views views;
  for (const PoseLike& pose : poses) views.poses.push_back(ToPose(pose));
  const bool is_list = py::isinstance<py::list>(cameras) || py::isinstance<py::tuple>(cameras);
  if (!is_list) {
    const Camera camera = ToCamera(py::reinterpret_borrow<CameraLike>(cameras));
    views.rays.assign(poses.size(), WithoutLock([&] { return caster.rays.Of(camera, threads); }));
    return views;
  }
  if (py::len(cameras) != poses.size()) {
    throw InputError(fmt::format("cameras and poses: expected as many, found {} and {}",
                                 py::len(cameras), poses.size()));
  }
  for (const py::handle camera : cameras) {
    const Camera lens = ToCamera(py::reinterpret_borrow<CameraLike>(camera));
    views.rays.push_back(WithoutLock([&] { return caster.rays.Of(lens, threads); }));
  }
  return views;
}

py::list RenderMany(Caster& caster, const py::object& cameras, const std::vector<PoseLike>& poses,
                    const std::vector<std::string>& products, int threads,
                    const std::optional<ProgressCall>& progress, const py::kwargs& options) {
  const Pictures pictures = ToPictures(caster, products, options);
  const Views views = ToViews(caster, cameras, poses, threads);
  std::vector<Frame> frames(poses.size());
  WithoutLock(progress, [&] {
    const auto renderer = caster.renderer.Of(caster.caster, pictures.frame);
    Progress count("images", frames.size(), Progress::Show::kNever);
    ParallelFor(frames.size(), threads, [&](size_t i) {
      renderer->Render(*views.rays[i], views.poses[i], 1, frames[i]);
      count.Advance();
    });
  });
  py::list maps;
  for (Frame& frame : frames) maps.append(TakeMaps(pictures, caster.caster->mesh(), frame));
  return maps;
}

// The known mask, depth and edges of a photograph, with which views of the mesh are compared; each
// is compared where it is given.
struct Goal {
  std::optional<py::array_t<bool>> mask;
  std::optional<py::array_t<float>> depth;
  std::optional<py::array_t<float>> edges;
  double depth_tolerance;
};

template <typename T>
std::optional<py::array_t<T>> GoalMap(const std::optional<ArrayLike>& argument, const char* name,
                                      const PixelRays& rays) {
  if (!argument) return std::nullopt;
  const std::string expected =
      fmt::format("an array of shape ({}, {})", rays.height_px(), rays.width_px());
  auto array = internal::ArrayOf<T>(*argument, name, expected);
  if (array.ndim() != 2 || array.shape(0) != rays.height_px() ||
      array.shape(1) != rays.width_px()) {
    internal::ThrowShape(name, expected, array);
  }
  return array;
}

// Returns the intersection of mask and rendered surface over their union, in pixels.
double MaskScore(const bool* mask, const std::vector<float>& depth) {
  size_t both = 0, either = 0;
  for (size_t i = 0; i < depth.size(); ++i) {
    const bool seen = depth[i] > 0;
    both += seen && mask[i];
    either += seen || mask[i];
  }
  return either > 0 ? static_cast<double>(both) / static_cast<double>(either) : 0;
}

// Returns the share of the pixels with a known depth z whose rendered depth is within tolerance * z
// of it.
double DepthScore(const float* known, const std::vector<float>& depth, double tolerance) {
  size_t count = 0, near = 0;
  for (size_t i = 0; i < depth.size(); ++i) {
    if (!(known[i] > 0) || !std::isfinite(known[i])) continue;
    ++count;
    near += depth[i] > 0 && std::abs(depth[i] - known[i]) <= tolerance * known[i];
  }
  return count > 0 ? static_cast<double>(near) / static_cast<double>(count) : 0;
}

// Returns the mean of the given image over the depth edges of the view, its outline among them.
double EdgeScore(const float* edges, const Frame& frame) {
  DepthMap map{frame.width_px, frame.height_px, frame.depth};
  // Pixels without a surface are far off, so that outlines are edges, too.
  constexpr float kFar = 1e30f;
  for (float& z : map.z) {
    if (!(z > 0)) z = kFar;
  }
  const std::vector<uint8_t> found = FindDepthEdges(map);
  double sum = 0;
  size_t count = 0;
  for (size_t i = 0; i < found.size(); ++i) {
    if (found[i] == 0) continue;
    sum += double{edges[i]};
    ++count;
  }
  return count > 0 ? sum / static_cast<double>(count) : 0;
}

py::dict ScoreViews(Caster& caster, const CameraLike& camera, const std::vector<PoseLike>& poses,
                    const std::optional<ArrayLike>& mask, const std::optional<ArrayLike>& depth,
                    const std::optional<ArrayLike>& edges, double depth_tolerance, int threads,
                    const std::optional<ProgressCall>& progress) {
  if (!mask && !depth && !edges) throw OptionError("give at least one of mask, depth and edges");
  if (!(depth_tolerance > 0)) {
    throw OptionError("depth_tolerance", fmt::format("{}", depth_tolerance), "must be positive");
  }
  const Views views = ToViews(caster, camera, poses, threads);
  const auto rays = caster.rays.Of(ToCamera(camera), threads);
  const auto mask_map = GoalMap<bool>(mask, "mask", *rays);
  const auto depth_map = GoalMap<float>(depth, "depth", *rays);
  const auto edge_map = GoalMap<float>(edges, "edges", *rays);
  const auto scores_if = [&](bool wanted) {
    return std::vector<double>(wanted ? poses.size() : 0);
  };
  std::vector<double> of_mask = scores_if(mask.has_value()),
                      of_depth = scores_if(depth.has_value()),
                      of_edges = scores_if(edges.has_value());
  const bool* mask_data = mask_map ? mask_map->data() : nullptr;
  const float* depth_data = depth_map ? depth_map->data() : nullptr;
  const float* edge_data = edge_map ? edge_map->data() : nullptr;
  WithoutLock(progress, [&] {
    FrameOptions options;
    options.depth = true;
    const FrameRenderer renderer(caster.caster, options);
    Progress count("views", poses.size(), Progress::Show::kNever);
    ParallelFor(poses.size(), threads, [&](size_t i) {
      thread_local Frame frame;  // its memory is used again
      renderer.Render(*views.rays[i], views.poses[i], 1, frame);
      if (mask_data != nullptr) of_mask[i] = MaskScore(mask_data, frame.depth);
      if (depth_data != nullptr) of_depth[i] = DepthScore(depth_data, frame.depth, depth_tolerance);
      if (edge_data != nullptr) of_edges[i] = EdgeScore(edge_data, frame);
      count.Advance();
    });
  });
  py::dict scores;
  const auto count = static_cast<py::ssize_t>(poses.size());
  if (mask) scores["mask"] = HandOver(std::move(of_mask), {count});
  if (depth) scores["depth"] = HandOver(std::move(of_depth), {count});
  if (edges) scores["edges"] = HandOver(std::move(of_edges), {count});
  return scores;
}

std::vector<Rigid3> SampleViews(const Caster& caster, const CameraLike& camera, int count,
                                const std::string& how, const std::optional<ArrayLike>& up,
                                double clearance, uint64_t seed, int threads) {
  ViewSamplerOptions options{.camera = ToCamera(camera),
                             .count = count,
                             .clearance = clearance,
                             .seed = seed,
                             .threads = threads};
  RequireAtLeast("count", count, 1);
  const RayCaster& surface = *caster.caster;
  if (surface.mesh().triangles.empty()) throw InputError("views are placed on meshes alone");
  if (up) options.up_in_world = ToVector3(*up, "up");
  if (!HasDirection(options.up_in_world)) throw InputError("up: expected a direction");
  return WithoutLock([&] {
    if (!up) options.up_in_world = EstimateUp(surface.mesh()).up_in_world;
    if (how == "around") return SampleAround(surface, options, {}).cam_from_world;
    if (how == "inside") return SampleInside(surface, options, {}).cam_from_world;
    if (how == "cover") return SampleCovering(surface, options).cam_from_world;
    if (how == "walk") return SampleWalk(surface, options, {}).cam_from_world;
    throw OptionError("how", how, "expected around|inside|cover|walk");
  });
}

// The state of a ray caster at a mesh. Throws InputError for those at clouds and splats.
using CasterState = std::pair<std::shared_ptr<TriangleMesh>, std::string>;

CasterState StateOf(const Caster& caster) {
  if (caster.caster->kind() != SurfaceKind::kMesh) {
    throw InputError(fmt::format("ray caster: one at a {} has no state, as those at meshes have",
                                 ToString(caster.caster->kind())));
  }
  return {SharedMesh(caster), std::string(ToString(caster.build))};
}

std::shared_ptr<Caster> CasterOf(const CasterState& state) {
  return MakeCaster(state.first, ToEnum<RayCasterOptions::BuildQuality>("build", state.second));
}

}  // namespace

Image PictureFrom(const std::shared_ptr<const RayCaster>& surface, const Camera& camera,
                  const Rigid3& cam_from_world) {
  const int side = std::max(camera.width_px(), camera.height_px());
  const double share = std::min(1.0, static_cast<double>(kPictureSidePx) / side);
  const auto scaled = [&](int size) {
    return std::max(1, static_cast<int>(std::lround(share * size)));
  };
  FrameOptions options;
  options.color = true;
  options.color_options.shading = ShadingOf(*surface);
  Frame frame;
  FrameRenderer(surface, options)
      .Render(PixelRays(camera.Scaled(scaled(camera.width_px()), scaled(camera.height_px())), 0),
              cam_from_world, 0, frame);
  return std::move(frame.color);
}

std::optional<py::bytes> PictureOf(const Caster& caster) {
  const TriangleMesh& mesh = caster.caster->mesh();
  if (mesh.triangles.empty()) return std::nullopt;
  const auto picture = WithoutLock([&]() -> std::optional<std::string> {
    constexpr double kElevationDeg = 30;
    const Camera camera = ParseCamera("camera", "PINHOLE 480 360 400 400 240 180");
    const SampledViews view = SampleAround(
        *caster.caster,
        {.camera = camera, .count = 1, .up_in_world = EstimateUp(mesh).up_in_world, .clearance = 0},
        {.min_elevation_deg = kElevationDeg, .max_elevation_deg = kElevationDeg});
    if (view.cam_from_world.empty()) return std::nullopt;
    return EncodePng(PictureFrom(caster.caster, camera, view.cam_from_world.front()));
  });
  if (!picture) return std::nullopt;
  return py::bytes(*picture);
}

void BindRendering(py::module_& module) {
  const auto depth_alone = std::vector<std::string>{"depth"};
  CasterClass caster_class(
      module, "RayCaster",
      "Casts rays at a mesh, and renders what cameras see of it. Thread safe.");
  BindMaking(caster_class);
  BindCasting(caster_class);
  caster_class
      .def(
          "sample_views", &SampleViews, py::arg("camera"), py::arg("count") = 48, py::kw_only(),
          py::arg("how") = "around", py::arg("up") = py::none(), py::arg("clearance") = 0.3,
          py::arg("seed") = 0, py::arg("threads") = 0,
          R"(Poses (cam_from_world) that see a mesh, as of `raylift views`: how="around" it from outside,
"inside" it at eye height, "cover" its surfaces, or "walk" in it on foot, in order; up: direction
(3,) in the world, by default the one that its surfaces tell. Fewer than `count` where there is no more room.)")
      .def_property_readonly("mesh", &SharedMesh, "The Mesh.")
      .def("render", &Render, py::arg("camera"), py::arg("pose"), py::arg("products") = depth_alone,
           py::kw_only(), py::arg("threads") = 0,
           "What a camera sees from a pose (cam_from_world), a dict of arrays by product:\n\n"
           "depth      (H, W) float32, z along the optical axis, scene units; 0: no surface\n"
           "distance   (H, W) float32, along the ray; 0: no surface\n"
           "normals    (H, W, 3) float32, unit, toward the camera; 0: no surface\n"
           "color      (H, W, 3) uint8, RGB\n"
           "triangle   (H, W) uint32, index; 4294967295: none\n"
           "object     (H, W) uint32, which of several meshes; 4294967295: none\n"
           "instance   (H, W) uint32, which node, group or city object; likewise\n"
           "semantic   (H, W) uint32, which material or kind of surface; likewise\n"
           "incidence  (H, W) float32, degrees; -1: no surface\n"
           "mask       (H, W) uint8, 255 where there is a surface\n\n"
           "A camera of the model EQUIRECTANGULAR sees all around; its depth is the distance.\n\n"
           "Options as of `raylift render`: normals_in=\"world\" (or \"camera\"), shading=\"auto\" "
           "(or\n"
           "\"unlit\", \"headlight\", \"sun\"), supersampling=1, background=(0, 0, 0). The arrays "
           "are the\n"
           "renderer's own memory. The same bytes for any number of threads (0: all).")
      .def("render_many", &RenderMany, py::arg("cameras"), py::arg("poses"),
           py::arg("products") = depth_alone, py::kw_only(), py::arg("threads") = 0,
           py::arg("progress") = py::none(),
           "A list with the pictures of each pose, as of render(). `cameras` is one camera, or a "
           "list\n"
           "of as many as there are poses.")
      .def(
          "score_views", &ScoreViews, py::arg("camera"), py::arg("poses"), py::kw_only(),
          py::arg("mask") = py::none(), py::arg("depth") = py::none(),
          py::arg("edges") = py::none(), py::arg("depth_tolerance") = 0.05, py::arg("threads") = 0,
          py::arg("progress") = py::none(),
          R"(How well many views fit what is known of a photograph, without keeping their pictures: a
dict of (N,) arrays, one for each that is given, the larger the better.

mask   (H, W) bool; the intersection of what both show over their union
depth  (H, W), 0 or not finite: not known; share of the known pixels whose rendered depth
       is within depth_tolerance of it, as a share of it
edges  (H, W), how much each pixel is an edge; its mean over the view's depth edges)")
      .def("_repr_png_", &PictureOf, "A picture of the mesh from outside.")
      .def("__repr__", [](const Caster& caster) {
        const RayCaster& surface = *caster.caster;
        if (surface.surfels() != nullptr) {
          return fmt::format("<raylift.RayCaster {} discs>", surface.surfels()->discs.size());
        }
        if (surface.splats() != nullptr) {
          return fmt::format("<raylift.RayCaster {} splats>", surface.splats()->means.size());
        }
        return fmt::format("<raylift.RayCaster {} triangles>", surface.mesh().triangles.size());
      });
  BindState(caster_class, py::overload_cast<const Caster&>(&StateOf), &CasterOf);
  BindHash(caster_class);
}

}  // namespace raylift::python
