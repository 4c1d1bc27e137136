#include "service/localize_request.h"

#include <array>
#include <cmath>
#include <set>
#include <sstream>
#include <utility>

#include "io/text/json_document.h"
#include "localization/matching/pixel_matches.h"
#include "pictures/exif.h"
#include "pictures/picture_codec.h"
#include "service/multipart.h"
#include "service/problem.h"
#include <fmt/format.h>

#include "raylift/base/enum_names.h"
#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/io/image_file.h"
#include "raylift/io/pose_priors.h"
#include "raylift/io/query_list.h"

namespace raylift {
namespace {

constexpr std::string_view kNameIs = "expected 1 to 1000 bytes";

// Reads priors, which are one text or a line each.
std::string ReadLines(const JsonPlace& place) {
  std::string text;
  const bool is_list = place.IsArray();
  for (size_t i = 0; i < (is_list ? place.ArraySize() : 1); ++i) {
    text += is_list ? place.At(i).String() : place.String();
    text += '\n';
  }
  return text;
}

// Refuses long priors, and definitions of coordinate systems, which can name files and cost time
// and memory each.
void CheckPriors(std::string_view text, const JsonPlace& place) {
  constexpr size_t kMaxBytes = size_t{64} << 10;
  if (text.size() > kMaxBytes) place.Fail(fmt::format("is longer than {} bytes", kMaxBytes));
  for (const std::string_view crs : {"crs=", "world_crs"}) {
    if (text.find(crs) != std::string_view::npos) {
      place.Fail("systems of coordinates are not taken from clients");
    }
  }
}

WalkStep ReadSession(const JsonPlace& json) {
  json.ExpectMembers({"token", "scale", "cam_from_odometry", "time_s"});
  WalkStep step;
  if (json.Has("token")) step.token = json.Member("token").String();
  if (json.Has("scale")) {
    const JsonPlace scale = json.Member("scale");
    step.scale = FromName<OdometryScale>(scale.String());
    if (!step.scale) scale.Fail("expected " + NameList<OdometryScale>());
  }
  constexpr double kMost = 1e9;
  const JsonPlace pose = json.Member("cam_from_odometry");
  pose.ExpectMembers({"qvec", "tvec"});
  step.cam_from_odometry = {pose.Member("qvec").Rotation(), pose.Member("tvec").Vector<3>()};
  if (!(step.cam_from_odometry.translation.norm() < kMost)) pose.Fail("is too far away");
  const JsonPlace time = json.Member("time_s");
  step.time_s = time.Number();
  if (!(std::abs(step.time_s) < kMost * kMost)) time.Fail("is out of range");
  return step;
}

QueryFacts ReadFacts(const JsonPlace& json) {
  QueryFacts facts;
  if (json.Has("name")) {
    const JsonPlace name = json.Member("name");
    facts.name = name.String();
    if (!IsName(facts.name)) name.Fail(kNameIs);
  }
  if (json.Has("camera")) facts.camera = json.Member("camera").String();
  if (json.Has("priors")) {
    const JsonPlace priors = json.Member("priors");
    facts.priors = ReadLines(priors);
    CheckPriors(*facts.priors, priors);
  }
  if (json.Has("session")) facts.session = ReadSession(json.Member("session"));
  return facts;
}

std::vector<Eigen::Vector2d> ReadPixels(const JsonPlace& list) {
  std::vector<Eigen::Vector2d> pixels(list.ArraySize());
  for (size_t i = 0; i < pixels.size(); ++i) {
    const JsonPlace pixel = list.At(i);
    pixels[i] = pixel.Vector<2>();
  }
  return pixels;
}

Features ReadFeatures(const JsonPlace& json) {
  json.ExpectMembers({"width", "height", "keypoints", "descriptors"});
  constexpr Eigen::Index kSize = 128;  // RootSIFT's
  Features features;
  features.image_width_px = json.Member("width").Int();
  features.image_height_px = json.Member("height").Int();
  features.keypoints_px = ReadPixels(json.Member("keypoints"));
  const JsonPlace descriptors = json.Member("descriptors");
  descriptors.ExpectArraySize(features.keypoints_px.size());
  features.descriptors.resize(kSize, static_cast<Eigen::Index>(features.keypoints_px.size()));
  for (Eigen::Index i = 0; i < features.descriptors.cols(); ++i) {
    const JsonPlace descriptor = descriptors.At(static_cast<size_t>(i));
    features.descriptors.col(i) = descriptor.Vector<kSize>().cast<float>();
    if (!features.descriptors.col(i).allFinite()) descriptor.Fail("is out of range");
  }
  return features;
}

// Reads matches, in whose list each reference stands once.
QueryMatches ReadMatches(const JsonPlace& list, const Query& query,
                         const ReferencesByName& references) {
  const MatchReading reading{.first_pixel = 0.5};
  QueryPixels pixels(query, reading);
  QueryMatches matches;
  std::set<std::string> seen;
  for (size_t i = 0; i < list.ArraySize(); ++i) {
    const JsonPlace entry = list.At(i);
    entry.ExpectMembers({"reference", "query_px", "reference_px"});
    const JsonPlace name = entry.Member("reference");
    const auto found = references.find(name.String());
    if (found == references.end()) name.Fail("is no reference of the scene");
    if (!seen.insert(found->first).second) name.Fail("stands twice");
    const PosedImage& reference = *found->second;
    const PixelMatches given{.query_px = ReadPixels(entry.Member("query_px")),
                             .reference_px = ReadPixels(entry.Member("reference_px")),
                             .scores = {}};
    entry.Member("reference_px").ExpectArraySize(given.query_px.size());
    pixels.Add(pixels.Inside(given, reference.name, reference.camera, "matches").matches,
               static_cast<int>(matches.references.size()), &matches);
    matches.references.push_back(reference);
  }
  return matches;
}

LocalizeRequest OfMatches(const JsonPlace& json, const QueryFacts& facts,
                          const ReferencesByName& references) {
  if (!facts.camera) throw InputError("camera: is required with matches");
  LocalizeRequest request;
  Query of_camera;
  TakeCamera(*facts.camera, of_camera);
  request.query = QueryOf(facts, {of_camera.camera.width_px(), of_camera.camera.height_px()});
  request.evidence = ReadMatches(json.Member("matches"), request.query, references);
  return request;
}

LocalizeRequest OfFeatures(const JsonPlace& json, const QueryFacts& facts) {
  LocalizeRequest request;
  const JsonPlace place = json.Member("features");
  Features features = ReadFeatures(place);
  const PlaneSize size{features.image_width_px, features.image_height_px};
  if (size.width_px < 1 || size.height_px < 1) place.Fail("expected a positive width and height");
  request.query = QueryOf(facts, size);
  request.evidence = std::move(features);
  return request;
}

LocalizeRequest OfJson(std::string_view body, const ReferencesByName& references,
                       uint64_t max_pixels) {
  CheckJson(body);
  const JsonDocument document(body, "body");
  const JsonPlace json = document.Root();
  json.ExpectMembers({"name", "camera", "priors", "session", "image", "features", "matches"});
  QueryFacts facts = ReadFacts(json);
  if (facts.name.empty()) facts.name = kUnnamed;
  const int given = static_cast<int>(json.Has("image")) + static_cast<int>(json.Has("features")) +
                    static_cast<int>(json.Has("matches"));
  if (given != 1) json.Fail("expected one of image, features and matches");
  const auto read = [&] {
    if (json.Has("features")) return OfFeatures(json, facts);
    if (json.Has("matches")) return OfMatches(json, facts, references);
    const std::string text = json.Member("image").String();
    return RequestOfPicture(InField("image", [&] { return DecodeBase64(text); }), facts,
                            max_pixels);
  };
  LocalizeRequest request = read();
  request.session = std::move(facts.session);
  return request;
}

struct Form {
  std::vector<BatchEntry> images;
  std::string query;
};

Form ReadForm(std::string_view content_type, std::string_view body) {
  const auto boundary = HeaderParameter(content_type, "boundary");
  if (!boundary) throw Problem(400, "multipart/form-data: the boundary is missing");
  Form form;
  bool has_query = false;
  for (const FormPart& part : ParseMultipart(body, *boundary)) {
    if (part.name == "image") {
      form.images.push_back(
          {part.file_name && !part.file_name->empty() ? *part.file_name : std::string(kUnnamed),
           part.content});
    } else if (part.name == "query") {
      if (std::exchange(has_query, true)) throw Problem(400, "query", "query: stands twice");
      form.query = part.content;
    } else {
      throw Problem(400, part.name, part.name + ": expected the parts image and query");
    }
  }
  if (form.images.empty()) throw Problem(400, "image", "image: the part is missing");
  return form;
}

QueryFacts FactsOfForm(const std::string& query) {
  if (query.empty()) return {};
  CheckJson(query);
  const JsonDocument document(query, "query");
  const JsonPlace json = document.Root();
  json.ExpectMembers({"name", "camera", "priors", "session"});
  return ReadFacts(json);
}

LocalizeRequest OfFormPicture(const BatchEntry& photograph, QueryFacts facts, uint64_t max_pixels) {
  if (facts.name.empty()) facts.name = photograph.name;
  if (!IsName(facts.name)) throw Problem(400, "image", fmt::format("file name: {}", kNameIs));
  LocalizeRequest request =
      RequestOfPicture(std::string(photograph.bytes), facts, max_pixels, {.facts = "query"});
  request.session = std::move(facts.session);
  return request;
}

}  // namespace

bool IsName(const std::string& name) {
  constexpr size_t kMaxBytes = 1000;
  return !name.empty() && name.size() <= kMaxBytes;
}

Query QueryOf(const QueryFacts& facts, PlaneSize size, const Exif& exif) {
  Query query;
  if (facts.camera) {
    query.name = facts.name;
    TakeCamera(*facts.camera, query);
    const auto why = WhyOtherSize(query.camera, query.name, size, exif.SwapsSides());
    if (why) throw InputError("camera: " + *why);
  } else {
    query = QueryOfUnknownCamera(facts.name, size, exif.lens);
  }
  if (facts.priors) {
    TakePosePriors(ParsePosePriors("priors", *facts.priors), "priors", {&query, 1});
  }
  return query;
}

LocalizeRequest RequestOfPicture(std::string file, const QueryFacts& facts, uint64_t max_pixels,
                                 const PictureFields& fields) {
  LocalizeRequest request;
  std::istringstream header(std::move(file));
  const std::string_view bytes = header.view();
  const Exif exif = InField(fields.image, [&] {
    if (const auto why = WhyNoPicture(bytes)) throw InputError(*why);
    const auto size = PictureSizeFromHeader(header);
    if (static_cast<uint64_t>(size->width_px) * static_cast<uint64_t>(size->height_px) >
        max_pixels) {
      throw Problem(413, fields.image,
                    fmt::format("{}: has {} x {} pixels, more than {}", fields.image,
                                size->width_px, size->height_px, max_pixels));
    }
    request.evidence = DecodePhotograph(bytes, ImageChannels::kGray);
    header.clear();
    header.seekg(0);
    return ReadExif(header);
  });
  const Image& image = std::get<Image>(request.evidence);
  const auto read = [&] { return QueryOf(facts, {image.width_px, image.height_px}, exif); };
  request.query = fields.facts.empty() ? read() : InField(fields.facts, read);
  request.picture_bytes = std::move(header).str();
  return request;
}

void CheckJson(std::string_view text) {
  constexpr size_t kMaxBytes = size_t{16} << 20;
  constexpr int kMaxNesting = 8;
  if (text.size() > kMaxBytes) {
    throw Problem(413, fmt::format("JSON of {} bytes, more than {}", text.size(), kMaxBytes));
  }
  int nesting = 0;
  bool in_string = false;
  for (size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (in_string && c == '\\') {
      ++i;
    } else if (c == '"') {
      in_string = !in_string;
    } else if (!in_string && (c == '[' || c == '{')) {
      if (++nesting > kMaxNesting) throw InputError("JSON is nested too deeply");
    } else if (!in_string && (c == ']' || c == '}')) {
      --nesting;
    }
  }
}

LocalizeRequest ReadLocalizeRequest(std::string_view content_type, std::string_view body,
                                    const ReferencesByName& references, uint64_t max_pixels) {
  const std::string type = MediaType(content_type);
  if (type == "application/json") return OfJson(body, references, max_pixels);
  if (type != "multipart/form-data") {
    throw Problem(415, "Content-Type", "expected multipart/form-data or application/json");
  }
  const Form form = ReadForm(content_type, body);
  if (form.images.size() != 1) throw Problem(400, "image", "image: stands more than once");
  return OfFormPicture(form.images.front(), FactsOfForm(form.query), max_pixels);
}

BatchRequest ReadBatchRequest(std::string_view content_type, std::string_view body) {
  if (MediaType(content_type) != "multipart/form-data") {
    throw Problem(415, "Content-Type", "expected multipart/form-data");
  }
  Form form = ReadForm(content_type, body);
  BatchRequest batch{.photographs = std::move(form.images), .facts = FactsOfForm(form.query)};
  if (!batch.facts.name.empty()) {
    throw Problem(400, "query.name", "query: name: each photograph has its file's");
  }
  if (batch.facts.session) {
    throw Problem(400, "query.session", "query: session: is of one photograph at a time");
  }
  return batch;
}

LocalizeRequest ReadBatchEntry(const BatchRequest& batch, size_t index, uint64_t max_pixels) {
  return OfFormPicture(batch.photographs[index], batch.facts, max_pixels);
}

}  // namespace raylift
