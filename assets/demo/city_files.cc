#include "city_files.h"

#include <cmath>
#include <map>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace raylift::demo {

namespace {

using Eigen::Vector3d;
using nlohmann::json;

constexpr const char* kSurfaceTypes[] = {"GroundSurface", "WallSurface", "RoofSurface"};

// Integers of millimeters, each place once.
class JsonVertices {
 public:
  json Index(const Vector3d& p) {
    const std::array<int64_t, 3> key{std::llround(1000 * p.x()), std::llround(1000 * p.y()),
                                     std::llround(1000 * p.z())};
    const auto [entry, is_new] = indices_.try_emplace(key, indices_.size());
    if (is_new) vertices_.push_back(key);
    return entry->second;
  }
  json Polygon(const std::vector<std::vector<Vector3d>>& rings) {
    json polygon = json::array();
    for (const auto& ring : rings) {
      json indices = json::array();
      for (const Vector3d& p : ring) indices.push_back(Index(p));
      polygon.push_back(std::move(indices));
    }
    return polygon;
  }
  const json& vertices() const { return vertices_; }

 private:
  std::map<std::array<int64_t, 3>, size_t> indices_;
  json vertices_ = json::array();
};

json SolidGeometry(const House& house, LevelOfDetail level, JsonVertices& vertices) {
  json shell = json::array(), kinds = json::array();
  for (const CityPolygon& polygon : SolidOf(house, level)) {
    shell.push_back(vertices.Polygon(polygon.rings));
    kinds.push_back(static_cast<int>(polygon.kind));
  }
  json geometry{{"type", "Solid"}, {"boundaries", json::array({shell})}};
  geometry["lod"] = level == LevelOfDetail::kLod1 ? "1" : "2";
  if (level == LevelOfDetail::kLod2) {
    json surfaces = json::array();
    for (const char* type : kSurfaceTypes) surfaces.push_back({{"type", type}});
    geometry["semantics"] = {{"surfaces", surfaces}, {"values", json::array({kinds})}};
  }
  return geometry;
}

std::string PosList(const std::vector<Vector3d>& ring) {
  std::string text = "<gml:LinearRing><gml:posList srsDimension=\"3\">";
  for (size_t i = 0; i <= ring.size(); ++i) {
    const Vector3d p = ring[i % ring.size()] + kTownOrigin;
    text += fmt::format("{}{:.3f} {:.3f} {:.3f}", i == 0 ? "" : " ", p.x(), p.y(), p.z());
  }
  return text + "</gml:posList></gml:LinearRing>";
}

std::string GmlPolygon(const std::string& id, const CityPolygon& polygon) {
  std::string text = fmt::format("<gml:Polygon gml:id=\"{}\">", id);
  for (size_t i = 0; i < polygon.rings.size(); ++i) {
    const char* const side = i == 0 ? "exterior" : "interior";
    text += fmt::format("<gml:{0}>{1}</gml:{0}>", side, PosList(polygon.rings[i]));
  }
  return text + "</gml:Polygon>";
}

std::string GmlSolid(const std::string& lod, const std::string& members) {
  return fmt::format(
      "<bldg:{0}Solid><gml:Solid><gml:exterior><gml:CompositeSurface>{1}</gml:CompositeSurface>"
      "</gml:exterior></gml:Solid></bldg:{0}Solid>\n",
      lod, members);
}

// The solid of LoD2 refers to the polygons of the surfaces, as surveys write it.
std::string GmlBuilding(const std::string& id, const House& house) {
  std::string blocks, references, surfaces;
  int number = 0;
  for (const CityPolygon& polygon : SolidOf(house, LevelOfDetail::kLod1)) {
    blocks += "<gml:surfaceMember>" +
              GmlPolygon(fmt::format("{}_block_{}", id, ++number), polygon) +
              "</gml:surfaceMember>";
  }
  number = 0;
  for (const CityPolygon& polygon : SolidOf(house, LevelOfDetail::kLod2)) {
    const std::string name = fmt::format("{}_{}", id, ++number);
    references += fmt::format("<gml:surfaceMember xlink:href=\"#{}\"/>", name);
    surfaces += fmt::format(
        "<bldg:boundedBy><bldg:{0}><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember>{1}"
        "</gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:{0}>"
        "</bldg:boundedBy>\n",
        kSurfaceTypes[static_cast<int>(polygon.kind)], GmlPolygon(name, polygon));
  }
  return fmt::format(
      "<core:cityObjectMember><bldg:Building gml:id=\"{}\">\n{}{}{}</bldg:Building>"
      "</core:cityObjectMember>\n",
      id, GmlSolid("lod1", blocks), GmlSolid("lod2", references), surfaces);
}

std::string GmlGround(const Town& town) {
  std::string triangles;
  for (const auto& t : town.Ground()) {
    triangles += "<gml:Triangle><gml:exterior>" + PosList({t[0], t[1], t[2]}) +
                 "</gml:exterior></gml:Triangle>\n";
  }
  return "<core:cityObjectMember><dem:ReliefFeature gml:id=\"ground\"><dem:lod>2</dem:lod>"
         "<dem:reliefComponent><dem:TINRelief gml:id=\"ground_tin\"><dem:lod>2</dem:lod><dem:tin>"
         "<gml:TriangulatedSurface><gml:trianglePatches>\n" +
         triangles +
         "</gml:trianglePatches></gml:TriangulatedSurface></dem:tin></dem:TINRelief>"
         "</dem:reliefComponent></dem:ReliefFeature></core:cityObjectMember>\n";
}

}  // namespace

std::string CityJsonOf(const Town& town) {
  JsonVertices vertices;
  json objects = json::object();
  for (size_t i = 0; i < town.houses().size(); ++i) {
    const House& house = town.houses()[i];
    objects[fmt::format("house_{}", i + 1)] = {
        {"type", "Building"},
        {"geometry", json::array({SolidGeometry(house, LevelOfDetail::kLod1, vertices),
                                  SolidGeometry(house, LevelOfDetail::kLod2, vertices)})}};
  }
  json triangles = json::array();
  for (const auto& t : town.Ground()) triangles.push_back(vertices.Polygon({{t[0], t[1], t[2]}}));
  const json ground{{"type", "CompositeSurface"}, {"lod", "2"}, {"boundaries", triangles}};
  objects["ground"] = {{"type", "TINRelief"}, {"geometry", json::array({ground})}};
  const std::string code = std::string(kTownCrs).substr(5);
  const json root{
      {"type", "CityJSON"},
      {"version", "2.0"},
      {"transform",
       {{"scale", {0.001, 0.001, 0.001}},
        {"translate", {kTownOrigin.x(), kTownOrigin.y(), kTownOrigin.z()}}}},
      {"metadata", {{"referenceSystem", "https://www.opengis.net/def/crs/EPSG/0/" + code}}},
      {"CityObjects", std::move(objects)},
      {"vertices", vertices.vertices()}};
  return root.dump() + "\n";
}

std::string CityGmlOf(const Town& town) {
  std::string text = fmt::format(
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
      "<core:CityModel xmlns:core=\"http://www.opengis.net/citygml/2.0\" "
      "xmlns:bldg=\"http://www.opengis.net/citygml/building/2.0\" "
      "xmlns:dem=\"http://www.opengis.net/citygml/relief/2.0\" "
      "xmlns:gml=\"http://www.opengis.net/gml\" xmlns:xlink=\"http://www.w3.org/1999/xlink\">\n"
      "<gml:boundedBy><gml:Envelope srsDimension=\"3\" srsName=\"{}\"><gml:lowerCorner>{} {} 0"
      "</gml:lowerCorner><gml:upperCorner>{} {} 100</gml:upperCorner></gml:Envelope>"
      "</gml:boundedBy>\n",
      kTownCrs, kTownOrigin.x(), kTownOrigin.y(), kTownOrigin.x() + Town::kWidth,
      kTownOrigin.y() + Town::kDepth);
  for (size_t i = 0; i < town.houses().size(); ++i) {
    text += GmlBuilding(fmt::format("house_{}", i + 1), town.houses()[i]);
  }
  return text + GmlGround(town) + "</core:CityModel>\n";
}

}  // namespace raylift::demo
