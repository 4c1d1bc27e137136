// Geometry sources by name, as the option --geometry gives them.

#pragma once

#include <memory>
#include <string>
#include <vector>

#include "raylift/lifting/geometry_source.h"
#include "raylift/renderers/ray_caster.h"

namespace raylift {

struct NamedGeometry {
  std::unique_ptr<GeometrySource> source;
  std::shared_ptr<const RayCaster> mesh;  // of a mesh source, for pictures; else null
  std::vector<std::string> warnings;      // what the user should know of the file
};

// Opens "mesh:PATH[,key=value...]". Keys of a mesh: build=low (the default: fast to build) or
// build=medium (faster rays, worth it for many thousand references). OptionError for an unknown
// kind, key or value, InputError where the file cannot be read.
NamedGeometry MakeGeometrySource(const std::string& spec);

}  // namespace raylift
