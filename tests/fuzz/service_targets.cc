// What clients of the server send, behind the headers of HTTP.

#include "fuzz/fuzz_targets.h"
#include "service/localize_request.h"
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
