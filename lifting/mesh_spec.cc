#include "raylift/lifting/mesh_spec.h"

#include <array>
#include <string_view>
#include <utility>

#include "spec_keys.h"
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

constexpr std::string_view kPrefix = "mesh:";
constexpr std::string_view kForm = "expected mesh:PATH[,key=value...]";
constexpr std::string_view kRenderForm =
    "expected mesh:PATH[,build=low|medium]; only meshes are rendered";
constexpr std::string_view kKeys =
    "near, far, max_incidence_deg, max_depth_jump, jump_radius_px, back_faces=keep|drop, "
    "build=low|medium";

using BuildQuality = RayCasterOptions::BuildQuality;
constexpr std::array<std::pair<std::string_view, BuildQuality>, 2> kBuilds = {
    {{"low", BuildQuality::kLow}, {"medium", BuildQuality::kMedium}}};
using BackFaces = SurfaceLimits::BackFaces;
constexpr std::array<std::pair<std::string_view, BackFaces>, 2> kBackFaces = {
    {{"keep", BackFaces::kKeep}, {"drop", BackFaces::kDrop}}};

void RefuseKeysOfLifting(const SpecKeys& keys) {
  for (const std::string key :
       {"near", "far", "max_incidence_deg", "max_depth_jump", "jump_radius_px", "back_faces"}) {
    if (!keys.Has(key)) continue;
    keys.Fail(fmt::format(
        "the key {} says which points are lifted, but here the whole mesh is rendered; there is "
        "build=low|medium",
        key));
  }
}

}  // namespace

MeshSpec ParseMeshSpec(const std::string& spec, MeshUse use) {
  const std::string_view form = use == MeshUse::kRender ? kRenderForm : kForm;
  if (!spec.starts_with(kPrefix)) throw OptionError("--geometry", spec, form);
  SpecKeys keys(spec, std::string_view(spec).substr(kPrefix.size()));
  if (keys.path().empty()) keys.Fail(form);
  if (use == MeshUse::kRender) RefuseKeysOfLifting(keys);
  MeshSpec mesh{.files = keys.path()};
  mesh.build = keys.TakeWord("build", kBuilds);
  keys.TakeLimits(mesh.options.limits);
  const auto back_faces = keys.TakeWord("back_faces", kBackFaces);
  mesh.options.limits.back_faces = back_faces.value_or(mesh.options.limits.back_faces);
  mesh.options.jump_radius_px =
      keys.TakeNumber("jump_radius_px", 0).value_or(mesh.options.jump_radius_px);
  keys.ExpectAllTaken(use == MeshUse::kRender ? "build=low|medium" : kKeys);
  return mesh;
}

}  // namespace raylift
