#include "service/geopose.h"

#include <cmath>
#include <limits>
#include <numbers>

#include "service/problem.h"
#include "service/scene_place.h"
#include "support/matchers.h"
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"

namespace raylift {
namespace {

using Eigen::Vector3d;
using Json = nlohmann::json;

constexpr double kDegree = std::numbers::pi / 180;
constexpr uint64_t kMaxPixels = 1000;

// ---- places ----

constexpr double kLon = 9.2, kLat = 48.8, kHeight = 330;

// Earth-centered coordinates of the ellipsoid of WGS 84, and of east, north and up there.
Vector3d EarthCentered(double lon, double lat, double h) {
  constexpr double kA = 6378137, kF = 1 / 298.257223563, kE2 = kF * (2 - kF);
  const double n = kA / std::sqrt(1 - kE2 * std::pow(std::sin(lat * kDegree), 2));
  return {(n + h) * std::cos(lat * kDegree) * std::cos(lon * kDegree),
          (n + h) * std::cos(lat * kDegree) * std::sin(lon * kDegree),
          (n * (1 - kE2) + h) * std::sin(lat * kDegree)};
}

Eigen::Matrix3d EastNorthUp(double lon, double lat) {
  const double sl = std::sin(lon * kDegree), cl = std::cos(lon * kDegree),
               sp = std::sin(lat * kDegree), cp = std::cos(lat * kDegree);
  Eigen::Matrix3d axes;
  axes << -sl, -sp * cl, cp * cl, cl, -sp * sl, cp * sl, 0, cp, sp;
  return axes;
}

// A level camera there that looks to a heading, clockwise from north. The world's origin is the
// place.
Rigid3 LevelCamera(const Vector3d& enu_m, double heading_deg) {
  const double s = std::sin(heading_deg * kDegree), c = std::cos(heading_deg * kDegree);
  Eigen::Matrix3d enu_from_cam;  // right, down, forward
  enu_from_cam << c, 0, s, -s, 0, c, 0, -1, 0;
  const Eigen::Matrix3d world_from_enu = EastNorthUp(kLon, kLat);
  const Eigen::Matrix3d cam_from_world = (world_from_enu * enu_from_cam).transpose();
  return Rigid3(Eigen::Quaterniond(cam_from_world), -cam_from_world * (world_from_enu * enu_m));
}

WorldFrame EarthCenteredWorld() {
  const Vector3d origin = EarthCentered(kLon, kLat, kHeight);
  return WorldFrame::Parse(fmt::format("EPSG:4978@{},{},{}", origin.x(), origin.y(), origin.z()));
}

ScenePlace PlaceOfOneReference() {
  ReferenceSet references;
  references.images.push_back({"r.jpg", {}, LevelCamera({30, -40, 7}, 0)});
  return {EarthCenteredWorld(), references};
}

TEST(ScenePlace, TheGeoPoseOfACameraIsThatOfClosedForm) {
  PoseEstimate estimate;
  estimate.cam_from_world = LevelCamera({0, 0, 5}, 30);
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
  covariance.bottomRightCorner<3, 3>() = Vector3d(4, 9, 16).asDiagonal();  // right, down, forward
  estimate.covariance = covariance;
  const auto camera = PlaceOfOneReference().CameraOf(estimate);
  ASSERT_TRUE(camera);
  const Json geopose = Json::parse(camera->geopose);
  const Json position = geopose["position"], q = geopose["quaternion"];
  EXPECT_NEAR(position["lon"].get<double>(), kLon, 1e-10);
  EXPECT_NEAR(position["lat"].get<double>(), kLat, 1e-10);
  EXPECT_NEAR(position["h"].get<double>(), kHeight + 5, 1e-6);
  // Looking east is no rotation; north is 90 degrees about up, 30 degrees of heading are 60.
  EXPECT_NEAR(q["x"].get<double>(), 0, 1e-9);
  EXPECT_NEAR(q["y"].get<double>(), 0, 1e-9);
  EXPECT_NEAR(q["z"].get<double>(), std::sin(30 * kDegree), 1e-9);
  EXPECT_NEAR(q["w"].get<double>(), std::cos(30 * kDegree), 1e-9);
  ASSERT_TRUE(camera->sigma_m);
  const double s2 = 0.25, c2 = 0.75;  // squares of the heading's sine and cosine
  EXPECT_NEAR(camera->sigma_m->x(), std::sqrt(4 * c2 + 16 * s2), 1e-9);
  EXPECT_NEAR(camera->sigma_m->y(), std::sqrt(4 * s2 + 16 * c2), 1e-9);
  EXPECT_NEAR(camera->sigma_m->z(), 3, 1e-9);
}

TEST(ScenePlace, PositionsOnTheEarthAreLedToTheWorld) {
  const ScenePlace place = PlaceOfOneReference();
  const RoughPosition here{{kLon, kLat, kHeight}, Vector3d(1, 2, 3)};
  EXPECT_NEAR(*place.DistanceMeters(here), 50, 1e-2);  // the ground is not flat
  const auto prior = place.PriorOf(here);
  ASSERT_TRUE(prior);
  EXPECT_LT(prior->position.norm(), 1e-6);
  const Eigen::Matrix3d axes = EastNorthUp(kLon, kLat);
  EXPECT_TRUE(
      prior->sigma.isApprox((axes * Vector3d(1, 2, 3).asDiagonal()).rowwise().norm(), 1e-9));
  EXPECT_FALSE(place.PriorOf({{kLon, kLat, kHeight}}));
  EXPECT_FALSE(place.DistanceMeters({{kLon, 95, 0}}));
}

TEST(ScenePlace, ASystemThatIsNotMeantForTheReferencesIsRefused) {
  ReferenceSet references;
  references.images.push_back({"r.jpg", {}, LevelCamera({0, 0, 0}, 0)});
  const auto make = [&](const char* crs) { ScenePlace(WorldFrame::Parse(crs), references); };
  EXPECT_TRUE(FailsWithInputError([&] { make("EPSG:25832"); }, {}));
  make("EPSG:25832@500000,5500000,0");
}

TEST(ScenePlace, WhereASystemEndsThereIsNoGeoPose) {
  ReferenceSet references;
  references.images.push_back({"r.jpg", {}, LevelCamera({0, 0, 0}, 0)});
  const ScenePlace place(WorldFrame::Parse("EPSG:32632@500000,5500000,0"), references);
  PoseEstimate estimate;
  estimate.cam_from_world = Rigid3(Eigen::Quaterniond::Identity(), Vector3d(3e7, 0, 0));
  EXPECT_FALSE(place.CameraOf(estimate));
  EXPECT_FALSE(place.DistanceMeters({{-150, 10, 0}}));
}

// ---- requests ----

// Base64 of a gray picture of 2 x 1 pixels: "P5 2 1 255\nab".
constexpr const char* kPicture = "UDUgMiAxIDI1NQphYg==";

Json CameraReading() {
  return {{"timestamp", 1},
          {"sensorId", "0"},
          {"privacy", Json::object()},
          {"sequenceNumber", 0},
          {"imageFormat", "JPG"},
          {"size", {2, 1}},
          {"imageBytes", kPicture},
          {"imageOrientation", {{"mirrored", false}, {"rotation", 0}}},
          {"params", {{"model", "PINHOLE"}, {"modelParams", {3, 4, 1, 0.5}}}}};
}

Json Geolocation(double timestamp, double longitude) {
  return {{"timestamp", timestamp}, {"latitude", 48.5}, {"longitude", longitude},
          {"altitude", 300},        {"accuracy", 6},    {"altitudeAccuracy", 4},
          {"heading", nullptr},     {"speed", 0}};
}

Json Request() {
  return {{"id", "a"},
          {"timestamp", 1700000000123},
          {"type", "geopose"},
          {"sensors", Json::array()},
          {"sensorReadings", {{"cameraReadings", {CameraReading()}}}}};
}

GeoPoseRequest Read(const Json& request) { return ReadGeoPoseRequest(request.dump(), kMaxPixels); }

// The field that is told to be wrong.
std::string FieldOf(const Json& request) {
  try {
    Read(request);
  } catch (const Problem& problem) {
    return problem.field();
  } catch (const InputError& error) {
    return ProblemOfInput(error.what()).field();
  }
  return "none";
}

TEST(GeoPose, ARequestHoldsAPhotographAndItsCamera) {
  const GeoPoseRequest request = Read(Request());
  EXPECT_EQ(request.id, "a");
  EXPECT_EQ(request.timestamp_ms, 1700000000123);
  EXPECT_FALSE(request.near);
  EXPECT_EQ(request.photograph.query.name, "a");
  EXPECT_EQ(request.photograph.query.camera.ToString(), "PINHOLE 2 1 3 4 1 0.5");
  EXPECT_EQ(request.photograph.query.priors.focal_range, 1);
  EXPECT_EQ(std::get<Image>(request.photograph.evidence).data, (std::vector<uint8_t>{'a', 'b'}));
}

TEST(GeoPose, WithoutACameraTheFocalLengthIsNotKnown) {
  Json unknown = Request(), none = Request();
  unknown["sensorReadings"]["cameraReadings"][0]["params"] = {{"model", "UNKNOWN"},
                                                              {"modelParams", Json::array()}};
  none["sensorReadings"]["cameraReadings"][0].erase("params");
  for (const Json& request : {unknown, none}) {
    EXPECT_GT(Read(request).photograph.query.priors.focal_range, 1);
  }
}

TEST(GeoPose, PixelsMayBeRawAndDepthIsPassedOver) {
  Json request = Request();
  Json& readings = request["sensorReadings"]["cameraReadings"];
  Json depth = readings[0];
  depth["imageFormat"] = "DEPTH";
  depth["imageBytes"] = "?";
  readings[0]["imageFormat"] = "GRAY8";
  readings[0]["imageBytes"] = "YWI=";
  readings.insert(readings.begin(), depth);
  EXPECT_EQ(std::get<Image>(Read(request).photograph.evidence).data,
            (std::vector<uint8_t>{'a', 'b'}));
  readings[1]["imageFormat"] = "RGBA32";
  readings[1]["imageBytes"] = "YWFhAGJiYgA=";  // aaa0bbb0
  EXPECT_EQ(std::get<Image>(Read(request).photograph.evidence).data,
            (std::vector<uint8_t>{'a', 'b'}));
  readings[1]["size"] = {3, 1};
  EXPECT_EQ(FieldOf(request), "body.sensorReadings.cameraReadings[1].size");
}

TEST(GeoPose, TheNewestPositionTellsWhereItIs) {
  Json request = Request();
  request["priorPoses"] = {{{"id", "b"},
                            {"timestamp", 9},
                            {"geopose", {{"position", {{"lon", 7}, {"lat", 8}, {"h", 9}}}}}}};
  EXPECT_EQ(Read(request).near->geographic, Vector3d(7, 8, 9));
  EXPECT_FALSE(Read(request).near->sigma_m);
  // As the protocol calls them, and as its client does.
  for (const char* name : {"geolocationReadings", "geoLocationReadings"}) {
    Json with = request;
    with["sensorReadings"][name] = {Geolocation(2, 9.1), Geolocation(3, 9.2), Geolocation(1, 9.3)};
    const auto near = Read(with).near;
    EXPECT_EQ(near->geographic, Vector3d(9.2, 48.5, 300));
    EXPECT_EQ(near->sigma_m->x(), 4);  // two thirds are within 6 m
    EXPECT_GT(near->sigma_m->z(), 20);
  }
  Json rough = Geolocation(1, 9);
  rough["accuracy"] = 0;
  request["sensorReadings"]["geolocationReadings"] = {rough};
  EXPECT_FALSE(Read(request).near->sigma_m);
}

TEST(GeoPose, WhatIsWrongWithARequestIsNamed) {
  const auto with = [](const char* pointer, const Json& value) {
    Json request = Request();
    request[Json::json_pointer(pointer)] = value;
    return FieldOf(request);
  };
  const std::string camera = "body.sensorReadings.cameraReadings[0]";
  const std::string at = "/sensorReadings/cameraReadings/0";
  EXPECT_EQ(with("/type", "other"), "body.type");
  EXPECT_EQ(with("/timestamp", 1e300), "body.timestamp");
  EXPECT_EQ(with("/id", 3), "body.id");
  EXPECT_EQ(with("/sensorReadings", Json::array()), "body.sensorReadings");
  EXPECT_EQ(with("/sensorReadings", Json::object()), "body.sensorReadings");
  EXPECT_EQ(with((at + "/imageBytes").c_str(), "%"), camera + ".imageBytes");
  EXPECT_EQ(with((at + "/imageBytes").c_str(), "YWI="), camera + ".imageBytes");
  EXPECT_EQ(with((at + "/imageOrientation/mirrored").c_str(), true),
            camera + ".imageOrientation.mirrored");
  EXPECT_EQ(with((at + "/params/model").c_str(), "PINHOLE 2"), camera + ".params.model");
  EXPECT_EQ(with((at + "/params/model").c_str(), "OTHER"), camera + ".params.camera");
  EXPECT_EQ(with((at + "/params/modelParams").c_str(), {1}), camera + ".params.camera");
  EXPECT_EQ(with((at + "/size").c_str(), {4, 3}), camera + ".params.camera");
  EXPECT_EQ(with((at + "/size").c_str(), {4}), camera + ".size");
  EXPECT_EQ(FieldOf(Json::array()), "body");
}

TEST(GeoPose, AnAnswerIsTheProtocols) {
  LocalizedQuery localized;
  localized.estimate.verdict = PoseVerdict::kLocalized;
  localized.estimate.confidence = 0.9;
  ScenePlace::Camera camera{.geopose = R"({"position": {"lon": 1}})"};
  const GeoPoseRequest request = Read(Request());
  const Json without = Json::parse(FormatGeoPoseAnswer(request, "yard", localized, camera));
  EXPECT_EQ(without["id"], "a");
  EXPECT_EQ(without["timestamp"], 1700000000123);
  EXPECT_EQ(without["type"], "geopose");
  EXPECT_EQ(without["scene"], "yard");
  EXPECT_EQ(without["geopose"]["position"]["lon"], 1);
  EXPECT_EQ(without["accuracy"]["position"], std::numeric_limits<double>::max());
  camera.sigma_m = Vector3d(1, 2, 6);
  localized.estimate.covariance = Eigen::Matrix<double, 6, 6>::Identity() * kDegree * kDegree;
  const Json with = Json::parse(FormatGeoPoseAnswer(request, "yard", localized, camera));
  EXPECT_EQ(with["accuracy"]["position"], 3);
  EXPECT_NEAR(with["accuracy"]["orientation"].get<double>(), 1, 1e-12);
}

}  // namespace
}  // namespace raylift
