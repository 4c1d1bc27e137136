// What rays are cast at: meshes, clouds and splats, of files or in memory.

#include "apps/python/geometry_source.h"
#include "io/text/line_tokens.h"

#include "raylift/renderers/ray_caster.h"
#include "raylift/surfaces/point_cloud.h"
#include "raylift/surfaces/splats.h"

namespace raylift::python {
namespace {

using CasterPointer = std::shared_ptr<Caster>;

CasterPointer MakeCaster(const GeometryLike& surface, const std::string& build) {
  RayCasterOptions options;
  options.build_quality = ToEnum<RayCasterOptions::BuildQuality>("build", build);
  if (py::isinstance<TriangleMesh>(surface)) {
    const auto mesh = surface.cast<std::shared_ptr<TriangleMesh>>();
    return WithoutLock(
        [&] { return std::make_shared<Caster>(std::make_shared<const RayCaster>(mesh, options)); });
  }
  const auto found = ToGeometry(surface).Surface();
  if (found == nullptr) throw InputError("mesh: expected a mesh, a cloud or splats");
  return std::make_shared<Caster>(found);
}

// As many rows as there are points.
template <int kColumns, typename T>
std::vector<Eigen::Matrix<T, kColumns, 1>> RowsOf(const std::optional<ArrayLike>& argument,
                                                  const char* name, size_t count) {
  const Rows<kColumns, T> rows(argument, name);
  if (argument && rows.size() != count) {
    throw InputError(fmt::format("{}: expected {} rows, found {}", name, count, rows.size()));
  }
  return rows.ToVector();
}

CasterPointer CasterOfPoints(const ArrayLike& points, const std::optional<ArrayLike>& normals,
                             const std::optional<ArrayLike>& colors,
                             const std::optional<double>& radius, int neighbors, int threads) {
  PointCloud cloud;
  cloud.points_in_world = Rows<3>(points, "points").ToVector();
  const size_t count = cloud.points_in_world.size();
  for (const Eigen::Vector3f& normal : RowsOf<3, float>(normals, "normals", count)) {
    if (!HasDirection(Eigen::Vector3d(normal.cast<double>())))
      throw InputError("normals: expected directions");
    cloud.normals.push_back(normal.normalized());
  }
  for (const auto& color : RowsOf<3, uint8_t>(colors, "colors", count)) {
    cloud.colors_rgb.push_back({color[0], color[1], color[2]});
  }
  if (radius && !(*radius > 0)) {
    throw OptionError("radius", fmt::format("{}", *radius), "must be positive");
  }
  RequireAtLeast("neighbors", neighbors, 3);
  return WithoutLock([&] {
    auto surfels = std::make_shared<const Surfels>(MakeSurfels(
        std::move(cloud), {.radius = radius, .neighbors = neighbors, .threads = threads}));
    return std::make_shared<Caster>(std::make_shared<const RayCaster>(surfels));
  });
}

CasterPointer CasterOfSplats(const ArrayLike& means, const ArrayLike& rotations,
                             const ArrayLike& scales, const ArrayLike& opacities,
                             const std::optional<ArrayLike>& colors, const std::string& depth) {
  const Rows<3> centers(means, "means");
  const size_t count = centers.size();
  auto splats = std::make_shared<Splats>();
  if (count == 0) throw InputError("means: expected at least one row, found none");
  splats->origin_in_world = centers[0];
  const auto opacity = PerMatch<float>(opacities, "opacities", count);
  const auto rotation = RowsOf<4, float>(rotations, "rotations", count);
  splats->scales = RowsOf<3, float>(scales, "scales", count);
  for (size_t i = 0; i < count; ++i) {
    splats->means.emplace_back((centers[i] - splats->origin_in_world).cast<float>());
    const Eigen::Vector4f& q = rotation[i];
    const float alpha = opacity->data()[i];
    const bool is_right = centers[i].allFinite() && q.allFinite() && q.norm() > 0 &&
                          splats->scales[i].allFinite() && splats->scales[i].minCoeff() >= 0 &&
                          alpha >= 0 && alpha <= 1;
    if (!is_right) {
      throw InputError(fmt::format(
          "means, rotations, scales, opacities, row {}: expected finite numbers, a rotation, "
          "deviations of at least 0 and an opacity of 0 to 1",
          i));
    }
    splats->rotations.push_back(Eigen::Quaternionf(q[0], q[1], q[2], q[3]).normalized());
    splats->opacities.push_back(alpha);
  }
  // A color is 0.5 plus the harmonic of degree 0, a constant.
  constexpr float kHarmonic = 0.28209479177387814F;
  for (const Eigen::Vector3f& color : RowsOf<3, float>(colors, "colors", count)) {
    splats->harmonics.emplace_back((color.array() - 0.5F) / kHarmonic);
  }
  const auto surface = ToEnum<SplatDepth>("depth", depth);
  return WithoutLock([&] {
    return std::make_shared<Caster>(
        std::make_shared<const RayCaster>(std::shared_ptr<const Splats>(splats), surface));
  });
}

}  // namespace

std::shared_ptr<const PixelRays> LastRays::Of(const Camera& camera, int threads) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (rays_ && camera_ == camera) return rays_;
  }
  auto rays = std::make_shared<const PixelRays>(camera, threads);
  const std::lock_guard<std::mutex> lock(mutex_);
  camera_ = camera;
  rays_ = rays;
  return rays;
}

std::shared_ptr<const FrameRenderer> LastRenderer::Of(
    const std::shared_ptr<const RayCaster>& caster, const FrameOptions& options) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (renderer_ == nullptr || !(options_ == options)) {
    options_ = options;
    renderer_ = std::make_shared<const FrameRenderer>(caster, options);
  }
  return renderer_;
}

void BindMaking(CasterClass& caster_class) {
  caster_class
      .def(
          py::init(&MakeCaster), py::arg("mesh"), py::kw_only(), py::arg("build") = "medium",
          R"(Builds the acceleration structure of a Mesh, or of a text as the option --geometry takes it:
"mesh:...", "cloud:..." or "splat:...". build: "medium" for many views of a Mesh, "low" for
few.)")
      .def_static(
          "of_points", &CasterOfPoints, py::arg("points"), py::arg("normals") = py::none(),
          py::arg("colors") = py::none(), py::kw_only(), py::arg("radius") = py::none(),
          py::arg("neighbors") = 16, py::arg("threads") = 0,
          R"(Of a point cloud (N, 3) as small discs, with the points' normals (N, 3) and colors (N, 3),
uint8, where they are known. radius: of all discs; by default each has that of its nearest
`neighbors`. `triangles` of cast() are indices of discs.)")
      .def_static(
          "of_splats", &CasterOfSplats, py::arg("means"), py::arg("rotations"), py::arg("scales"),
          py::arg("opacities"), py::arg("colors") = py::none(), py::kw_only(),
          py::arg("depth") = "median",
          R"(Of Gaussian splats: their means (N, 3), rotations (N, 4) as (w, x, y, z), standard
deviations along their axes (N, 3), opacities (N,) and colors (N, 3) from 0 to 1. depth:
"median", "expected" or "peak". `triangles` of cast() are indices of Gaussians.)");
}

}  // namespace raylift::python
