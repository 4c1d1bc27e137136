// What the classes of geometry in the module hold.

#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "conversions.h"
#include "mesh.h"

#include "raylift/lifting/geometry_source.h"
#include "raylift/lifting/geometry_spec.h"

namespace raylift::python {

// Geometry of any kind.
struct Geometry {
  explicit Geometry(NamedGeometry opened) : named(std::move(opened)) {}
  virtual ~Geometry() = default;

  NamedGeometry named;
};
struct DepthMaps final : Geometry {
  using Geometry::Geometry;
};
struct SfmPoints final : Geometry {
  using Geometry::Geometry;
};

// Arguments that stand for geometry: a Geometry, a RayCaster, a Mesh, or a specification as the option
// --geometry takes it, which may need the references and their model.
class GeometryLike : public py::object {
 public:
  PYBIND11_OBJECT(GeometryLike, py::object, IsSomething)
};
NamedGeometry ToGeometry(const GeometryLike& geometry, const GeometryContext& context = {});

// "KIND:PATH,key=value,...", as the option --geometry takes it, from keywords.
std::string SpecOf(const std::string& kind, const std::filesystem::path& path,
                   const py::kwargs& keys);

}  // namespace raylift::python

namespace pybind11::detail {
template <>
struct handle_type_name<raylift::python::GeometryLike> {
  static constexpr auto name = const_name("raylift._types.GeometryLike");
};
}  // namespace pybind11::detail
