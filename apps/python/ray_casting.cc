// Ray casting: at meshes, clouds and splats of files or in memory, along rays of arrays.

#include <array>
#include <limits>

#include "apps/python/geometry_source.h"
#include "io/text/line_tokens.h"
#include "surfaces/space_order.h"

#include "raylift/base/parallel.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/surfaces/point_cloud.h"
#include "raylift/surfaces/splats.h"

namespace raylift::python {
namespace {

using CasterPointer = std::shared_ptr<Caster>;

CasterPointer CasterAt(const GeometryLike& surface, const std::string& build) {
  const auto quality = ToEnum<RayCasterOptions::BuildQuality>("build", build);
  if (py::isinstance<TriangleMesh>(surface)) {
    return MakeCaster(surface.cast<std::shared_ptr<TriangleMesh>>(), quality);
  }
  const auto found = ToGeometry(surface).Surface();
  if (found == nullptr) throw InputError("mesh: expected a mesh, a cloud or splats");
  return std::make_shared<Caster>(found);
}

void RequireRows(const char* name, size_t found, size_t expected) {
  if (found == expected) return;
  throw InputError(fmt::format("{}: expected {} rows, found {}", name, expected, found));
}

// Returns as many rows as there are points.
template <int kColumns, typename T>
std::vector<Eigen::Matrix<T, kColumns, 1>> RowsOf(const std::optional<ArrayLike>& argument,
                                                  const char* name, size_t count) {
  const Rows<kColumns, T> rows(argument, name);
  if (argument) RequireRows(name, rows.size(), count);
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
  cloud.colors_rgb = ToColors(colors, "colors");
  if (colors) RequireRows("colors", cloud.colors_rgb.size(), count);
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

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// Rays from arrays that Python gave.
class GivenRays {
 public:
  GivenRays(const ArrayLike& origins, const ArrayLike& directions, double t_near)
      : from_(origins, "origins"), along_(directions, "directions"), t_near_(t_near) {
    if (from_.size() != along_.size() && from_.size() != 1) {
      throw InputError(
          fmt::format("origins and directions: expected as many rows, or one origin, "
                      "found {} and {}",
                      from_.size(), along_.size()));
    }
  }

  size_t size() const { return along_.size(); }
  Ray operator[](size_t i) const { return {from_[from_.size() == 1 ? 0 : i], along_[i], t_near_}; }

  bool StartAtOnePoint() const {
    for (size_t i = 1; i < from_.size(); ++i) {
      if (from_[i] != from_[0]) return false;
    }
    return true;
  }

 private:
  Rows<3> from_, along_;
  double t_near_;
};

// Works in blocks, so that many rays are shared by many threads.
template <typename Work>
void ForRays(size_t count, int threads, const Work& work) {
  constexpr size_t kBlock = 4096;
  ParallelFor((count + kBlock - 1) / kBlock, threads,
              [&](size_t block) { work(block * kBlock, std::min(count, (block + 1) * kBlock)); });
}

// The arrays that cast() returns, filled row by row.
class HitArrays {
 public:
  explicit HitArrays(py::ssize_t count)
      : ray_t_(count),
        points_({count, py::ssize_t{3}}),
        normals_({count, py::ssize_t{3}}),
        triangles_(count),
        barycentric_({count, py::ssize_t{2}}),
        ray_t_data_(ray_t_.mutable_data()),
        points_data_(points_.mutable_data()),
        normals_data_(normals_.mutable_data()),
        triangles_data_(triangles_.mutable_data()),
        barycentric_data_(barycentric_.mutable_data()) {}

  // May be called without the interpreter's lock.
  void Set(size_t i, const Ray& ray, const std::optional<RayHit>& hit) {
    const Eigen::Vector3d none = Eigen::Vector3d::Constant(kNaN);
    ray_t_data_[i] = hit ? hit->ray_t : kNaN;
    triangles_data_[i] = hit ? int64_t{hit->triangle} : -1;
    Eigen::Vector3d::Map(points_data_ + 3 * i) =
        hit ? ray.origin_in_world + hit->ray_t * ray.direction_in_world : none;
    Eigen::Vector3d::Map(normals_data_ + 3 * i) = hit ? hit->normal_in_world : none;
    Eigen::Vector2d::Map(barycentric_data_ + 2 * i) =
        hit ? hit->barycentric : Eigen::Vector2d(kNaN, kNaN);
  }

  py::dict ToDict() const {
    py::dict result;
    result["ray_t"] = ray_t_;
    result["points"] = points_;
    result["normals"] = normals_;
    result["triangles"] = triangles_;
    result["barycentric"] = barycentric_;
    return result;
  }

 private:
  py::array_t<double> ray_t_, points_, normals_;
  py::array_t<int64_t> triangles_;
  py::array_t<double> barycentric_;
  double *ray_t_data_, *points_data_, *normals_data_;
  int64_t* triangles_data_;
  double* barycentric_data_;
};

// Returns whether the rays run so close together, as those of a picture's row, that packets are
// faster.
bool AreCoherent(std::span<const Ray> rays) {
  constexpr double kLeastCosine = 0.99;
  const Eigen::Vector3d& first = rays.front().direction_in_world;
  return std::all_of(rays.begin(), rays.end(), [&](const Ray& ray) {
    const Eigen::Vector3d& along = ray.direction_in_world;
    return ray.origin_in_world == rays.front().origin_in_world &&
           along.dot(first) > kLeastCosine * along.norm() * first.norm();
  });
}

RayBlock BlockOf(std::span<const Ray> rays) {
  RayBlock block;
  for (size_t i = 0; i < rays.size(); ++i) {
    const Eigen::Vector3f along = rays[i].direction_in_world.normalized().cast<float>();
    block.x[i] = along.x();
    block.y[i] = along.y();
    block.z[i] = along.z();
  }
  return block;
}

void CastTogether(const RayCaster& caster, std::span<const Ray> rays,
                  std::vector<std::optional<RayHit>>& hits) {
  const Eigen::Vector3d& origin = rays.front().origin_in_world;
  const RayBlock block = BlockOf(rays);
  HitBlock found;
  caster.CastBlocks(origin, {&block, 1}, {&found, 1});
  for (size_t i = 0; i < rays.size(); ++i) {
    hits.emplace_back();
    if (found.triangle[i] == HitBlock::kNoTriangle) continue;
    const Eigen::Vector3d& direction = rays[i].direction_in_world;
    hits.back() = caster.RefineHit(origin, direction, found.triangle[i],
                                   double{found.ray_t[i]} / direction.norm());
  }
}

// Casts like RayCaster::Cast(), with coherent rays in packets.
std::vector<std::optional<RayHit>> CastInPackets(const RayCaster& caster,
                                                 std::span<const Ray> rays) {
  std::vector<std::optional<RayHit>> hits;
  hits.reserve(rays.size());
  const auto cast_until = [&](size_t end) {
    const auto found = caster.Cast(rays.subspan(hits.size(), end - hits.size()));
    hits.insert(hits.end(), found.begin(), found.end());
  };
  for (size_t begin = 0; begin + RayBlock::kSize <= rays.size(); begin += RayBlock::kSize) {
    const auto some = rays.subspan(begin, RayBlock::kSize);
    if (!AreCoherent(some)) continue;
    cast_until(begin);
    CastTogether(caster, some, hits);
  }
  cast_until(rays.size());
  return hits;
}

// Returns whether most rays run close together with those beside them, judged by a sample.
bool RunTogether(const GivenRays& rays) {
  constexpr size_t kStep = 16 * RayBlock::kSize;
  size_t together = 0;
  size_t apart = 0;
  for (size_t begin = 0; begin + RayBlock::kSize <= rays.size(); begin += kStep) {
    std::array<Ray, RayBlock::kSize> some;
    for (size_t i = 0; i < some.size(); ++i) some[i] = rays[begin + i];
    (AreCoherent(some) ? together : apart) += 1;
  }
  return together >= apart;
}

// Returns the order in which rays from one point run close together with those beside them; empty
// if they do as they are given, or start at several points.
std::vector<uint32_t> OrderOf(const GivenRays& rays) {
  if (!rays.StartAtOnePoint() || RunTogether(rays)) return {};
  std::vector<Eigen::Vector3f> directions(rays.size(), Eigen::Vector3f::Zero());
  for (size_t i = 0; i < rays.size(); ++i) {
    const Eigen::Vector3d along = rays[i].direction_in_world;
    if (HasDirection(along)) directions[i] = along.normalized().cast<float>();
  }
  constexpr unsigned kBits = 7;  // cells of a degree, within which rays are coherent
  return OrderInSpace(directions, kBits);
}

py::dict CastRays(const Caster& caster, const ArrayLike& origins, const ArrayLike& directions,
                  double t_near, int threads) {
  const GivenRays given(origins, directions, t_near);
  HitArrays hits(static_cast<py::ssize_t>(given.size()));
  // Packets are for meshes, and start where their rays do.
  const bool has_packets = caster.caster->kind() == SurfaceKind::kMesh && t_near == 0;
  WithoutLock([&] {
    const std::vector<uint32_t> order = has_packets ? OrderOf(given) : std::vector<uint32_t>();
    const auto place = [&](size_t i) { return order.empty() ? i : order[i]; };
    ForRays(given.size(), threads, [&](size_t begin, size_t end) {
      std::vector<Ray> rays;
      rays.reserve(end - begin);
      for (size_t i = begin; i < end; ++i) rays.push_back(given[place(i)]);
      const auto found =
          has_packets ? CastInPackets(*caster.caster, rays) : caster.caster->Cast(rays);
      for (size_t i = begin; i < end; ++i) hits.Set(place(i), rays[i - begin], found[i - begin]);
    });
  });
  return hits.ToDict();
}

}  // namespace

std::shared_ptr<Caster> MakeCaster(const std::shared_ptr<TriangleMesh>& mesh,
                                   RayCasterOptions::BuildQuality quality) {
  auto caster = WithoutLock([&] {
    return std::make_shared<Caster>(
        std::make_shared<const RayCaster>(mesh, RayCasterOptions{.build_quality = quality}));
  });
  caster->build = quality;
  return caster;
}

void BindCasting(CasterClass& caster_class) {
  caster_class
      .def(
          "cast", &CastRays, py::arg("origins"), py::arg("directions"), py::kw_only(),
          py::arg("t_near") = 0.0, py::arg("threads") = 0,
          "The nearest hits of rays from origins (N, 3), or one (1, 3) for all, along directions\n"
          "(N, 3) of any length.\n\n"
          "Returns a dict: ray_t (N,), in lengths of the directions, NaN where nothing is hit; "
          "points\n"
          "and normals (N, 3) in the world (unit, by the triangles' winding), triangles (N,), -1:\n"
          "none; barycentric (N, 2): point = (1 - u - v) v0 + u v1 + v v2.")
      .def(
          "occluded",
          [](const Caster& caster, const ArrayLike& origins, const ArrayLike& directions,
             double t_near, int threads) {
            const GivenRays rays(origins, directions, t_near);
            py::array_t<bool> occluded(static_cast<py::ssize_t>(rays.size()));
            bool* const data = occluded.mutable_data();
            WithoutLock([&] {
              ForRays(rays.size(), threads, [&](size_t begin, size_t end) {
                for (size_t i = begin; i < end; ++i) data[i] = caster.caster->IsOccluded(rays[i]);
              });
            });
            return occluded;
          },
          py::arg("origins"), py::arg("directions"), py::kw_only(), py::arg("t_near") = 0.0,
          py::arg("threads") = 0, "Whether anything lies on each ray (N,), bool.");
}

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
          py::init(&CasterAt), py::arg("mesh"), py::kw_only(), py::arg("build") = "medium",
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
