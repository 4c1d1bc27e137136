// A mesh by name, "mesh:PATH[,key=value...]", a point cloud, "cloud:PATH[,key=value...]", or
// Gaussian splats, "splat:FILE[,key=value...]": one grammar for all who lift from them or render
// them.

#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "lifting/mesh_placement.h"

#include "raylift/lifting/mesh_source.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/surfaces/point_cloud.h"
#include "raylift/surfaces/splats.h"

namespace raylift {

struct MeshSpec {
  std::string files;  // as ListMeshFiles takes them
  // How the acceleration structure is built, where the specification says it. What is not said is
  // low for lifting, which casts few rays, and medium for rendering.
  std::optional<RayCasterOptions::BuildQuality> build = std::nullopt;
  MeshPlacement placement = {};
  MeshOptions options = {};  // which points are lifted
};

enum class MeshUse {
  kLift,
  // The whole mesh is drawn: the keys that say which points are lifted are refused.
  kRender,
};

// OptionError where the specification is not one of a mesh, or has an unknown key or value.
MeshSpec ParseMeshSpec(const std::string& spec, MeshUse use);

// A point cloud has what a mesh has but for front and back; `surfels` says how discs are made of
// it.
struct CloudSpec : MeshSpec {
  SurfelOptions surfels = {};
};
CloudSpec ParseCloudSpec(const std::string& spec, MeshUse use);

// Splats have what a mesh has but for front and back; `depth` says where their surface is taken to
// be, `transform` what they were trained in.
struct SplatSpec : MeshSpec {
  SplatDepth depth = SplatDepth::kMedian;
  // nerfstudio's dataparser_transforms.json, which is undone before the placement: empty for the
  // one beside the splats, if there is one; "none".
  std::string transform = {};
};
SplatSpec ParseSplatSpec(const std::string& spec, MeshUse use);

// Returns the kind by the prefix: a mesh where that is neither "cloud:" nor "splat:".
SurfaceKind SurfaceKindOf(std::string_view spec);

// Reads the files and puts the points where they belong; rays are cast at their discs.
std::shared_ptr<const RayCaster> OpenCloud(const CloudSpec& spec, int threads,
                                           const RayCasterOptions& options);

// Reads the file and undoes what nerfstudio did to its frame. `transform` is the file that says it.
struct OpenedSplats {
  std::shared_ptr<const RayCaster> caster;
  std::optional<std::filesystem::path> transform;
};
OpenedSplats OpenSplats(const SplatSpec& spec, const RayCasterOptions& options);

}  // namespace raylift
