// Reads CityJSON 1.0 to 2.0 (cityjson.org): surfaces are lists of indices into vertices, which are
// integers to be scaled and shifted.

#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <utility>

#include "surfaces/city_model.h"
#include "surfaces/file_readers.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

using Eigen::Vector3d;
using Json = nlohmann::json;

// Lists around the surfaces of a geometry: 1 of surfaces, 2 of shells, 3 of solids.
const std::map<std::string, int, std::less<>> kListsOfType = {{"MultiSurface", 1},
                                                              {"CompositeSurface", 1},
                                                              {"Solid", 2},
                                                              {"MultiSolid", 3},
                                                              {"CompositeSolid", 3}};

// Returns whether an object is inside another one, where it is not seen.
bool IsInteriorType(std::string_view type) {
  return type.ends_with("Room") || type.ends_with("Storey") || type.ends_with("Unit") ||
         type.ends_with("HollowSpace") || (type.ends_with("Furniture") && type != "CityFurniture");
}

const Json kNull;

// Return an object's member and a list's item; null where it has none, or is no such thing.
const Json& MemberOrNull(const Json& value, const char* name) {
  const auto found = value.find(name);
  return found == value.end() ? kNull : *found;
}

const Json& ItemOrNull(const Json& value, size_t index) {
  return value.is_array() && index < value.size() ? value[index] : kNull;
}

// Returns the type of an object or a geometry; empty where it has none.
std::string TypeOf(const Json& object) {
  const Json& type = MemberOrNull(object, "type");
  return type.is_string() ? type.get<std::string>() : "";
}

// Holds the corners of surfaces, which are vertices of the file or of a template that is moved, and
// the kinds of surfaces.
struct Vertices {
  const std::vector<Vector3d>& points;
  std::optional<Eigen::Matrix<double, 3, 4>> world_from_template;
  const Json& kinds;
};

// The geometry that is taken of an object, if it has any.
struct Chosen {
  std::string place;
  const Json* geometry = nullptr;
  double level = 0;
};

// Returns whether a building's own geometry gives way to that of its parts; other children, as
// chimneys, do not replace it.
bool HasFinerPart(const Json& objects, const Json& object, const Chosen& own,
                  const std::map<std::string, Chosen>& chosen) {
  const Json& children = MemberOrNull(object, "children");
  if (!children.is_array()) return false;
  return std::any_of(children.begin(), children.end(), [&](const Json& child) {
    const auto found = child.is_string() ? chosen.find(child.get<std::string>()) : chosen.end();
    return found != chosen.end() && found->second.geometry != nullptr &&
           found->second.level > own.level && TypeOf(objects[found->first]).ends_with("Part");
  });
}

// Returns what JSON holds, or throws an error that names the file and the place.
class JsonInFile {
 public:
  explicit JsonInFile(const std::filesystem::path& path) : path_(path) {}

  [[noreturn]] void Fail(std::string_view place, std::string_view message) const {
    throw InputError(path_, place, message);
  }

  const Json& Member(const std::string& place, const Json& object, const char* name) const {
    const auto found = object.find(name);
    if (!object.is_object() || found == object.end()) Fail(place, "is missing");
    return *found;
  }

  std::string Text(const std::string& place, const Json& object, const char* name) const {
    const Json& value = Member(place, object, name);
    if (!value.is_string()) Fail(place, "expected a text");
    return value.get<std::string>();
  }

  const Json& List(const std::string& place, const Json& value) const {
    if (!value.is_array()) Fail(place, "expected a list");
    return value;
  }

  Vector3d Point(const CityMesh::Locator& locate, const Json& value) const {
    const bool good = value.is_array() && value.size() == 3 && value[0].is_number() &&
                      value[1].is_number() && value[2].is_number();
    if (!good) Fail(locate(), "expected three numbers");
    return {value[0].get<double>(), value[1].get<double>(), value[2].get<double>()};
  }

  std::vector<Vector3d> Points(const std::string& place, const Json& list) const {
    std::vector<Vector3d> points;
    points.reserve(List(place, list).size());
    for (const Json& point : list) {
      points.push_back(Point([&] { return fmt::format("{}[{}]", place, points.size()); }, point));
    }
    return points;
  }

 private:
  const std::filesystem::path& path_;
};

class CityJsonReader : JsonInFile {
 public:
  CityJsonReader(const std::filesystem::path& path, std::string_view contents,
                 std::optional<double> level)
      : JsonInFile(path), level_(level), mesh_(path, contents.size()) {
    // Its parser calls itself for nothing, however deep lists are nested.
    root_ = Json::parse(contents, nullptr, /*allow_exceptions=*/false);
    if (!root_.is_object()) {
      Fail("JSON",
           "expected one object, the file is damaged, truncated or CityJSONSeq, which `cjseq "
           "collect` makes CityJSON of");
    }
  }

  RawMesh Read() && {
    if (Text("type", root_, "type") != "CityJSON") Fail("type", "expected \"CityJSON\"");
    const std::string version = Text("version", root_, "version");
    if (!version.starts_with("1.") && !version.starts_with("2.")) {
      Fail("version", "expected 1.0, 1.1 or 2.0");
    }
    ReadVertices();
    const Json& objects = Member("CityObjects", root_, "CityObjects");
    if (!objects.is_object()) Fail("CityObjects", "expected an object");
    std::map<std::string, Chosen> chosen;
    for (const auto& [id, object] : objects.items()) chosen.emplace(id, Choose(id, object));
    for (const auto& [id, choice] : chosen) {
      if (choice.geometry != nullptr && !HasFinerPart(objects, objects[id], choice, chosen)) {
        mesh_.BeginObject(id);
        AddGeometry(choice.place, *choice.geometry);
      }
    }
    CheckSystem();
    return std::move(mesh_).Finish();
  }

 private:
  void ReadVertices() {
    vertices_ = Points("vertices", Member("vertices", root_, "vertices"));
    const auto transform = root_.find("transform");
    if (transform == root_.end()) return;  // in 1.0 it may be missing
    const auto point = [&](const char* name) {
      const auto place = [&] { return fmt::format("transform.{}", name); };
      return Point(place, Member(place(), *transform, name));
    };
    const Vector3d scale = point("scale"), translate = point("translate");
    for (Vector3d& vertex : vertices_) vertex = vertex.cwiseProduct(scale) + translate;
  }

  // Returns the level of detail, "2.1" or in 1.0 also a number; 0 where there is none.
  double LevelOf(const std::string& place, const Json& geometry) const {
    const auto found = geometry.find("lod");
    if (found == geometry.end()) return 0;
    const auto level = found->is_number()   ? std::optional(found->get<double>())
                       : found->is_string() ? ParseDouble(found->get<std::string>())
                                            : std::nullopt;
    if (!level || !std::isfinite(*level)) Fail(place + ".lod", "expected a level as \"2.2\"");
    return *level;
  }

  // Returns what a geometry is an instance of; null of others.
  const Json* TemplateOf(const std::string& place, const Json& geometry) const {
    if (TypeOf(geometry) != "GeometryInstance") return nullptr;
    const Json& index = Member(place + ".template", geometry, "template");
    const Json& all = Member("geometry-templates", root_, "geometry-templates");
    const Json& list = Member("geometry-templates.templates", all, "templates");
    if (!index.is_number_unsigned() || !list.is_array() || index.get<uint64_t>() >= list.size()) {
      Fail(place + ".template", "expected an index of one of the templates");
    }
    return &list[index.get<size_t>()];
  }

  // Returns the geometry of the level that is taken.
  Chosen Choose(const std::string& id, const Json& object) const {
    const std::string place = fmt::format("CityObjects.{}", id);
    if (!object.is_object()) Fail(place, "expected an object");
    const auto geometries = object.find("geometry");
    if (geometries == object.end() || IsInteriorType(TypeOf(object))) return {};
    List(place + ".geometry", *geometries);
    std::vector<Chosen> candidates;
    std::vector<double> levels;
    for (size_t i = 0; i < geometries->size(); ++i) {
      const Json& geometry = (*geometries)[i];
      const std::string at = fmt::format("{}.geometry[{}]", place, i);
      if (!geometry.is_object()) Fail(at, "expected an object");
      const Json* const model = TemplateOf(at, geometry);
      const Json& shape = model == nullptr ? geometry : *model;
      if (!shape.is_object() || !kListsOfType.contains(TypeOf(shape))) continue;
      levels.push_back(LevelOf(at, shape));
      candidates.push_back({at, &geometry, levels.back()});
    }
    const auto chosen = ChooseLevel(levels, level_);
    return chosen ? candidates[*chosen] : Chosen{};
  }

  void AddGeometry(const std::string& place, const Json& geometry) {
    const Json* const model = TemplateOf(place, geometry);
    const Json& shape = model == nullptr ? geometry : *model;
    const Json& boundaries = Member(place + ".boundaries", shape, "boundaries");
    const int lists = kListsOfType.at(TypeOf(shape));
    const Json& semantics = MemberOrNull(shape, "semantics");
    const Json& kinds = MemberOrNull(semantics, "surfaces");
    const Json& values = MemberOrNull(semantics, "values");
    if (model == nullptr) {
      AddSurfaces(place + ".boundaries", boundaries, lists, {vertices_, std::nullopt, kinds},
                  values);
    } else {
      AddSurfaces(place + ".boundaries", boundaries, lists,
                  {TemplateVertices(), WorldFromTemplate(place, geometry), kinds}, values);
    }
  }

  // Returns the vertices of all templates, which the first instance of one reads.
  const std::vector<Vector3d>& TemplateVertices() {
    if (!template_vertices_) {
      const Json& all = Member("geometry-templates", root_, "geometry-templates");
      template_vertices_ =
          Points("vertices-templates", Member("vertices-templates", all, "vertices-templates"));
    }
    return *template_vertices_;
  }

  Eigen::Matrix<double, 3, 4> WorldFromTemplate(const std::string& place,
                                                const Json& instance) const {
    const Json& matrix = Member(place + ".transformationMatrix", instance, "transformationMatrix");
    const bool good = matrix.is_array() && matrix.size() == 16 &&
                      std::all_of(matrix.begin(), matrix.end(),
                                  [](const Json& value) { return value.is_number(); });
    if (!good) Fail(place + ".transformationMatrix", "expected 16 numbers");
    Eigen::Matrix<double, 3, 4> rows;
    for (int i = 0; i < 12; ++i) rows(i / 4, i % 4) = matrix[static_cast<size_t>(i)].get<double>();
    const Json& at = Member(place + ".boundaries", instance, "boundaries");
    if (List(place + ".boundaries", at).size() != 1) {
      Fail(place + ".boundaries", "expected one index of a vertex");
    }
    rows.col(3) += VertexAt(place + ".boundaries", at[0], vertices_);
    return rows;
  }

  const Vector3d& VertexAt(const std::string& place, const Json& index,
                           const std::vector<Vector3d>& vertices) const {
    if (!index.is_number_unsigned() || index.get<uint64_t>() >= vertices.size()) {
      Fail(place, fmt::format("expected an index of one of {} vertices", vertices.size()));
    }
    return vertices[index.get<size_t>()];
  }

  // Adds the surfaces of boundaries, which stand in so many `lists`, one within the other. `kinds`
  // has, in lists like those of the boundaries, an index into the vertices' kinds for each surface.
  void AddSurfaces(const std::string& place, const Json& boundaries, int lists,
                   const Vertices& vertices, const Json& kinds) {
    List(place, boundaries);
    constexpr size_t kReads = 10;  // a list takes as long as some corners, and may be empty
    mesh_.CountRead([&] { return place; }, kReads);
    for (size_t i = 0; i < boundaries.size(); ++i) {
      std::string at = fmt::format("{}[{}]", place, i);
      if (lists > 1) {
        AddSurfaces(at, boundaries[i], lists - 1, vertices, ItemOrNull(kinds, i));
        continue;
      }
      std::vector<std::vector<Vector3d>> rings;
      for (const Json& ring : List(at, boundaries[i])) {
        rings.emplace_back();
        for (const Json& index : List(at, ring)) {
          rings.back().push_back(VertexAt(at, index, vertices.points));
        }
        if (!vertices.world_from_template) continue;
        for (Vector3d& p : rings.back()) {
          p = (*vertices.world_from_template * p.homogeneous()).eval();
        }
      }
      const Json& kind = ItemOrNull(kinds, i);
      mesh_.AddPolygon(
          [&] { return at; }, std::move(rings),
          kind.is_number_unsigned() ? TypeOf(ItemOrNull(vertices.kinds, kind.get<size_t>())) : "");
    }
  }

  void CheckSystem() {
    const Json& system = MemberOrNull(MemberOrNull(root_, "metadata"), "referenceSystem");
    if (system.is_string()) {
      mesh_.CheckPlace("metadata.referenceSystem", system.get<std::string>());
    }
  }

  std::optional<double> level_;
  CityMesh mesh_;
  Json root_;
  std::vector<Vector3d> vertices_;
  std::optional<std::vector<Vector3d>> template_vertices_;
};

}  // namespace

RawMesh ReadCityJson(const std::filesystem::path& path, std::string_view contents,
                     std::optional<double> level) {
  return CityJsonReader(path, contents, level).Read();
}

}  // namespace raylift
