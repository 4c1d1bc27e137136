#include "raylift/lifting/mesh_spec.h"

#include <string>
#include <string_view>

#include "spec_keys.h"
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

constexpr std::string_view kPrefix = "mesh:";

using BuildQuality = RayCasterOptions::BuildQuality;
using BackFaces = SurfaceLimits::BackFaces;

std::string BuildKey() { return "build=" + NameList<BuildQuality>(); }

std::string FormOf(MeshUse use) {
  if (use == MeshUse::kLift) return "expected mesh:PATH[,key=value...]";
  return fmt::format("expected mesh:PATH[,{}]; only meshes are rendered", BuildKey());
}

std::string KeysOf(MeshUse use) {
  if (use == MeshUse::kRender) return BuildKey();
  return fmt::format(
      "near, far, max_incidence_deg, max_depth_jump, jump_radius_px, back_faces={}, {}",
      NameList<BackFaces>(), BuildKey());
}

void RefuseKeysOfLifting(const SpecKeys& keys) {
  for (const std::string key :
       {"near", "far", "max_incidence_deg", "max_depth_jump", "jump_radius_px", "back_faces"}) {
    if (!keys.Has(key)) continue;
    keys.Fail(fmt::format(
        "the key {} says which points are lifted, but here the whole mesh is rendered; there is {}",
        key, BuildKey()));
  }
}

}  // namespace

MeshSpec ParseMeshSpec(const std::string& spec, MeshUse use) {
  if (!spec.starts_with(kPrefix)) throw OptionError("geometry", spec, FormOf(use));
  SpecKeys keys(spec, std::string_view(spec).substr(kPrefix.size()));
  if (keys.path().empty()) keys.Fail(FormOf(use));
  if (use == MeshUse::kRender) RefuseKeysOfLifting(keys);
  MeshSpec mesh{.files = keys.path()};
  mesh.build = keys.TakeNamed<BuildQuality>("build");
  keys.TakeLimits(mesh.options.limits);
  const auto back_faces = keys.TakeNamed<BackFaces>("back_faces");
  mesh.options.limits.back_faces = back_faces.value_or(mesh.options.limits.back_faces);
  mesh.options.jump_radius_px =
      keys.TakeNumber("jump_radius_px", 0).value_or(mesh.options.jump_radius_px);
  keys.ExpectAllTaken(KeysOf(use));
  return mesh;
}

}  // namespace raylift
