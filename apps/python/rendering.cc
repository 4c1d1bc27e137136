// Rays cast at meshes, and pictures of them.

#include <limits>
#include <mutex>

#include "apps/python/geometry_source.h"
#include "base/progress.h"
#include "io/text/line_tokens.h"
#include "pictures/picture_codec.h"

#include "raylift/base/parallel.h"
#include "raylift/evaluation/depth_errors.h"
#include "raylift/io/view_list.h"
#include "raylift/renderers/frame_renderer.h"
#include "raylift/surfaces/point_cloud.h"
#include "raylift/surfaces/splats.h"
#include "raylift/views/render_job.h"
#include "raylift/views/view_sampler.h"

namespace raylift::python {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// Rays whose arrays were given.
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

 private:
  Rows<3> from_, along_;
  double t_near_;
};

// In blocks, so that many rays are shared by many threads.
template <typename Work>
void ForRays(size_t count, int threads, const Work& work) {
  constexpr size_t kBlock = 4096;
  ParallelFor((count + kBlock - 1) / kBlock, threads,
              [&](size_t block) { work(block * kBlock, std::min(count, (block + 1) * kBlock)); });
}

// What cast() returns, row by row.
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

  // Without the interpreter's lock.
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

// Whether the rays run so close together, as those of a picture's row, that packets are faster.
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

// RayCaster::Cast(), with coherent rays in packets.
std::vector<std::optional<RayHit>> CastGiven(const RayCaster& caster, std::span<const Ray> rays) {
  const bool has_packets = caster.kind() == SurfaceKind::kMesh && rays.front().ray_t_near == 0;
  std::vector<std::optional<RayHit>> hits;
  hits.reserve(rays.size());
  const auto cast_until = [&](size_t end) {
    const auto found = caster.Cast(rays.subspan(hits.size(), end - hits.size()));
    hits.insert(hits.end(), found.begin(), found.end());
  };
  for (size_t begin = 0; has_packets && begin + RayBlock::kSize <= rays.size();
       begin += RayBlock::kSize) {
    const auto some = rays.subspan(begin, RayBlock::kSize);
    if (!AreCoherent(some)) continue;
    cast_until(begin);
    CastTogether(caster, some, hits);
  }
  cast_until(rays.size());
  return hits;
}

py::dict CastRays(const Caster& caster, const ArrayLike& origins, const ArrayLike& directions,
                  double t_near, int threads) {
  const GivenRays given(origins, directions, t_near);
  HitArrays hits(static_cast<py::ssize_t>(given.size()));
  WithoutLock([&] {
    ForRays(given.size(), threads, [&](size_t begin, size_t end) {
      std::vector<Ray> rays;
      rays.reserve(end - begin);
      for (size_t i = begin; i < end; ++i) rays.push_back(given[i]);
      const auto found = CastGiven(*caster.caster, rays);
      for (size_t i = begin; i < end; ++i) hits.Set(i, rays[i - begin], found[i - begin]);
    });
  });
  return hits.ToDict();
}

// As the program: what has no colors needs light to show its shape.
ColorOptions::Shading ShadingOf(const RayCaster& caster) {
  return caster.HasColors() ? ColorOptions::Shading::kUnlit : ColorOptions::Shading::kHeadlight;
}

// What a call renders.
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
  // Before the maps of depth and triangles are handed over.
  if (std::find(products.begin(), products.end(), Product::kInverseDepth) != products.end()) {
    maps["inverse_depth"] = HandOver(InverseDepths(frame), {frame.height_px, frame.width_px});
  }
  if (std::find(products.begin(), products.end(), Product::kObject) != products.end()) {
    maps["object"] = HandOver(ObjectIds(frame, mesh), {frame.height_px, frame.width_px});
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
  std::vector<std::shared_ptr<const PixelRays>> rays;  // of each pose
  std::vector<Rigid3> poses;
};

// One camera for all poses, or one for each.
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

// How alike a view of the mesh and what is known of the photograph are; each is compared where it
// is given.
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

// Of the pixels that either shows, the share that both show.
double MaskScore(const bool* mask, const std::vector<float>& depth) {
  size_t both = 0, either = 0;
  for (size_t i = 0; i < depth.size(); ++i) {
    const bool seen = depth[i] > 0;
    both += seen && mask[i];
    either += seen || mask[i];
  }
  return either > 0 ? static_cast<double>(both) / static_cast<double>(either) : 0;
}

// Of the pixels with a known depth, the share whose rendered depth is within the tolerance of it.
double DepthScore(const float* known, const std::vector<float>& depth, double tolerance) {
  size_t count = 0, near = 0;
  for (size_t i = 0; i < depth.size(); ++i) {
    if (!(known[i] > 0) || !std::isfinite(known[i])) continue;
    ++count;
    near += depth[i] > 0 && std::abs(depth[i] - known[i]) <= tolerance * known[i];
  }
  return count > 0 ? static_cast<double>(near) / static_cast<double>(count) : 0;
}

// The mean of the given image over the depth edges of the view, its outline among them.
double EdgeScore(const float* edges, const Frame& frame) {
  DepthMap map{frame.width_px, frame.height_px, frame.depth};
  // What is not there is far off, so that outlines are edges, too.
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
    if (how == "cover") return SampleCovering(surface, options, {}).cam_from_world;
    throw OptionError("how", how, "expected around|inside|cover");
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

std::optional<py::bytes> PictureOf(const Caster& caster) {
  const TriangleMesh& mesh = caster.caster->mesh();
  if (mesh.triangles.empty()) return std::nullopt;
  return WithoutLock([&] {
    constexpr double kElevationDeg = 30;
    const Camera camera = ParseCamera("camera", "PINHOLE 480 360 400 400 240 180");
    const SampledViews view = SampleAround(
        *caster.caster,
        {.camera = camera, .count = 1, .up_in_world = EstimateUp(mesh).up_in_world, .clearance = 0},
        {.min_elevation_deg = kElevationDeg, .max_elevation_deg = kElevationDeg});
    FrameOptions options;
    options.color = true;
    options.color_options.shading = ShadingOf(*caster.caster);
    Frame frame;
    if (!view.cam_from_world.empty()) {
      FrameRenderer(caster.caster, options)
          .Render(PixelRays(camera, 0), view.cam_from_world.front(), 0, frame);
    }
    return EncodePng(frame.color);
  });
}

void BindRendering(py::module_& module) {
  const auto depth_alone = std::vector<std::string>{"depth"};
  py::class_<Caster, std::shared_ptr<Caster>>(
      module, "RayCaster", "Casts rays at a mesh, and renders what cameras see of it. Thread safe.")
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
"median", "expected" or "peak". `triangles` of cast() are indices of Gaussians.)")
      .def(
          "sample_views", &SampleViews, py::arg("camera"), py::arg("count") = 48, py::kw_only(),
          py::arg("how") = "around", py::arg("up") = py::none(), py::arg("clearance") = 0.3,
          py::arg("seed") = 0, py::arg("threads") = 0,
          R"(Poses (cam_from_world) that see a mesh, as of `raylift views`: how="around" it from outside,
"inside" it at eye height, or "cover" its surfaces; up: direction (3,) in the world, by
default the one that its surfaces tell. Fewer than `count` where there is no more room.)")
      .def_property_readonly(
          "mesh",
          [](const Caster& caster) {
            // Nothing in Python can change it.
            return std::const_pointer_cast<TriangleMesh>(
                std::shared_ptr<const TriangleMesh>(caster.caster, &caster.caster->mesh()));
          },
          "The Mesh.")
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
          py::arg("threads") = 0, "Whether anything lies on each ray (N,), bool.")
      .def("render", &Render, py::arg("camera"), py::arg("pose"), py::arg("products") = depth_alone,
           py::kw_only(), py::arg("threads") = 0,
           "What a camera sees from a pose (cam_from_world), a dict of arrays by product:\n\n"
           "depth      (H, W) float32, z along the optical axis, scene units; 0: no surface\n"
           "distance   (H, W) float32, along the ray; 0: no surface\n"
           "normals    (H, W, 3) float32, unit, toward the camera; 0: no surface\n"
           "color      (H, W, 3) uint8, RGB\n"
           "triangle   (H, W) uint32, index; 4294967295: none\n"
           "object     (H, W) uint32, which of several meshes; 4294967295: none\n"
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
}

}  // namespace raylift::python
