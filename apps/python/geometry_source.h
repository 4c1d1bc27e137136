// The state of the module's classes of geometry, RayCaster among them.

#pragma once

#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "apps/python/conversions.h"

#include "raylift/lifting/geometry_source.h"
#include "raylift/lifting/geometry_spec.h"
#include "raylift/renderers/frame_renderer.h"
#include "raylift/renderers/pixel_rays.h"
#include "raylift/renderers/ray_caster.h"

// Is an argument that stands for geometry: a Geometry, a RayCaster, a Mesh, or a specification as
// the option --geometry takes it, which may need the references and their model.
RAYLIFT_PYTHON_ARGUMENT(GeometryLike, IsSomething, "raylift._types.GeometryLike")

namespace raylift::python {

// Keeps the rays of the camera that was used last: most views share one camera, and distorted
// lenses are slow to invert. Thread safe.
class LastRays {
 public:
  std::shared_ptr<const PixelRays> Of(const Camera& camera, int threads);

 private:
  std::mutex mutex_;
  Camera camera_;
  std::shared_ptr<const PixelRays> rays_;
};

// Keeps the renderer of the options that were used last: textures are filtered once for all views.
// Thread safe.
class LastRenderer {
 public:
  std::shared_ptr<const FrameRenderer> Of(const std::shared_ptr<const RayCaster>& caster,
                                          const FrameOptions& options);

 private:
  std::mutex mutex_;
  FrameOptions options_;
  std::shared_ptr<const FrameRenderer> renderer_;
};

struct Caster {
  explicit Caster(std::shared_ptr<const RayCaster> ray_caster) : caster(std::move(ray_caster)) {}

  std::shared_ptr<const RayCaster> caster;
  RayCasterOptions::BuildQuality build = RayCasterOptions::BuildQuality::kMedium;
  LastRays rays;
  LastRenderer renderer;
};

std::shared_ptr<Caster> MakeCaster(const std::shared_ptr<TriangleMesh>& mesh,
                                   RayCasterOptions::BuildQuality quality);

// The module's class; each function binds a part of it: its constructors, its rays.
using CasterClass = py::class_<Caster, std::shared_ptr<Caster>>;
void BindMaking(CasterClass& caster_class);
void BindCasting(CasterClass& caster_class);

// Returns a picture of what a camera sees of a surface in its colors, at most `kPictureSidePx` wide
// and high.
inline constexpr int kPictureSidePx = 640;
Image PictureFrom(const std::shared_ptr<const RayCaster>& surface, const Camera& camera,
                  const Rigid3& cam_from_world);
// Returns a PNG of a mesh seen from outside; nullopt where it has no triangles.
std::optional<py::bytes> PictureOf(const Caster& caster);

// The end of a description of geometry that is in memory.
inline constexpr std::string_view kFromMemory = " from memory";

// Geometry of any kind.
struct Geometry {
  explicit Geometry(NamedGeometry opened) : named(std::move(opened)) {}
  Geometry(NamedGeometry opened, std::string opened_spec, const GeometryContext& context)
      : named(std::move(opened)),
        spec(std::move(opened_spec)),
        model(context.model),
        references(context.references.begin(), context.references.end()) {}
  virtual ~Geometry() = default;

  NamedGeometry named;
  // The arguments that it was opened from, by which it pickles; the text is empty for geometry in
  // memory.
  std::string spec = {};
  std::filesystem::path model = {};
  std::vector<PosedImage> references = {};
};
struct DepthMaps final : Geometry {
  using Geometry::Geometry;
};
struct SfmPoints final : Geometry {
  using Geometry::Geometry;
};

// Returns the text that the geometry was opened from, else its mesh or depth maps. Throws
// InputError for other geometry.
py::tuple StateOf(const Geometry& geometry);
Geometry GeometryOf(const py::tuple& state);

NamedGeometry ToGeometry(const GeometryLike& geometry, const GeometryContext& context = {});

// Returns "KIND:PATH,key=value,...", as the option --geometry takes it, from keywords.
std::string SpecOf(const std::string& kind, const std::filesystem::path& path,
                   const py::kwargs& keys);

}  // namespace raylift::python
