// What a client asks to be localized: a photograph, or features or matches in its place, with what
// is known of it.

#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "raylift/localization/match_source.h"
#include "raylift/scene/features.h"
#include "raylift/scene/image.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// References by their names.
using ReferencesByName = std::map<std::string, const PosedImage*, std::less<>>;

struct LocalizeRequest {
  Query query;
  std::variant<Image, Features, QueryMatches> evidence;
  std::string picture_bytes = {};  // of the photograph's file, where there is one
};

// Reads the body of a request:
//
//   multipart/form-data   a part "image", the photograph's file, and a part "query", JSON
//   application/json      the members of "query" and one of "image" (base64), "features" (width,
//                         height, keypoints: [[x, y], ...], descriptors: [[128 numbers], ...]) and
//                         "matches": [{reference, query_px: [[x, y], ...], reference_px}, ...]
//
// "query" holds "name", "camera" ("MODEL width height params...", as in a query list) and "priors"
// (lines of a priors file), each of which may be left out: the name is then the file's, and the
// camera what EXIF says or an unknown focal length. Pixels are COLMAP's. Throws Problem, or
// InputError "FIELD: ..." for what cannot be used.
LocalizeRequest ReadLocalizeRequest(std::string_view content_type, std::string_view body,
                                    const ReferencesByName& references, uint64_t max_pixels);

// What a request says of the photograph beside what it shows.
struct QueryFacts {
  std::string name = {};
  std::optional<std::string> camera = std::nullopt, priors = std::nullopt;
};

// The photographs of a form with several, each a request. The camera of "query" is that of all of
// them, and priors are by the photographs' names.
struct BatchEntry {
  std::string name;
  std::string_view bytes;
};
struct BatchRequest {
  std::vector<BatchEntry> photographs;
  QueryFacts facts;  // without a name
};
BatchRequest ReadBatchRequest(std::string_view content_type, std::string_view body);
LocalizeRequest ReadBatchEntry(const BatchRequest& batch, size_t index, uint64_t max_pixels);

// Returns the bytes that a text of base64 stands for. Throws InputError where it is none.
std::string DecodeBase64(std::string_view text);

}  // namespace raylift
