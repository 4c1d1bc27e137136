// Reads CityGML 1.0 and 2.0 (OGC 12-019): objects with properties as lod2Solid, whose surfaces are
// polygons of GML 3.1 or refer to those of other properties.

#include <algorithm>
#include <map>
#include <set>
#include <string>
#include <unordered_map>
#include <utility>

#include "base/read_limits.h"
#include "surfaces/city_model.h"
#include "surfaces/file_readers.h"
#include <fmt/format.h>
#include <pugixml.hpp>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

using Eigen::Vector3d;
using pugi::xml_node;

// Returns the name without its prefix, which each file chooses itself.
std::string_view LocalName(std::string_view name) {
  const size_t colon = name.find(':');
  return colon == std::string_view::npos ? name : name.substr(colon + 1);
}

// Returns the element's name without its prefix.
std::string_view NameOf(const xml_node& node) { return LocalName(node.name()); }

// Returns the value of the first attribute of this name, whatever its prefix; empty without one.
std::string_view AttributeOf(const xml_node& node, std::string_view name) {
  for (const pugi::xml_attribute& attribute : node.attributes()) {
    if (LocalName(attribute.name()) == name) return attribute.value();
  }
  return {};
}

// Returns the level of a property as lod2Solid or lod3MultiSurface; nullopt of lines, points and
// implicit geometries.
std::optional<double> LevelOfProperty(std::string_view name) {
  if (name == "tin") return 1;  // of a relief, which has no other
  if (!name.starts_with("lod") || name.size() < 5 || name[3] < '0' || name[3] > '4') {
    return std::nullopt;
  }
  const std::string_view kind = name.substr(4);
  const bool has_surfaces = kind == "Solid" || kind == "MultiSurface" || kind == "Surface" ||
                            kind == "Geometry" || kind == "FootPrint" || kind == "RoofEdge";
  return has_surfaces ? std::optional(name[3] - '0') : std::nullopt;
}

// Returns whether a property is of rooms or what is in them, which are not seen from outside.
bool IsInterior(std::string_view name) {
  return name.starts_with("interior") && name != "interior";
}

// Returns the kind of surface that a polygon is of, as RoofSurface or Window; empty of others.
std::string_view KindOf(xml_node node) {
  for (; node; node = node.parent()) {
    const std::string_view above = NameOf(node.parent());
    if (above == "boundedBy" || above == "opening") return NameOf(node);
  }
  return {};
}

// Returns the kind of the element and the nearest name that the file gives.
std::string PathOf(xml_node node) {
  std::string kind(NameOf(node));
  for (; node; node = node.parent()) {
    const std::string_view id = AttributeOf(node, "id");
    if (!id.empty()) return fmt::format("{} of {}", kind, Printable(std::string(id)));
  }
  return kind;
}

class CityGmlReader {
 public:
  CityGmlReader(const std::filesystem::path& path, std::string_view contents,
                std::optional<double> level)
      : path_(path), level_(level), file_bytes_(contents.size()), mesh_(path, contents.size()) {
    // pugixml expands no entities of a file's own.
    const auto result = document_.load_buffer(contents.data(), contents.size());
    if (!result) Fail(fmt::format("byte {}", result.offset), result.description());
    if (NameOf(document_.document_element()) != "CityModel") {
      Fail("root element", "expected a CityModel (CityGML 2)");
    }
  }

  RawMesh Read() && {
    for (xml_node node = document_.document_element(); node; node = Next(node)) {
      if (const auto id = AttributeOf(node, "id"); !id.empty()) nodes_.emplace(id, node);
      if (system_.empty()) system_ = AttributeOf(node, "srsName");
    }
    for (const xml_node& member : document_.document_element().children()) {
      const std::string_view name = NameOf(member);
      if (name != "cityObjectMember" && name != "featureMember") continue;
      for (const xml_node& object : member.children()) AddObject(object);
    }
    if (implicit_ > 0) {
      mesh_.Warn(fmt::format("{} implicit geometries (trees, furniture) are left out", implicit_));
    }
    if (elsewhere_ > 0) {
      mesh_.Warn(
          fmt::format("{} references lead to other files or to nothing: left out", elsewhere_));
    }
    if (!system_.empty()) mesh_.CheckPlace("srsName", system_);
    return std::move(mesh_).Finish();
  }

 private:
  using Levels = std::map<double, std::vector<xml_node>>;

  // The properties of an object with surfaces, by their levels, and its parts.
  struct Object {
    Levels properties;
    Levels of_openings;  // windows and doors, which do not replace their wall
    std::vector<xml_node> parts;
    std::vector<xml_node> others;  // installations, which do not replace it
  };

  [[noreturn]] void Fail(std::string_view place, std::string_view message) const {
    throw InputError(path_, place, message);
  }

  // Returns the next element in the order of the file, and counts how deep it is.
  xml_node Next(xml_node node) {
    if (node.first_child()) {
      if (++depth_ > kMaxNodeNesting) Fail("XML", "elements are nested too deep");
      return node.first_child();
    }
    while (node && !node.next_sibling()) {
      node = node.parent();
      --depth_;
    }
    return node.next_sibling();
  }

  // Adds the properties below `node` to `levels`, those of openings to the object's: walls, roofs
  // and windows are of the building.
  void Collect(const xml_node& node, Object& object, Levels& levels) {
    for (const xml_node& child : node.children()) {
      const std::string_view name = NameOf(child);
      if (IsInterior(name)) continue;
      if (const auto level = LevelOfProperty(name)) {
        levels[*level].push_back(child);
      } else if (name.ends_with("ImplicitRepresentation")) {
        ++implicit_;
      } else if (name.starts_with("consistsOf")) {
        for (const xml_node& part : child.children()) object.parts.push_back(part);
      } else if (name.starts_with("outer")) {  // outerBuildingInstallation, outerBridgeConstruction
        object.others.push_back(child);
      } else {
        Collect(child, object, name == "opening" ? object.of_openings : levels);
      }
    }
  }

  // Returns the level that was taken of the object or its parts; 0 of none.
  double AddObject(const xml_node& node) {
    Object object;
    Collect(node, object, object.properties);
    if (object.properties.empty()) object.properties.swap(object.of_openings);
    double of_parts = 0;
    for (const xml_node& part : object.parts) of_parts = std::max(of_parts, AddObject(part));
    for (const xml_node& other : object.others) AddObject(other);
    std::vector<double> levels;
    for (const auto& [level, properties] : object.properties) levels.push_back(level);
    const auto chosen = ChooseLevel(levels, level_);
    if (!chosen || levels[*chosen] < of_parts) return of_parts;
    std::set<xml_node> seen;
    const std::string_view id = AttributeOf(node, "id");
    mesh_.BeginObject(std::string(id.empty() ? NameOf(node) : id));
    for (Levels* const of : {&object.properties, &object.of_openings}) {
      for (const xml_node& property : (*of)[levels[*chosen]]) AddSurfaces(property, seen, false, 0);
    }
    return levels[*chosen];
  }

  // Adds each polygon once, however many properties of the object lead to it; references in a
  // circle come to what was seen.
  void AddSurfaces(const xml_node& node, std::set<xml_node>& seen, bool is_reversed, int depth) {
    if (depth > kMaxNodeNesting) Fail("xlink:href", "references lead too deep");
    const std::string_view name = NameOf(node);
    if (const std::string_view link = AttributeOf(node, "href"); !link.empty()) {
      const auto target = link.starts_with('#') ? nodes_.find(link.substr(1)) : nodes_.end();
      if (target == nodes_.end()) {
        ++elsewhere_;
      } else {
        constexpr size_t kReads = 10;  // a byte of XML takes as long as some corners
        mesh_.CountRead([] { return "xlink:href"; }, kReads * BytesOf(target->second));
        AddSurfaces(target->second, seen, is_reversed, depth + 1);
      }
      return;
    }
    if (!AttributeOf(node, "id").empty() && !seen.insert(node).second) return;
    if (name == "ImplicitGeometry") return;  // its coordinates are its own
    if (name == "Polygon" || name == "PolygonPatch" || name == "Triangle" || name == "Rectangle") {
      AddPolygon(node, is_reversed);
      return;
    }
    const bool turns = name == "OrientableSurface" && AttributeOf(node, "orientation") == "-";
    for (const xml_node& child : node.children()) {
      AddSurfaces(child, seen, is_reversed != turns, depth + 1);
    }
  }

  // Returns how long the element is in the file.
  size_t BytesOf(xml_node node) const {
    const ptrdiff_t begin = node.offset_debug();
    while (node && !node.next_sibling()) node = node.parent();
    const ptrdiff_t end =
        node ? node.next_sibling().offset_debug() : static_cast<ptrdiff_t>(file_bytes_);
    return static_cast<size_t>(std::max<ptrdiff_t>(end - begin, 0));
  }

  void AddPolygon(const xml_node& polygon, bool is_reversed) {
    const auto locate = [&] { return PathOf(polygon); };
    std::vector<std::vector<Vector3d>> rings;
    for (const xml_node& side : polygon.children()) {
      const std::string_view name = NameOf(side);
      const bool is_outer = name == "exterior" || name == "outerBoundaryIs";
      if (!is_outer && name != "interior" && name != "innerBoundaryIs") continue;
      std::vector<Vector3d> ring = RingOf(locate, side.first_child());
      if (is_reversed) std::reverse(ring.begin(), ring.end());
      rings.insert(is_outer ? rings.begin() : rings.end(), std::move(ring));
    }
    mesh_.AddPolygon(locate, std::move(rings), KindOf(polygon));
  }

  // Returns points that are one list (posList), one by one (pos), or as GML 2 has them
  // (coordinates).
  std::vector<Vector3d> RingOf(const CityMesh::Locator& locate, const xml_node& ring) const {
    std::vector<double> numbers;
    for (const xml_node& child : ring.children()) {
      const std::string_view name = NameOf(child);
      const bool is_old = name == "coordinates";
      if (!is_old && name != "posList" && name != "pos") continue;
      const std::string_view dimension = AttributeOf(child, "srsDimension");
      if (!dimension.empty() && dimension != "3") {
        Fail(locate(), "expected points of three coordinates (srsDimension)");
      }
      std::string text = child.child_value();
      std::replace_if(
          text.begin(), text.end(),
          [&](char c) { return c == '\n' || c == '\r' || (is_old && c == ','); }, ' ');
      for (const std::string_view word : SplitTokens(text)) {
        const auto number = ParseDouble(word);
        if (!number)
          Fail(locate(),
               fmt::format("expected numbers, found \"{}\"", Printable(std::string(word))));
        numbers.push_back(*number);
      }
    }
    if (numbers.size() % 3 != 0) {
      Fail(locate(),
           fmt::format("expected points of three coordinates, found {} numbers", numbers.size()));
    }
    std::vector<Vector3d> points;
    for (size_t i = 0; i < numbers.size(); i += 3) points.emplace_back(&numbers[i]);
    return points;
  }

  const std::filesystem::path& path_;
  std::optional<double> level_;
  size_t file_bytes_;
  CityMesh mesh_;
  pugi::xml_document document_;
  std::unordered_map<std::string_view, xml_node> nodes_;
  std::string system_;
  int depth_ = 0;
  size_t implicit_ = 0, elsewhere_ = 0;
};

}  // namespace

RawMesh ReadCityGml(const std::filesystem::path& path, std::string_view contents,
                    std::optional<double> level) {
  return CityGmlReader(path, contents, level).Read();
}

}  // namespace raylift
