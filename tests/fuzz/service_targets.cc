// What clients of the server send, behind the headers of HTTP.

#include "fuzz/fuzz_targets.h"
#include "service/geopose.h"
#include "service/localize_request.h"
#include "service/mesh_view.h"
#include "service/multipart.h"
#include "service/problem.h"
#include "service/service.h"

#include "raylift/base/error.h"

namespace raylift {
namespace {

constexpr uint64_t kMaxPixels = 1 << 20;

// A problem is what a client is told, as InputError is.
template <typename Function>
void AsInput(const Function& read) {
  try {
    read();
  } catch (const Problem& problem) {
    ProblemJson(problem);
    throw InputError(problem.what());
  } catch (const InputError& error) {
    ProblemJson(ProblemOfInput(error.what()));
    throw;
  }
}

std::string Form() {
  return "--b\r\nContent-Disposition: form-data; name=\"image\"; filename=\"a.pgm\"\r\n\r\nP5 2 1 "
         "255\nab\r\n--b\r\nContent-Disposition: form-data; name=query\r\n\r\n"
         "{\"camera\": \"SIMPLE_PINHOLE 2 1 3 1 0.5\", \"priors\": \"a.pgm position 1 2 3 4\"}"
         "\r\n--b--\r\n";
}

}  // namespace

std::vector<FuzzTarget> ServiceFuzzTargets() {
  return {
      {"service_form",
       [](std::string_view bytes) {
         AsInput([&] {
           ReadLocalizeRequest("multipart/form-data; boundary=b", bytes, {}, kMaxPixels);
         });
       },
       [] { return std::vector<std::string>{Form()}; },
       "\r\n --b -- Content-Disposition: form-data; name= filename= image query camera priors"},
      {"service_json",
       [](std::string_view bytes) {
         static const PosedImage reference{.name = "r", .camera = {}, .cam_from_world = {}};
         AsInput([&] {
           ReadLocalizeRequest("application/json", bytes, {{"r", &reference}}, kMaxPixels);
         });
       },
       [] {
         return std::vector<std::string>{
             R"({"image": "UDUgMiAxIDI1NQphYg=="})",
             R"({"camera": "SIMPLE_PINHOLE 2 1 3 1 0.5", "matches": [{"reference": "r",)"
             R"("query_px": [[1, 0.5]], "reference_px": [[0.5, 0.5]]}]})",
             R"({"features": {"width": 2, "height": 1, "keypoints": [], "descriptors": []}})"};
       },
       "image features matches name camera priors width height keypoints descriptors "
       "reference query_px reference_px"},
      {"service_geopose",
       [](std::string_view bytes) { AsInput([&] { ReadGeoPoseRequest(bytes, kMaxPixels); }); },
       [] {
         const std::string start = R"({"id": "a", "timestamp": 1, "type": "geopose", )"
                                   R"("sensors": [], "sensorReadings": {"cameraReadings": [)"
                                   R"({"size": [2, 1], "imageFormat": )";
         return std::vector<std::string>{
             start + R"("JPG", "imageBytes": "UDUgMiAxIDI1NQphYg==", "params": )"
                     R"({"model": "PINHOLE", "modelParams": [3, 4, 1, 0.5]}}]}})",
             start + R"("RGBA32", "imageBytes": "YWFhAGJiYgA=", )"
                     R"("imageOrientation": {"mirrored": false, "rotation": 0}}], )"
                     R"("geolocationReadings": [{"timestamp": 1, "latitude": 48, "longitude": 9, )"
                     R"("altitude": 1, "accuracy": 5, "altitudeAccuracy": null}]}})",
             start + R"("GRAY8", "imageBytes": "YWI="}]}, "priorPoses": [{"timestamp": 1, )"
                     R"("geopose": {"position": {"lon": 9, "lat": 48, "h": 1}}}]})"};
       },
       "id timestamp type geopose sensorReadings cameraReadings imageFormat JPG GRAY8 RGBA32 DEPTH "
       "size imageBytes imageOrientation mirrored params model UNKNOWN modelParams "
       "geolocationReadings latitude longitude altitude accuracy altitudeAccuracy priorPoses "
       "position lon lat h"},
      {"service_view", [](std::string_view bytes) { AsInput([&] { ReadViewRequest(bytes); }); },
       [] {
         return std::vector<std::string>{
             R"({"camera": "PINHOLE 2 1 3 4 1 0.5",)"
             R"( "cam_from_world": {"qvec": [1, 0, 0, 0], "tvec": [1, 2, 3]}})"};
       },
       "camera PINHOLE cam_from_world qvec tvec"},
      {"service_target", [](std::string_view bytes) { AsInput([&] { ParseParameters(bytes); }); },
       [] { return std::vector<std::string>{"/v1/localize?scene=a%20b"}; },
       "/v1/localize ? scene= & %2F +"},
      {"service_header",
       [](std::string_view bytes) {
         MediaType(bytes);
         HeaderParameter(bytes, "boundary");
       },
       [] { return std::vector<std::string>{"multipart/form-data; boundary=\"a\\\"b\""}; },
       "boundary = ; \""}};
}

}  // namespace raylift
