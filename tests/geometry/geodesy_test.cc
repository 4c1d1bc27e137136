#include "raylift/geometry/geodesy.h"

#include <string>
#include <vector>

#include "support/matchers.h"
#include <Eigen/LU>

#include "raylift/base/error.h"

namespace raylift {
namespace {

using Eigen::Vector3d;

// Below what rounding to doubles makes of seven digits, and far below what one surveys.
constexpr double kMicrometer = 1e-6;

struct Known {
  std::string from, to;
  Vector3d point, expected;
};

// By pyproj 3.4 with always_xy (tests/python/test_geodesy.py asks the one that is installed).
TEST(CrsTransform, IsPyprojs) {
  const std::vector<Known> known = {
      {"EPSG:4326",
       "EPSG:32615",
       {-91.9945, 46.8426, 198.3},
       {576667.674399668, 5188163.827476512, 198.3}},
      {"EPSG:4979",
       "EPSG:4978",
       {10.8265, 51.3, 250.5},
       {3925064.548839588, 750627.724716086, 4954675.902014167}},
      {"EPSG:4978",
       "EPSG:32632",
       {3919871, 749219, 4957101},
       {626781.876885768, 5690462.909626660, -1209.188159123}},
      {"EPSG:4326", "EPSG:25832", {9.9, 53.55, 12}, {559628.278925155, 5933833.052425547, 12}},
      {"EPSG:4326", "EPSG:2056", {7.44, 46.95, 500}, {2600104.103834321, 1199879.616696087, 500}}};
  for (const Known& it : known) {
    const Crs from(it.from), to(it.to);
    EXPECT_LT((CrsTransform(from, to)(it.point) - it.expected).norm(), kMicrometer) << it.to;
    EXPECT_NO_THROW(to.Check(it.expected)) << it.to;
    EXPECT_NO_THROW(from.Check(it.point)) << it.from;
  }
}

TEST(CrsTransform, ReturnsWhereItCameFrom) {
  const Crs geographic("EPSG:4979"), earth("EPSG:4978"), map("EPSG:32632");
  const Vector3d point(10.8265, 51.3, 250.5);
  const Vector3d there = CrsTransform(earth, map)(CrsTransform(geographic, earth)(point));
  const CrsTransform back(map, geographic);
  EXPECT_LT((back(there) - point).norm(), 1e-9);
  EXPECT_FALSE(back.Warning());
}

TEST(CrsTransform, AHeightStaysWhereTheTargetHasNone) {
  for (const char* from : {"EPSG:4326", "EPSG:4979", "EPSG:4326+5773"}) {
    EXPECT_EQ(CrsTransform(Crs(from), Crs("EPSG:32632"))({9.9, 53.55, 52}).z(), 52) << from;
  }
  EXPECT_NEAR(CrsTransform(Crs("EPSG:4326"), Crs("EPSG:4978"))({0, 0, 52}).x(), 6378137 + 52, 1e-8);
}

// By pyproj: of EPSG:2263 (New York, in feet of US surveys), and with heights EPSG:2263+6360.
TEST(CrsTransform, AHeightIsInTheUnitOfItsMap) {
  const Vector3d place(-73.98, 40.75, 200);
  const Vector3d in_feet(989791.457348593, 212522.519239254, 656.166666666667);
  const Crs geographic("EPSG:4326"), ellipsoid("EPSG:4979"), map("EPSG:2263"), earth("EPSG:4978");
  EXPECT_LT((CrsTransform(geographic, map)(place) - in_feet).norm(), kMicrometer);
  EXPECT_LT((CrsTransform(map, ellipsoid)(in_feet) - place).norm(), kMicrometer);
  EXPECT_LT((CrsTransform(map, earth)(in_feet) - CrsTransform(ellipsoid, earth)(place)).norm(),
            1e-5);
  EXPECT_NEAR(CrsTransform(map, Crs("EPSG:32618"))(in_feet).z(), 200, kMicrometer);
  EXPECT_NEAR(CrsTransform(Crs("EPSG:2263+6360"), Crs("EPSG:32618"))(in_feet).z(), 200,
              kMicrometer);
  EXPECT_NEAR(CrsTransform(Crs("EPSG:2263+6360"), map)(in_feet).z(), in_feet.z(), kMicrometer);
}

TEST(WorldFrame, HasAnOrigin) {
  EXPECT_EQ(WorldFrame::Parse("EPSG:32615@576000,5188000,-1.5").origin,
            Vector3d(576000, 5188000, -1.5));
  EXPECT_EQ(WorldFrame::Parse("EPSG:32615").origin, Vector3d::Zero());
  for (const char* bad : {"EPSG:32615@", "EPSG:32615@1,2", "EPSG:32615@1,2,x", "@1,2,3"}) {
    EXPECT_TRUE(FailsWithInputError([&] { WorldFrame::Parse(bad); }, {"CRS \"", "expected"}))
        << bad;
  }
  for (const char* of_degrees : {"EPSG:4326", "EPSG:4979", "EPSG:4326+5773@9,53,0"}) {
    EXPECT_TRUE(FailsWithInputError([&] { WorldFrame::Parse(of_degrees); },
                                    {of_degrees, "degrees are no coordinates of a scene"}));
  }
}

TEST(WorldFrame, OfWktIsOneLine) {
  const std::string wkt = R"(PROJCS["me@here",
  GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],
    PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],
  PROJECTION["Transverse_Mercator"],PARAMETER["latitude_of_origin",0],
  PARAMETER["central_meridian",9],PARAMETER["scale_factor",0.9996],
  PARAMETER["false_easting",500000],PARAMETER["false_northing",0],UNIT["metre",1]])";
  const WorldFrame frame = WorldFrame::Parse(wkt + "\n");
  EXPECT_EQ(frame.origin, Vector3d::Zero());
  EXPECT_EQ(frame.text.find('\n'), std::string::npos);
  EXPECT_EQ(WorldFrame::Parse(frame.text).text, frame.text);
  EXPECT_EQ(WorldFrame::Parse(frame.text + "@1,2,3").origin, Vector3d(1, 2, 3));
}

TEST(CrsTransform, HeightsWithoutTheirGridAreWarnedOf) {
  const Crs ellipsoid("EPSG:4979"), france("EPSG:2154+5720");
  const CrsTransform transform(ellipsoid, france);
  transform({2.35, 48.85, 80});
  const auto warning = transform.Warning();
  if (!warning) GTEST_SKIP() << "France's quasigeoid is installed";
  EXPECT_NE(warning->find("heights are taken as they are"), std::string::npos);
  EXPECT_NE(warning->find("grid "), std::string::npos) << *warning;
}

TEST(Crs, KindsAndHeightsAreKnown) {
  EXPECT_EQ(Crs("EPSG:4326").kind(), CrsKind::kGeographic);
  EXPECT_EQ(Crs("EPSG:25832").kind(), CrsKind::kProjected);
  EXPECT_EQ(Crs("EPSG:4978").kind(), CrsKind::kGeocentric);
  EXPECT_EQ(Crs("EPSG:25832").name(), "ETRS89 / UTM zone 32N");
  EXPECT_FALSE(Crs("EPSG:25832").has_heights());
  EXPECT_TRUE(Crs("EPSG:25832+7837").has_heights());
  EXPECT_TRUE(Crs("EPSG:4979").has_heights());
}

TEST(Crs, WhatIsNoneIsRefused) {
  for (const char* bad :
       {"", "EPSG:999999", "32615", "UTM", "EPSG:7837", "PROJCS[\"broken\"",
        "+proj=utm +zone=32 +type=crs",
        "VERT_CS[\"a\",VERT_DATUM[\"a\",2005,EXTENSION[\"PROJ4_GRIDS\",\"a\"]]]"}) {
    EXPECT_TRUE(FailsWithInputError([&] { Crs{bad}; }, {"CRS \"", "expected"})) << bad;
  }
}

TEST(Crs, PointsOffTheEarthAreRefused) {
  const auto fails = [](const char* crs, const Vector3d& point,
                        const std::vector<std::string>& parts) {
    return FailsWithInputError([&] { Crs(crs).Check(point); }, parts);
  };
  EXPECT_TRUE(
      fails("EPSG:4326", {46.84, -91.99, 0}, {"seem to be swapped", "longitude, latitude"}));
  EXPECT_TRUE(fails("EPSG:4326", {576667, 5188163, 0}, {"EPSG:4326", "WGS 84"}));
  EXPECT_TRUE(fails("EPSG:32615", {5188163, 576667, 0}, {"swapped", "easting, northing"}));
  EXPECT_TRUE(fails("EPSG:4978", {0, 0, 10}, {"not on the earth's surface"}));
  EXPECT_TRUE(fails("EPSG:2056", {2600104, 5188163, 0}, {"not where EPSG:2056"}));
}

// New Zealand with the Chatham Islands, from 160 degrees east to 171 degrees west.
TEST(Crs, AnAreaMayLieOnBothSidesOfTheDateLine) {
  const Crs crs("EPSG:4167");
  EXPECT_NO_THROW(crs.Check({174.8, -41.3, 0}));
  EXPECT_NO_THROW(crs.Check({-176.5, -44, 0}));
  EXPECT_TRUE(FailsWithInputError([&] { crs.Check({9.9, -41.3, 0}); }, {"not where EPSG:4167"}));
  EXPECT_TRUE(FailsWithInputError([&] { crs.Check({-120, -41.3, 0}); }, {"not where EPSG:4167"}));
}

TEST(LocalFrame, OfAMapHasItsScaleAndConvergence) {
  const LocalFrame frame =
      LocalFrameAt(Crs("EPSG:32615"), {576667.674399668, 5188163.827476512, 198.3});
  EXPECT_LT((frame.geographic - Vector3d(-91.9945, 46.8426, 198.3)).norm(), 1e-9);
  // By pyproj's get_factors on the ellipsoid; 198.3 m above it the map is smaller by 31 ppm.
  const Vector3d north = frame.crs_from_enu.col(1);
  EXPECT_NEAR(std::atan2(-north.x(), north.y()) * 180 / EIGEN_PI, 0.7335250840, 1e-7);
  EXPECT_NEAR(frame.Scale() * (1 + 198.3 / 6375e3), 0.9996722442, 1e-6);
  EXPECT_LT((frame.crs_from_enu.col(2) - Vector3d::UnitZ()).norm(), 1e-9);
}

TEST(LocalFrame, OfAMapInFeetHasThemPerMeter) {
  for (const char* map : {"EPSG:2263", "EPSG:2263+6360"}) {
    const LocalFrame frame =
        LocalFrameAt(Crs(map), {989791.457348593, 212522.519239254, 656.166666666667});
    EXPECT_LT((frame.geographic - Vector3d(-73.98, 40.75, 200)).norm(), 1e-6) << map;
    EXPECT_NEAR(frame.crs_from_enu(2, 2), 3937.0 / 1200, 1e-9) << map;
    EXPECT_NEAR(frame.Scale(), 3937.0 / 1200, 1e-3) << map;
  }
}

// A map of France in grads from Paris, which is 2.33722917 degrees from Greenwich by EPSG.
TEST(LocalFrame, IsInDegreesFromGreenwich) {
  const LocalFrame frame = LocalFrameAt(Crs("EPSG:27572"), {600000, 2200000, 100});
  EXPECT_LT((frame.geographic - Vector3d(2.33722917, 46.8, 100)).norm(), 1e-9);
  EXPECT_NEAR(frame.crs_from_enu(0, 1), 0, 1.7e-11);
  EXPECT_NEAR(frame.Scale(), 0.99987742, 2e-5);
  EXPECT_LT((LocalFrameAt(Crs("EPSG:4807"), {0, 52, 100}).geographic - frame.geographic).norm(),
            1e-9);
  EXPECT_NO_THROW(Crs("EPSG:4807").Check({0, 52, 0}));
  EXPECT_NO_THROW(Crs("EPSG:27572").Check({600000, 2200000, 0}));
}

TEST(LocalFrame, OfTheEarthIsARotation) {
  const Vector3d point(3925064.548839588, 750627.724716086, 4954675.902014167);
  const LocalFrame frame = LocalFrameAt(Crs("EPSG:4978"), point);
  EXPECT_LT((frame.Axes() - frame.crs_from_enu).norm(), 1e-9);
  EXPECT_NEAR(frame.crs_from_enu.determinant(), 1, 1e-9);
  EXPECT_NEAR(frame.geographic.y(), 51.3, 1e-9);
  EXPECT_NEAR(frame.crs_from_enu.col(0).z(), 0, 1e-9);  // east is along the equator's plane
  EXPECT_GT(frame.crs_from_enu.col(2).dot(point), 6.3e6);
}

}  // namespace
}  // namespace raylift
