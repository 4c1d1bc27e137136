// Specifications "kind:PATH,key=value,...": their parts by key, and those of surfaces.

#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "lifting/mesh_placement.h"

#include "raylift/base/enum_names.h"
#include "raylift/lifting/geometry_source.h"
#include "raylift/lifting/mesh_source.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/surfaces/mesh_files.h"
#include "raylift/surfaces/point_cloud.h"
#include "raylift/surfaces/splats.h"

namespace raylift {

// The parts of a specification by key.
class SpecKeys {
 public:
  // Splits at commas: the first part is the path, each other one a key and its value. Throws
  // OptionError where a part has no "=" or a key stands twice.
  SpecKeys(std::string spec, std::string_view rest);

  const std::string& path() const { return path_; }

  bool Has(const std::string& key) const { return values_.contains(key); }

  // Returns the value of a key, and marks the key as taken.
  std::optional<std::string> Take(const std::string& key);
  // Return it as numbers; throw OptionError where it is none or below the minimum.
  std::optional<double> TakeNumber(const std::string& key, double minimum);
  std::vector<double> TakeNumbers(const std::string& key);  // separated by "/"

  // Returns it as the enum's value of that name; throws OptionError where there is none.
  template <NamedEnum Enum>
  std::optional<Enum> TakeNamed(const std::string& key) {
    const auto text = Take(key);
    if (!text) return std::nullopt;
    const auto value = FromName<Enum>(*text);
    if (!value) Fail("expected " + key + "=" + NameList<Enum>());
    return value;
  }

  // Takes the limits that all surfaces have: near, far, max_incidence_deg, max_depth_jump.
  void TakeLimits(SurfaceLimits& limits);

  // Throws OptionError where a key was not taken; `known` lists the keys that there are.
  void ExpectAllTaken(std::string_view known) const;

  [[noreturn]] void Fail(std::string_view constraint) const;

 private:
  std::string spec_;
  std::string path_;
  std::map<std::string, std::string> values_;
};

// One grammar names surfaces for all who lift from them or render them: a mesh,
// "mesh:PATH[,key=value...]" or "dsm:FILE[,key=value...]", a point cloud,
// "cloud:PATH[,key=value...]", or Gaussian splats, "splat:FILE[,key=value...]".

struct MeshSpec {
  std::string files;  // as ListMeshFiles takes them
  bool is_height_field = false;
  std::optional<std::string> orthophotos = std::nullopt;  // of a height field, named likewise
  std::optional<double> level_of_detail = std::nullopt;   // of city models
  // The quality of the acceleration structure, where the specification says it. The default is low
  // for lifting, which casts few rays, and medium for rendering.
  std::optional<RayCasterOptions::BuildQuality> build = std::nullopt;
  MeshPlacement placement = {};
  MeshOptions options = {};  // which points are lifted
  TileOptions tiles = {};    // of 3D Tiles
};

enum class MeshUse {
  kLift,
  // The whole mesh is drawn: the keys that say which points are lifted are refused.
  kRender,
};

// Returns whether it is "mesh:PATH..." or "dsm:FILE...", a height field.
bool IsMeshSpec(std::string_view spec);

// Parses the specification. Throws OptionError where it is not one of a mesh, or has an unknown key
// or value.
MeshSpec ParseMeshSpec(const std::string& spec, MeshUse use);

// Returns whether the mesh may name the system of its coordinates (TriangleMesh::crs).
bool MayNameSystem(const std::string& spec);

// Returns specifications of which those of earth-centered 3D Tiles that do not say crs= are led to
// the world's system. Throws InputError where such a file cannot be read.
std::vector<std::string> InWorld(std::vector<std::string> specs,
                                 const std::optional<WorldFrame>& world);

// Returns its files, and reads one of them, or all as one mesh, put where they belong. Throws
// InputError where a key is for city models or 3D Tiles and no file is one.
std::vector<std::filesystem::path> FilesOf(const MeshSpec& spec);
TriangleMesh OpenMesh(const MeshSpec& spec, const std::filesystem::path& file, int threads);
TriangleMesh OpenMesh(const MeshSpec& spec, int threads);

// A point cloud has the keys of a mesh except those of front and back; `surfels` says how its discs
// are made.
struct CloudSpec : MeshSpec {
  SurfelOptions surfels = {};
};
CloudSpec ParseCloudSpec(const std::string& spec, MeshUse use);

// Splats have the keys of a mesh except those of front and back; `depth` says where their surface
// is taken to be, `transform` names the frame that they were trained in.
struct SplatSpec : MeshSpec {
  SplatDepth depth = SplatDepth::kMedian;
  // nerfstudio's dataparser_transforms.json is undone before the placement: this is its path, empty
  // for the one beside the splats, if there is one, or "none".
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
