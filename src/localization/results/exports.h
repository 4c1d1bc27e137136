// Exports results for other programs, and people, to look at: a COLMAP model, a GLB, pictures.

#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <span>
#include <string>

#include <Eigen/Core>

#include "raylift/base/enum_names.h"
#include "raylift/io/colmap_model.h"
#include "raylift/localization/localizer.h"
#include "raylift/localization/scene.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/scene/image.h"
#include "raylift/scene/photographs.h"
#include "raylift/surfaces/triangle_mesh.h"

namespace raylift {

// Exports localized queries as images of a COLMAP model beside the references, for COLMAP's GUI and
// all viewers of such models.

// Returns a model of the references in use with their SfM points, as far as their model has some,
// and of the localized queries without points of their own; where a query is also a reference, its
// new pose counts. Rigs and frames are left out, since queries have none. A camera whose focal
// length was refined is its query's own.
ColmapModel LocalizedModel(const ReferenceSet& references, std::span<const Query> queries,
                           std::span<const LocalizedQuery> localized);

// Writes a scene and its cameras as one GLB (binary glTF 2.0), for Blender, MeshLab and viewers on
// the web.

enum class GlbCameraKind { kReference, kLocalized, kDoubtful };
template <>
inline constexpr auto kEnumNames<GlbCameraKind> = std::to_array<EnumName<GlbCameraKind>>({
    {GlbCameraKind::kReference, "references"},
    {GlbCameraKind::kLocalized, "localized"},
    {GlbCameraKind::kDoubtful, "doubtful"},
});

struct GlbCamera {
  PosedImage image;
  GlbCameraKind kind = GlbCameraKind::kReference;
};

struct GlbOptions {
  // A frustum has this length, in scene units; with nullopt it is a twentieth of the box of all
  // cameras, or of the mesh where they are in one place.
  std::optional<double> frustum_size = std::nullopt;
  // This direction becomes glTF's up, which is y; with nullopt coordinates stay the world's.
  std::optional<Eigen::Vector3d> up_in_world = std::nullopt;
};

// Writes a GLB. Each camera is a node of its image's name in the group of its kind: lines from its
// center through the corners of the image, blue for references, green for localized and orange for
// doubtful queries, and a glTF camera (a pinhole, as a GLB cannot hold other lenses). Numbers are
// float about an origin that the outermost node holds in double. The mesh keeps its textures (as
// JPEG) or its vertex colors, unlit; without them it is gray and lit.
void WriteGlb(const std::filesystem::path& path, const TriangleMesh* mesh,
              std::span<const GlbCamera> cameras, const GlbOptions& options = {});

// Draws a picture to judge a pose by: the photograph beside the mesh as seen from the estimated
// pose, with the inliers in both.

// Draws a localized query with its RGB image `photograph`. Keypoints of 2D-3D inliers are drawn in
// the photograph, their 3D points projected by the estimated pose in the rendering: both are at the
// same place where the pose is right.
Image DrawQueryPicture(const QueryResult& result, const Image& photograph, const RayCaster& mesh,
                       int threads);

}  // namespace raylift
