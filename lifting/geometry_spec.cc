#include "raylift/lifting/geometry_spec.h"

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/lifting/mesh_source.h"
#include "raylift/renderers/triangle_mesh.h"

namespace raylift {
namespace {

[[noreturn]] void Fail(const std::string& spec, std::string_view constraint) {
  throw OptionError("--geometry", spec, constraint);
}

RayCasterOptions::BuildQuality ParseBuild(const std::string& spec, std::string_view value) {
  using enum RayCasterOptions::BuildQuality;
  if (value == "low") return kLow;
  if (value == "medium") return kMedium;
  Fail(spec, "expected build=low or build=medium");
}

NamedGeometry MakeMeshSource(const std::string& spec, std::string_view rest) {
  const auto parts = SplitBy(rest, ',');
  if (parts.front().empty()) {
    Fail(spec, "expected mesh:PATH[,key=value...]");
  }
  RayCasterOptions options{.build_quality = RayCasterOptions::BuildQuality::kLow};
  for (size_t i = 1; i < parts.size(); ++i) {
    const size_t equals = parts[i].find('=');
    const std::string_view key = parts[i].substr(0, equals);
    if (key != "build" || equals == std::string_view::npos) {
      Fail(spec, fmt::format("unknown key \"{}\"; a mesh has build=low|medium", key));
    }
    options.build_quality = ParseBuild(spec, parts[i].substr(equals + 1));
  }
  const std::filesystem::path path(parts.front());
  auto mesh = std::make_shared<const TriangleMesh>(ReadMesh(path));
  NamedGeometry geometry;
  geometry.warnings = mesh->warnings;
  geometry.mesh = std::make_shared<const RayCaster>(std::move(mesh), options);
  geometry.source =
      std::make_unique<MeshSource>(fmt::format("mesh:{}", path.string()), geometry.mesh);
  return geometry;
}

}  // namespace

NamedGeometry MakeGeometrySource(const std::string& spec) {
  const size_t colon = spec.find(':');
  if (spec.substr(0, colon) == "mesh" && colon != std::string::npos) {
    return MakeMeshSource(spec, std::string_view(spec).substr(colon + 1));
  }
  Fail(spec, "expected mesh:PATH[,key=value...]");
}

}  // namespace raylift
