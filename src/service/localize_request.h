// A client's request to localize a photograph, or features or matches in its place, with what is
// known of it.

#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "pictures/exif.h"

#include "raylift/base/error.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/localization/match_source.h"
#include "raylift/scene/features.h"
#include "raylift/scene/image.h"
#include "raylift/scene/photographs.h"
#include "raylift/sequences/smoothing.h"

namespace raylift {

// References by their names.
using ReferencesByName = std::map<std::string, const PosedImage*, std::less<>>;

// The photograph's place in a walk of its client.
struct WalkStep {
  std::string token;                   // of the answer before; empty: the walk begins here
  std::optional<OdometryScale> scale;  // nullopt: as before, known at first
  Rigid3 cam_from_odometry;
  double time_s = 0;
};

struct LocalizeRequest {
  Query query;
  std::variant<Image, Features, QueryMatches> evidence;
  std::string picture_bytes = {};  // of the photograph's file, where there is one
  std::optional<WalkStep> session = std::nullopt;
};

// Reads the body of a request:
//
//   multipart/form-data   a part "image", the photograph's file, and a part "query", JSON
//   application/json      the members of "query" and one of "image" (base64), "features" (width,
//                         height, keypoints: [[x, y], ...], descriptors: [[128 numbers], ...]) and
//                         "matches": [{reference, query_px: [[x, y], ...], reference_px}, ...]
//
// "query" holds "name", "camera" ("MODEL width height params...", as in a query list), "priors"
// (lines of a priors file) and "session" (token, scale, cam_from_odometry: {qvec, tvec}, time_s),
// each of which may be left out: the name is then the file's, the camera what EXIF says or an
// unknown focal length, and the photograph is no walk's. Pixels are COLMAP's. Throws Problem, or
// InputError "FIELD: ..." for what cannot be used.
LocalizeRequest ReadLocalizeRequest(std::string_view content_type, std::string_view body,
                                    const ReferencesByName& references, uint64_t max_pixels);

// Facts that a request states of the photograph beside what it shows.
struct QueryFacts {
  std::string name = {};
  std::optional<std::string> camera = std::nullopt, priors = std::nullopt;
  std::optional<WalkStep> session = std::nullopt;
};

// The photographs of a form with several, each a request. The camera of "query" is that of all of
// them, and priors are by the photographs' names.
struct BatchEntry {
  std::string name;
  std::string_view bytes;
};
struct BatchRequest {
  std::vector<BatchEntry> photographs;
  QueryFacts facts;  // without a name and a session
};
BatchRequest ReadBatchRequest(std::string_view content_type, std::string_view body);
LocalizeRequest ReadBatchEntry(const BatchRequest& batch, size_t index, uint64_t max_pixels);

// Returns the request of a photograph's file. Errors name the fields that the file and the facts
// came in; `facts` is empty where their readers name it themselves.
struct PictureFields {
  std::string image = "image", facts = {};
};
LocalizeRequest RequestOfPicture(std::string file, const QueryFacts& facts, uint64_t max_pixels,
                                 const PictureFields& fields = {});

// Returns the query with its camera, which is the one of `size` with an unknown focal length where
// the facts do not name it.
Query QueryOf(const QueryFacts& facts, PlaneSize size, const Exif& exif = {});

// Throws InputError for JSON that would take many times its bytes as a document.
void CheckJson(std::string_view text);

// Calls `read`, and says in its InputError of which field it is.
template <typename Function>
auto InField(const std::string& field, const Function& read) {
  try {
    return read();
  } catch (const InputError& error) {
    throw InputError(field + ": " + error.what());
  }
}

// The name of a photograph that has none.
inline constexpr std::string_view kUnnamed = "photograph";
bool IsName(const std::string& name);  // 1 to 1000 bytes

}  // namespace raylift
