#include "service/geopose.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "base/json_text.h"
#include "io/text/json_document.h"
#include "service/problem.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/text.h"
#include "raylift/io/pose_priors.h"

namespace raylift {
namespace {

// Reads a number that may be missing, or null, as which JavaScript writes NaN.
std::optional<double> NumberIn(const JsonPlace& object, std::string_view name) {
  if (!object.Has(name)) return std::nullopt;
  const JsonPlace number = object.Member(name);
  return number.IsNull() ? std::nullopt : std::optional(number.Number());
}

// Returns "MODEL width height params..."; nullopt where the client knows no camera.
std::optional<std::string> CameraOf(const JsonPlace& reading) {
  if (!reading.Has("params")) return std::nullopt;
  const JsonPlace params = reading.Member("params");
  if (!params.Has("model") || !params.Has("modelParams")) return std::nullopt;
  const JsonPlace model_place = params.Member("model");
  std::string model = model_place.String();
  if (model.starts_with("UNKNOWN")) return std::nullopt;
  if (model == "THIN_PRISM") model = "THIN_PRISM_FISHEYE";  // COLMAP's name
  const bool is_word = std::all_of(
      model.begin(), model.end(), [](unsigned char c) { return std::isalnum(c) != 0 || c == '_'; });
  if (model.empty() || !is_word) model_place.Fail("is no model of a camera");
  const JsonPlace size = reading.Member("size");
  size.ExpectArraySize(2);
  std::string camera = model;
  for (size_t i = 0; i < 2; ++i) {
    const JsonPlace side = size.At(i);
    camera += fmt::format(" {}", side.Int());
  }
  const JsonPlace numbers = params.Member("modelParams");
  for (size_t i = 0; i < numbers.ArraySize(); ++i) {
    const JsonPlace number = numbers.At(i);
    camera += ' ' + FormatDouble(number.Number());
  }
  return camera;
}

// Reads pixels as they are in memory.
Image RawImage(const JsonPlace& reading, const std::string& bytes, size_t bytes_per_pixel,
               uint64_t max_pixels) {
  const JsonPlace size = reading.Member("size");
  size.ExpectArraySize(2);
  const JsonPlace width = size.At(0), height = size.At(1);
  Image image{.width_px = width.Int(), .height_px = height.Int(), .channels = 1, .data = {}};
  if (image.width_px < 1 || image.height_px < 1) size.Fail("expected a positive width and height");
  const uint64_t pixels =
      static_cast<uint64_t>(image.width_px) * static_cast<uint64_t>(image.height_px);
  if (pixels > max_pixels) size.Fail(fmt::format("has more than {} pixels", max_pixels));
  if (pixels * bytes_per_pixel != bytes.size()) {
    size.Fail(fmt::format("is not that of {} bytes", bytes.size()));
  }
  const size_t channels = std::min<size_t>(bytes_per_pixel, 3);  // opacity is left out
  image.channels = static_cast<int>(channels);
  image.data.reserve(pixels * channels);
  for (size_t i = 0; i < bytes.size(); ++i) {
    if (i % bytes_per_pixel < channels) image.data.push_back(static_cast<uint8_t>(bytes[i]));
  }
  return ToGray(image);
}

LocalizeRequest ReadCamera(const JsonPlace& reading, const std::string& path,
                           const std::string& name, uint64_t max_pixels) {
  const QueryFacts facts{.name = IsName(name) ? name : std::string(kUnnamed),
                         .camera = CameraOf(reading)};
  if (reading.Has("imageOrientation")) {
    const JsonPlace orientation = reading.Member("imageOrientation");
    const JsonPlace mirrored = orientation.Member("mirrored");
    if (mirrored.Bool()) mirrored.Fail("mirrored photographs are not localized");
  }
  const JsonPlace image = reading.Member("imageBytes");
  const PictureFields fields{.image = path + ".imageBytes", .facts = path + ".params"};
  const std::string text = image.String();
  const std::string bytes = InField(fields.image, [&] { return DecodeBase64(text); });
  const JsonPlace format_place = reading.Member("imageFormat");
  const std::string format = format_place.String();
  if (format != "GRAY8" && format != "RGBA32") {
    return RequestOfPicture(bytes, facts, max_pixels, fields);
  }
  LocalizeRequest request;
  Image gray = RawImage(reading, bytes, format == "GRAY8" ? 1 : 4, max_pixels);
  request.query = InField(fields.facts, [&] {
    return QueryOf(facts, {gray.width_px, gray.height_px});
  });
  request.evidence = std::move(gray);
  return request;
}

LocalizeRequest ReadPhotograph(const JsonPlace& readings, const std::string& name,
                               uint64_t max_pixels) {
  if (readings.Has("cameraReadings")) {
    const JsonPlace cameras = readings.Member("cameraReadings");
    for (size_t i = 0; i < cameras.ArraySize(); ++i) {
      const JsonPlace reading = cameras.At(i);
      const JsonPlace format = reading.Member("imageFormat");
      if (format.String() == "DEPTH") continue;
      return ReadCamera(reading, fmt::format("body.sensorReadings.cameraReadings[{}]", i), name,
                        max_pixels);
    }
  }
  readings.Fail("expected cameraReadings with a photograph");
}

constexpr double kFarthestFromEllipsoidM = 1e5;
constexpr double kLargestAccuracyM = 2e7;  // from a pole to the other

// Reads a number; throws where its magnitude is larger.
std::optional<double> NumberWithin(const JsonPlace& reading, std::string_view name, double most) {
  const auto number = NumberIn(reading, name);
  if (number && !(std::abs(*number) <= most)) {
    const JsonPlace place = reading.Member(name);
    place.Fail(fmt::format("must lie between -{0} and {0}", most));
  }
  return number;
}

RoughPosition ReadGeolocation(const JsonPlace& reading) {
  const JsonPlace latitude = reading.Member("latitude"), longitude = reading.Member("longitude");
  const auto altitude_m = NumberWithin(reading, "altitude", kFarthestFromEllipsoidM);
  RoughPosition position{{longitude.Number(), latitude.Number(), altitude_m.value_or(0)}};
  const double accuracy_m = NumberWithin(reading, "accuracy", kLargestAccuracyM).value_or(0);
  if (!(accuracy_m > 0)) return position;
  const bool has_height = altitude_m && NumberIn(reading, "altitudeAccuracy").value_or(0) > 0;
  position.sigma_m = GnssSigmaMeters(accuracy_m, has_height);
  return position;
}

RoughPosition ReadPriorPose(const JsonPlace& prior) {
  const JsonPlace geopose = prior.Member("geopose");
  const JsonPlace position = geopose.Member("position");
  const JsonPlace lon = position.Member("lon"), lat = position.Member("lat"),
                  h = position.Member("h");
  return {{lon.Number(), lat.Number(), h.Number()}};
}

// Reads the entry of a list that has the latest timestamp; nullopt where there is none.
template <typename Read>
std::optional<RoughPosition> Newest(const JsonPlace& object, std::string_view list_name,
                                    const Read& read) {
  if (!object.Has(list_name)) return std::nullopt;
  const JsonPlace list = object.Member(list_name);
  std::optional<RoughPosition> newest;
  double newest_ms = -std::numeric_limits<double>::infinity();
  for (size_t i = 0; i < list.ArraySize(); ++i) {
    const JsonPlace entry = list.At(i);
    const double ms = NumberIn(entry, "timestamp").value_or(0);
    if (ms < newest_ms) continue;
    newest_ms = ms;
    newest = read(entry);
  }
  return newest;
}

}  // namespace

GeoPoseRequest ReadGeoPoseRequest(std::string_view body, uint64_t max_pixels) {
  CheckJson(body);
  const JsonDocument document(body, "body");
  const JsonPlace json = document.Root();
  const JsonPlace id = json.Member("id"), type = json.Member("type"),
                  timestamp = json.Member("timestamp"), readings = json.Member("sensorReadings");
  constexpr double kMostMs = 9e15;  // that a double holds exactly
  if (!(std::abs(timestamp.Number()) < kMostMs)) timestamp.Fail("expected milliseconds since 1970");
  GeoPoseRequest request{
      .id = id.String(), .timestamp_ms = std::llround(timestamp.Number()), .photograph = {}};
  if (type.String() != "geopose") type.Fail("expected \"geopose\"");
  if (readings.IsArray()) readings.Fail("expected an object, as of version 2 of the protocol");
  // The client's name differs from the protocol's.
  for (const char* name : {"geolocationReadings", "geoLocationReadings"}) {
    if (!request.near) request.near = Newest(readings, name, ReadGeolocation);
  }
  if (!request.near) request.near = Newest(json, "priorPoses", ReadPriorPose);
  request.photograph = ReadPhotograph(readings, request.id, max_pixels);
  return request;
}

std::string FormatGeoPoseAnswer(const GeoPoseRequest& request, const std::string& scene,
                                const LocalizedQuery& localized, const ScenePlace::Camera& camera) {
  // The protocol's client takes this for an accuracy that is not known.
  double position_m = std::numeric_limits<double>::max(), orientation_deg = position_m;
  const auto& covariance = localized.estimate.covariance;
  if (camera.sigma_m && covariance) {
    position_m = camera.sigma_m->mean();
    orientation_deg = covariance->topLeftCorner<3, 3>().diagonal().cwiseMax(0).cwiseSqrt().mean() *
                      180 / std::numbers::pi;
  }
  nlohmann::ordered_json json;
  SetMember(json, "id", request.id);
  SetMember(json, "timestamp", request.timestamp_ms);
  SetIn(json, "accuracy", "position", position_m);
  SetIn(json, "accuracy", "orientation", orientation_deg);
  SetMember(json, "type", "geopose");
  SetMember(json, "scene", scene);
  SetMember(json, "verdict", ToString(localized.verdict()));
  SetMember(json, "confidence", localized.confidence());
  return WithMember(JsonText(std::move(json)), "geopose", camera.geopose);
}

}  // namespace raylift
