// Renders pictures of a mesh in place of reference photographs, for scenes that have none: views
// are sampled, rendered, and written as a COLMAP model and a folder of images.

#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/base/enum_names.h"
#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/io/colmap_model.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/scene/image.h"
#include "raylift/views/render_job.h"
#include "raylift/views/view_sampler.h"

namespace raylift {

enum class ViewKind {
  kAuto,    // inside where there is a ground and the mesh is seen well from it, else covering
  kInside,  // at eye height above the ground (SampleInside)
  kAround,  // on a sphere around the mesh (SampleAround)
  kCover,   // wherever there is room in front of surfaces (SampleCovering)
};
template <>
inline constexpr auto kEnumNames<ViewKind> = std::to_array<EnumName<ViewKind>>({
    {ViewKind::kAuto, "auto"},
    {ViewKind::kInside, "inside"},
    {ViewKind::kAround, "around"},
    {ViewKind::kCover, "cover"},
});

struct ViewsOfKind {
  ViewKind kind;  // that was taken for kAuto
  SampledViews views;
};
// Samples views of one kind. Around and covering views keep no further from surfaces than a
// twentieth of the mesh's size. Throws InputError where there is no place for a camera.
ViewsOfKind SampleViews(const RayCaster& mesh, ViewKind kind, const ViewSamplerOptions& options,
                        const InsideOptions& inside, const AroundOptions& around = {});

// Returns a pinhole camera whose pictures match those of the queries' cameras: of their median
// angle of view (at least 60 and at most 100 degrees wide), and as sharp as the median query in its
// middle, up to 1600 pixels. `size` and `fov_deg` (horizontal) override. Takes at least one query.
Camera CameraLikeQueries(std::span<const Camera> queries, const std::optional<PlaneSize>& size,
                         const std::optional<double>& fov_deg);

struct RenderedReferenceOptions {
  std::filesystem::path out;
  ViewKind kind = ViewKind::kAuto;
  ViewSamplerOptions views;  // camera, count, up, clearance, seed
  bool estimate_up = false;  // by EstimateUp(), with a warning where that is not z
  InsideOptions inside;
  int threads = 0;
};

struct RenderedReferences {
  std::filesystem::path model;   // OUT/model
  std::filesystem::path images;  // OUT/color
  ViewKind kind;                 // that was used
  size_t count = 0;
  size_t rendered = 0;  // the others were there already
  std::vector<std::string> warnings;
};

// Renders the views that are not in `out` yet from the same mesh and views; waits where another run
// does so. Pictures are unlit where the mesh has colors, else shaded by a light at the camera, with
// a warning. The bytes are the same for any number of threads. Throws InputError where there is no
// place for a camera, or a file cannot be written.
RenderedReferences RenderReferences(const std::shared_ptr<const RayCaster>& mesh,
                                    const RenderedReferenceOptions& options,
                                    const RenderHooks& hooks);

// Returns the colors with which a picture of this scene resembles a photograph: anti-aliased, on
// gray.
ColorOptions ColorsLikePhotographs(const RayCaster& scene);

// Makes a model of one camera and images "0000.jpg", ... With rig_cameras > 1 each pose is that of
// a rig of so many cameras at one place, turned to the right about the image's vertical by equal
// angles: images "camera0/0000.jpg", ..., and COLMAP's rigs and frames.
ColmapModel MakeSampledModel(const Camera& camera, std::span<const Rigid3> cam_from_world,
                             int rig_cameras);

}  // namespace raylift
