// City models: the town of the demo, written by its own writers, and small files with a fault each.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "city_files.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include "surfaces/mesh_files.h"
#include "town_plan.h"
#include <Eigen/Geometry>
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

using demo::House;
using demo::kTownOrigin;
using demo::Town;
using Eigen::Vector3d;

const Town& TestTown() {
  static const Town town(1);
  return town;
}

std::filesystem::path Write(const std::string& name, const std::string& contents) {
  const auto file = TestFolder() / name;
  WriteFile(file, contents);
  return file;
}

TriangleMesh ReadJson(std::optional<double> level = std::nullopt) {
  return ReadMesh(Write("town.city.json", demo::CityJsonOf(TestTown())),
                  {.level_of_detail = level});
}
TriangleMesh ReadGml(std::optional<double> level = std::nullopt) {
  return ReadMesh(Write("town.gml", demo::CityGmlOf(TestTown())), {.level_of_detail = level});
}

std::vector<std::optional<RayHit>> CastAt(const TriangleMesh& mesh, const std::vector<Ray>& rays) {
  return RayCaster(std::make_shared<const TriangleMesh>(mesh)).Cast(rays);
}

// From above each house, straight down onto a place of its frame.
std::vector<Ray> RaysDownTo(const std::vector<std::pair<const House*, Vector3d>>& places) {
  std::vector<Ray> rays;
  for (const auto& [house, place] : places) {
    const Vector3d at = house->frame.At(place.x(), place.y(), 0) + kTownOrigin;
    rays.push_back({{at.x(), at.y(), 200}, -Vector3d::UnitZ()});
  }
  return rays;
}

TEST(CityModels, JsonAndGmlShowTheSameWithinAMillimeterAtSixMillionMeters) {
  const TriangleMesh json = ReadJson(), gml = ReadGml();
  EXPECT_EQ(json.warnings, std::vector<std::string>());
  EXPECT_EQ(gml.warnings, std::vector<std::string>());
  EXPECT_EQ(json.triangles.size(), gml.triangles.size());
  EXPECT_EQ(json.crs, demo::kTownCrs);
  EXPECT_EQ(gml.crs, demo::kTownCrs);
  Rng rng = TestRng();
  std::vector<Ray> rays;
  for (int i = 0; i < 20000; ++i) {
    const Vector3d eye =
        kTownOrigin + Vector3d(rng.Uniform(0, Town::kWidth), rng.Uniform(0, Town::kDepth), 60);
    rays.push_back({eye, Vector3d(rng.Normal(), rng.Normal(), -1).normalized()});
  }
  const auto of_json = CastAt(json, rays), of_gml = CastAt(gml, rays);
  size_t hits = 0;
  for (size_t i = 0; i < rays.size(); ++i) {
    ASSERT_EQ(of_json[i].has_value(), of_gml[i].has_value()) << i;
    if (!of_json[i]) continue;
    ++hits;
    EXPECT_NEAR(of_json[i]->ray_t, of_gml[i]->ray_t, 1e-3) << i;
  }
  EXPECT_GT(hits, rays.size() / 3);
}

TEST(CityModels, RoofsOfBothLevelsAreWhereTheHousesHaveThem) {
  std::vector<std::pair<const House*, Vector3d>> ridges;
  for (const House& house : TestTown().houses()) {
    if (house.roof == House::Roof::kFlat) continue;
    // A little beside the ridge, where no edge is.
    ridges.emplace_back(&house, Vector3d(0.5 * house.length_m, 0.5 * house.width_m - 0.5, 0));
  }
  ASSERT_GT(ridges.size(), 10u);
  const std::vector<Ray> rays = RaysDownTo(ridges);
  for (const bool is_block : {false, true}) {
    const std::optional<double> level = is_block ? std::optional(1.0) : std::nullopt;
    for (const TriangleMesh& mesh : {ReadJson(level), ReadGml(level)}) {
      const auto hits = CastAt(mesh, rays);
      for (size_t i = 0; i < rays.size(); ++i) {
        const House& house = *ridges[i].first;
        const double rise = is_block ? 0.5 * house.rise_m : house.rise_m - 0.5 * house.slope();
        ASSERT_TRUE(hits[i]) << i;
        EXPECT_GT(hits[i]->normal_in_world.z(), 0) << i;
        // Coordinates are written in millimeters.
        EXPECT_NEAR(200 - hits[i]->ray_t, house.frame.origin.z() + house.wall_m + rise, 2e-3) << i;
      }
    }
  }
}

TEST(CityModels, LightWellsAreHoles) {
  std::vector<std::pair<const House*, Vector3d>> wells;
  for (const House& house : TestTown().houses()) {
    if (!house.well) continue;
    wells.emplace_back(&house, Vector3d(house.well->x0 + 0.3, house.well->y0 + 0.3, 0));
  }
  ASSERT_FALSE(wells.empty());
  const std::vector<Ray> rays = RaysDownTo(wells);
  for (const TriangleMesh& mesh : {ReadJson(), ReadGml()}) {
    const auto hits = CastAt(mesh, rays);
    for (size_t i = 0; i < rays.size(); ++i) {
      ASSERT_TRUE(hits[i]) << i;
      EXPECT_LT(200 - hits[i]->ray_t, wells[i].first->frame.origin.z() + 1) << i;
    }
  }
}

// GDAL takes the solids of LoD2, which come last, and follows their references where it is told to.
TEST(CityModels, GdalReadsTheSamePointsOfTheGmlFile) {
  if (!HasProgram("/usr/bin/python3")) GTEST_SKIP() << "python3 is not installed";
  const auto file = Write("town.gml", demo::CityGmlOf(TestTown()));
  const auto script = file.parent_path() / "points.py";
  WriteFile(script, R"(import sys
try:
    from osgeo import gdal, ogr
except ImportError:
    print("none"); sys.exit()
ogr.UseExceptions()
gdal.SetConfigOption("GML_SKIP_RESOLVE_ELEMS", "NONE")
points = set()
def walk(geometry):
    for i in range(geometry.GetGeometryCount()):
        walk(geometry.GetGeometryRef(i))
    for i in range(geometry.GetPointCount() if geometry.GetGeometryCount() == 0 else 0):
        points.add(tuple(round(1000 * v) for v in geometry.GetPoint(i)))
city = ogr.Open(sys.argv[1])
for feature in city.GetLayerByName("Building"):
    walk(feature.GetGeometryRef())
for p in sorted(points):
    print(*p)
)");
  const std::string found =
      RunProgram(fmt::format("/usr/bin/python3 {} {}", script.string(), file.string()));
  if (found == "none\n") GTEST_SKIP() << "python3-gdal is not installed";
  std::set<std::array<int64_t, 3>> points;
  for (const House& house : TestTown().houses()) {
    for (const auto& polygon : SolidOf(house, demo::LevelOfDetail::kLod2)) {
      for (const auto& ring : polygon.rings) {
        for (const Vector3d& p : ring) {
          // As the file has it.
          const Vector3d at = p + kTownOrigin;
          points.insert({std::llround(std::stod(fmt::format("{:.3f}", at.x())) * 1000),
                         std::llround(std::stod(fmt::format("{:.3f}", at.y())) * 1000),
                         std::llround(std::stod(fmt::format("{:.3f}", at.z())) * 1000)});
        }
      }
    }
  }
  std::string expected;
  for (const auto& p : points) expected += fmt::format("{} {} {}\n", p[0], p[1], p[2]);
  EXPECT_EQ(found, expected);
}

// A square at z = 1, of vertices in centimeters; `change` is made to its text.
std::string SquareJson(const std::string& from = "", const std::string& to = "") {
  std::string text =
      R"({"type":"CityJSON","version":"2.0","transform":{"scale":[0.01,0.01,0.01],)"
      R"("translate":[500000,5900000,0]},"metadata":{"referenceSystem":)"
      R"("https://www.opengis.net/def/crs/EPSG/0/25832"},"CityObjects":{"a":{"type":"Building",)"
      R"("geometry":[{"type":"MultiSurface","lod":"2.2","boundaries":[[[0,1,2,3]]]}]}},)"
      R"("vertices":[[0,0,100],[100,0,100],[100,100,100],[0,100,100]]})";
  if (!from.empty()) text.replace(text.find(from), from.size(), to);
  return text;
}

std::string SquareGml(const std::string& surfaces, const std::string& more = "",
                      const std::string& system = "EPSG:25832") {
  return "<CityModel xmlns:gml=\"g\"><gml:boundedBy><gml:Envelope srsName=\"" + system +
         "\"/></gml:boundedBy><cityObjectMember><Building gml:id=\"b\"><lod2MultiSurface>" +
         "<gml:MultiSurface gml:id=\"m\">" + surfaces + "</gml:MultiSurface></lod2MultiSurface>" +
         more + "</Building></cityObjectMember></CityModel>";
}
const std::string kSquarePolygon =
    "<gml:surfaceMember><gml:Polygon gml:id=\"p\"><gml:exterior><gml:LinearRing><gml:posList>"
    "500000 5900000 1 500001 5900000 1 500001 5900001 1 500000 5900001 1 500000 5900000 1"
    "</gml:posList></gml:LinearRing></gml:exterior></gml:Polygon></gml:surfaceMember>";

TEST(CityJson, FaultsAreNamedWithTheirPlace) {
  EXPECT_NEAR(SurfaceArea(ReadMesh(Write("good.city.json", SquareJson()))), 1, 1e-6);
  struct Fault {
    std::string from, to, message;
  };
  const std::vector<Fault> faults = {
      {"\"CityJSON\"", "\"CityJSONFeature\"", "type: expected \"CityJSON\""},
      {"\"2.0\"", "\"0.9\"", "version: expected 1.0, 1.1 or 2.0"},
      {"[0.01,0.01,0.01]", "[0.01,0.01]", "transform.scale: expected three numbers"},
      {"[0,0,100]", "[0,\"0\",100]", "vertices[0]: expected three numbers"},
      {"[0,1,2,3]", "[0,1,2,4]",
       "CityObjects.a.geometry[0].boundaries[0]: expected an index of one of 4 vertices"},
      {"[0,1,2,3]", "[0,1]", "expected a ring of three points or more, found 2"},
      {"[[[0,1,2,3]]]", "[[0,1,2,3]]", "boundaries[0]: expected a list"},
      {"[[[0,1,2,3]]]", "[[]]", "expected a ring of points, found none"},
      {"\"2.2\"", "\"fine\"", "CityObjects.a.geometry[0].lod: expected a level"},
      {"\"lod\"", "\"type\":7,\"lod\"", "has no surfaces"},
      {"\"MultiSurface\"", "\"GeometryInstance\",\"template\":0", "geometry-templates: is missing"},
      {"0/25832", "0/4258", "metadata.referenceSystem: coordinates in degrees (EPSG:4258)"},
      {"}]}}", "", "the file is damaged"}};
  for (const Fault& fault : faults) {
    const auto file = Write("bad.city.json", SquareJson(fault.from, fault.to));
    EXPECT_TRUE(FailsWithInputError([&] { ReadMesh(file); }, {"bad.city.json", fault.message}));
  }
  const std::string deep = "\"x\":" + std::string(100000, '[') + std::string(100000, ']') + ",";
  const auto nested = Write("deep.city.json", SquareJson("\"vertices\"", deep + "\"vertices\""));
  EXPECT_EQ(ReadMesh(nested).triangles.size(), 2u);
  ReadTruncated(TestFolder() / "cut.city.json", SquareJson(), 7);
}

TEST(CityJson, TemplatesStandWhereTheirInstancesPutThem) {
  const auto file = Write(
      "trees.city.json",
      SquareJson(R"("vertices":)",
                 R"("geometry-templates":{"templates":[{"type":"MultiSurface","lod":"2",)"
                 R"("boundaries":[[[0,1,2]]]}],"vertices-templates":[[0,0,0],[1,0,0],[0,1,0]]},)"
                 R"("vertices":)")
          .replace(SquareJson().find("\"MultiSurface\""), 14,
                   R"("GeometryInstance","template":0,"transformationMatrix":)"
                   R"([2,0,0,0,0,2,0,0,0,0,2,5,0,0,0,1])"));
  std::string text = ReadFile(file);
  const std::string of_square = "[[[0,1,2,3]]]";
  text.replace(text.find(of_square), of_square.size(), "[2]");
  WriteFile(file, text);
  EXPECT_LT(MaxCornerDistance(ReadMesh(file),
                              {{500001, 5900001, 6}, {500003, 5900001, 6}, {500001, 5900003, 6}}),
            1e-6);
}

TEST(CityJson, ReadsTheVerticesOfTemplatesOnce) {
  constexpr int kNumInstances = 2000, kNumVertices = 100000;
  std::string vertices = "[0,0,0],[1,0,0],[0,1,0]", trees;
  for (int i = 0; i < kNumVertices; ++i) vertices += ",[0,0,0]";
  for (int i = 0; i < kNumInstances; ++i) {
    trees += fmt::format(
        R"("t{}":{{"type":"Plant","geometry":[{{"type":"GeometryInstance","template":0,)"
        R"("boundaries":[2],"transformationMatrix":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]}}]}},)",
        i);
  }
  const auto with = [&](const std::string& type, const std::string& boundaries) {
    return Write("trees.city.json", SquareJson(R"("CityObjects":{)",
                                               R"("geometry-templates":{"templates":[{"type":")" +
                                                   type + R"(","lod":"2","boundaries":)" +
                                                   boundaries + R"(}],"vertices-templates":[)" +
                                                   vertices + R"(]},"CityObjects":{)" + trees));
  };
  const auto begin = std::chrono::steady_clock::now();
  EXPECT_EQ(ReadMesh(with("MultiSurface", "[[[0,1,2]]]")).triangles.size(), kNumInstances + 2u);
  // Once more for each instance they took 20 s.
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(10));
  // Shells without surfaces add nothing to a mesh that would end it.
  std::string shells = "[]";
  for (int i = 0; i < 20000; ++i) shells += ",[]";
  const auto file = with("Solid", "[" + shells + "]");
  EXPECT_TRUE(FailsWithInputError(
      [&] { ReadMesh(file); },
      {".geometry[0].boundaries[", "the file refers to its surfaces too often"}));
}

// A square, of one level, and a triangle that is its child.
TriangleMesh WithChild(const std::string& type, const std::string& level) {
  return ReadMesh(
      Write("parts.city.json",
            SquareJson(R"("CityObjects":{"a":{"type":"Building",)",
                       R"("CityObjects":{"b":{"type":")" + type +
                           R"(","parents":["a"],"geometry":[{"type":"MultiSurface","lod":)" +
                           level + R"(,"boundaries":[[[0,1,2]]]}]},)" +
                           R"("a":{"type":"Building","children":["b"],)")));
}

TEST(CityJson, BuildingsGiveWayToTheirPartsWhereTheseAreFiner) {
  EXPECT_EQ(WithChild("BuildingPart", "3.0").triangles.size(), 1u);
  EXPECT_EQ(WithChild("BuildingPart", "\"2.2\"").triangles.size(), 3u);
}

TEST(CityJson, InstallationsAreAddedAndInteriorsAreLeftOut) {
  for (const char* type : {"BuildingInstallation", "BridgeConstructiveElement", "CityFurniture"}) {
    EXPECT_EQ(WithChild(type, "3").triangles.size(), 3u) << type;
  }
  for (const char* type :
       {"BuildingRoom", "BuildingFurniture", "BuildingStorey", "BuildingUnit", "BridgeRoom",
        "BridgeFurniture", "TunnelHollowSpace", "TunnelFurniture"}) {
    EXPECT_EQ(WithChild(type, "3").triangles.size(), 2u) << type;
  }
}

TEST(CityJson, IsRecognizedWhereItsTypeComesLast) {
  std::string text = SquareJson(R"("type":"CityJSON","version":"2.0",)");
  text.back() = ',';
  const std::string padding(10000, ' ');
  const auto file = Write("sorted.json", text + padding + R"("type":"CityJSON","version":"2.0"})");
  EXPECT_EQ(ReadMesh(file).triangles.size(), 2u);
}

TEST(CityModels, SaysWhereASystemIsUnknownOrMeantForElsewhere) {
  const auto warnings_of = [&](const std::string& system) {
    const auto warnings =
        ReadMesh(Write("town.gml", SquareGml(kSquarePolygon, "", system))).warnings;
    return warnings.empty() ? std::string() : warnings.front();
  };
  for (const char* known :
       {"EPSG:25832", "urn:ogc:def:crs:EPSG::25832", "urn:ogc:def:crs:EPSG:6.12:25832",
        "urn:ogc:def:crs,crs:EPSG:6.12:25832,crs:EPSG:6.12:5783",
        "http://www.opengis.net/def/crs/EPSG/0/25832", "urn:adv:crs:ETRS89_UTM32*DE_DHHN2016_NH",
        "http://www.opengis.net/gml/srs/epsg.xml#25832",
        "http://www.opengis.net/def/crs-compound?1=http://www.opengis.net/def/crs/EPSG/0/25832&amp;"
        "2=http://www.opengis.net/def/crs/EPSG/0/7837"}) {
    EXPECT_EQ(warnings_of(known), "") << known;
  }
  EXPECT_NE(warnings_of("local").find("srsName: \"local\" is no known system"), std::string::npos);
  EXPECT_NE(warnings_of("EPSG:27700").find("is not where EPSG:27700"), std::string::npos);
}

TEST(CityModels, SaysWhereTheOrderOfAxesCannotBeTold) {
  const auto warnings_of = [&](const std::string& system, const std::string& place) {
    std::string polygon = "<gml:Polygon><gml:exterior><gml:LinearRing><gml:posList>" + place +
                          " 1 486010 637000 1 486010 637010 1</gml:posList></gml:LinearRing>"
                          "</gml:exterior></gml:Polygon>";
    const auto warnings = ReadMesh(Write("town.gml", SquareGml(polygon, "", system))).warnings;
    return warnings.empty() ? std::string() : warnings.front();
  };
  for (const char* system :
       {"urn:ogc:def:crs:EPSG::2180", "http://www.opengis.net/def/crs/EPSG/0/2180"}) {
    EXPECT_NE(warnings_of(system, "486000 637000")
                  .find("srsName: EPSG:2180 orders northing before easting, which most files do "
                        "not: easting 486000, northing 637000 is taken"),
              std::string::npos);
  }
  // A short name means no order, the British grid has eastings first, and one that fits is certain.
  EXPECT_EQ(warnings_of("EPSG:2180", "486000 637000"), "");
  EXPECT_EQ(warnings_of("urn:ogc:def:crs:EPSG::27700", "300000 400000"), "");
  EXPECT_EQ(warnings_of("urn:ogc:def:crs:EPSG::3006", "674000 6580000"), "");
}

TEST(CityGml, ImplicitGeometriesAndOpeningsReplaceNothing) {
  const auto implicit =
      ReadMesh(Write("a.gml", SquareGml(kSquarePolygon,
                                        "<lod3ImplicitRepresentation><ImplicitGeometry/>"
                                        "</lod3ImplicitRepresentation>")));
  EXPECT_EQ(implicit.triangles.size(), 2u);
  ASSERT_EQ(implicit.warnings.size(), 1u);
  EXPECT_NE(implicit.warnings[0].find("1 implicit geometries (trees, furniture) are left out"),
            std::string::npos);
  const auto with_window = [&](const std::string& level) {
    return ReadMesh(
        Write("b.gml",
              SquareGml(kSquarePolygon,
                        "<boundedBy><WallSurface><opening><Window><lod" + level +
                            "MultiSurface><gml:Triangle><gml:exterior><gml:LinearRing>"
                            "<gml:posList>500000 5900000 1 500001 5900000 1 500001 5900001 1"
                            "</gml:posList></gml:LinearRing></gml:exterior></gml:Triangle></lod" +
                            level + "MultiSurface></Window></opening></WallSurface></boundedBy>")));
  };
  EXPECT_EQ(with_window("3").triangles.size(), 2u);
  EXPECT_EQ(with_window("2").triangles.size(), 3u);
  // A finer construction is added.
  std::string pier = kSquarePolygon;
  pier.replace(pier.find("\"p\""), 3, "\"q\"");
  EXPECT_EQ(
      ReadMesh(Write("c.gml", SquareGml(kSquarePolygon,
                                        "<outerBridgeConstruction><X><lod3MultiSurface>" + pier +
                                            "</lod3MultiSurface></X>"
                                            "</outerBridgeConstruction>")))
          .triangles.size(),
      4u);
}

TEST(CityGml, RefusesReferencesThatMakeMuchOfLittle) {
  std::string nothing, buildings;
  for (int i = 0; i < 100000; ++i) nothing += "<a/>";
  for (int i = 0; i < 20000; ++i) {
    buildings +=
        "<cityObjectMember><B><lod1Solid><s href=\"#n\"/></lod1Solid></B></cityObjectMember>";
  }
  const auto file = Write(
      "many.gml", "<CityModel><x><y id=\"n\">" + nothing + "</y></x>" + buildings + "</CityModel>");
  EXPECT_TRUE(FailsWithInputError([&] { ReadMesh(file); },
                                  {"xlink:href", "the file refers to its surfaces too often"}));
}

TEST(CityGml, ReadsPolygonsOnceHoweverTheyAreReferredTo) {
  const std::string solid =
      "<lod2Solid><gml:Solid><gml:exterior><gml:CompositeSurface><gml:surfaceMember "
      "xlink:href=\"#p\"/><gml:surfaceMember xlink:href=\"#m\"/></gml:CompositeSurface>"
      "</gml:exterior></gml:Solid></lod2Solid>";
  EXPECT_NEAR(SurfaceArea(ReadMesh(Write("a.gml", SquareGml(kSquarePolygon, solid)))), 1, 1e-6);
  // To itself, in a circle, and to what is not there.
  const std::string circle = "<gml:surfaceMember xlink:href=\"#m\"/>";
  EXPECT_NEAR(SurfaceArea(ReadMesh(Write("b.gml", SquareGml(circle + kSquarePolygon)))), 1, 1e-6);
  const std::string nowhere = "<gml:surfaceMember xlink:href=\"#q\"/>";
  const auto lost = ReadMesh(Write("c.gml", SquareGml(nowhere + kSquarePolygon)));
  ASSERT_EQ(lost.warnings.size(), 1u);
  EXPECT_NE(lost.warnings[0].find("1 references lead to other files or to nothing"),
            std::string::npos);
}

TEST(CityGml, FaultsAreNamedWithTheirPlace) {
  const auto fails = [](const std::string& contents, const std::string& message) {
    const auto file = Write("bad.gml", contents);
    return FailsWithInputError([&] { ReadMesh(file); }, {"bad.gml", message});
  };
  const auto with = [](const std::string& from, const std::string& to) {
    std::string polygon = kSquarePolygon;
    return SquareGml(polygon.replace(polygon.find(from), from.size(), to));
  };
  EXPECT_TRUE(fails("<kml/>", "root element: expected a CityModel"));
  EXPECT_TRUE(fails("<CityModel><a></CityModel>", "byte "));
  EXPECT_TRUE(fails("<CityModel/>", "has no surfaces"));
  EXPECT_TRUE(fails(with("500001", "wide"), "Polygon of p: expected numbers, found \"wide\""));
  EXPECT_TRUE(fails(with("500001 5900000 1", "500001 5900000"),
                    "Polygon of p: expected points of three coordinates, found 14 numbers"));
  EXPECT_TRUE(fails(with("<gml:posList>", "<gml:posList srsDimension=\"2\">"), "srsDimension"));
  EXPECT_TRUE(fails(SquareGml(kSquarePolygon, "", "EPSG:4326"), "srsName: coordinates in degrees"));
  std::string deep, ends;
  for (int i = 0; i < 5000; ++i) {
    deep += "<a>";
    ends += "</a>";
  }
  EXPECT_TRUE(fails("<CityModel>" + deep + ends + "</CityModel>", "nested too deep"));
  // Entities of the file's own are left as they are.
  const std::string bomb =
      "<!DOCTYPE a [<!ENTITY a \"1 1 1 \"><!ENTITY b \"&a;&a;&a;\">]>" + with("500001", "&b;");
  EXPECT_TRUE(fails(bomb, "expected numbers, found \"&b;\""));
  ReadTruncated(TestFolder() / "cut.gml", SquareGml(kSquarePolygon), 7);
}

}  // namespace
}  // namespace raylift
