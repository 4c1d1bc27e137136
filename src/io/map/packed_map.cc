#include "io/map/packed_map.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <mutex>
#include <set>
#include <span>
#include <utility>

#include "base/bytes.h"
#include "base/json_text.h"
#include "base/mapped_file.h"
#include "base/read_limits.h"
#include "io/binary/zip_archive.h"
#include "io/map/map_codec.h"
#include "io/text/json_document.h"
#include "io/text/line_tokens.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

using std::filesystem::path;

constexpr std::string_view kFormat = "raylift-map/1";
constexpr std::string_view kHeader = "map.json";
constexpr std::string_view kReferences = "references.txt";
constexpr std::string_view kCalibration = "calibration.json";
constexpr std::string_view kRetrieval = "retrieval";

constexpr size_t kNameAt = 30;  // that of the first entry of a ZIP, after its fixed header
bool StartsAsMap(std::string_view bytes) {
  return IsZip(bytes) && bytes.substr(kNameAt).starts_with(kHeader);
}
std::string_view RequireMap(const path& file, std::string_view bytes) {
  if (bytes.size() < kNameAt || !StartsAsMap(bytes)) {
    throw InputError(file, "expected a packed map, as `raylift map pack` makes it");
  }
  return bytes;
}

std::string DepthEntry(const std::string& name) { return "depth/" + name; }
std::string FeaturesEntry(const std::string& name) { return "features/" + name; }

std::string HeaderText(const MapHeader& header) {
  const nlohmann::ordered_json json = {{"format", kFormat},
                                       {"descriptors", ToString(header.descriptors)},
                                       {"features", header.features},
                                       {"seed", header.seed},
                                       {"depth_keys", header.depth_keys},
                                       {"crs", header.crs}};
  return JsonText(json, 2) + "\n";
}

MapHeader ParseHeader(const path& file, const std::string& text) {
  const JsonDocument document(text, file);
  const JsonPlace top = document.Root();
  const auto member = [&](std::string_view name) { return top.Member(name); };
  if (const std::string format = member("format").String(); format != kFormat) {
    member("format").Fail(fmt::format("expected \"{}\", found \"{}\"", kFormat, format));
  }
  MapHeader header;
  const JsonPlace descriptors = top.Member("descriptors");
  const auto precision = FromName<DescriptorPrecision>(descriptors.String());
  if (!precision) descriptors.Fail(fmt::format("expected {}", NameList<DescriptorPrecision>()));
  header.descriptors = *precision;
  header.features = member("features").String();
  const double seed = member("seed").Number();
  if (!(seed >= 0 && seed <= static_cast<double>(kMaxMapSeed) && std::floor(seed) == seed)) {
    member("seed").Fail(fmt::format("expected 0 to {}, found {}", kMaxMapSeed, seed));
  }
  header.seed = static_cast<uint64_t>(seed);
  header.depth_keys = member("depth_keys").String();
  header.crs = member("crs").String();
  return header;
}

std::string ReferencesText(const path& file, std::span<const PosedImage> references) {
  std::string text;
  for (const PosedImage& image : references) {
    text += fmt::format("{} {} {}\n", NameText(file, image.name), FormatPose(image.cam_from_world),
                        image.camera.ToString());
  }
  return text;
}

std::vector<PosedImage> ParseReferences(const path& file, std::string text) {
  std::vector<PosedImage> references;
  LineReader lines(file / kReferences, std::move(text));
  while (const auto line = lines.NextContent()) {
    LineTokens tokens(lines, *line);
    std::string name(tokens.Name());
    if (!references.empty() && name <= references.back().name) {
      tokens.Fail(fmt::format("\"{}\" is not after \"{}\"", name, references.back().name));
    }
    const Rigid3 pose = tokens.Pose();
    references.push_back({std::move(name), tokens.CameraToEnd(), pose});
  }
  return references;
}

// ---- retrieval: words as floats, vectors, which have unit length, in steps of their own ----

constexpr int kVectorSteps = 127;

std::string EncodeRetrieval(const PackedRetrieval& retrieval) {
  std::string sizes;
  for (const Eigen::Index size :
       {retrieval.words.rows(), retrieval.words.cols(), retrieval.vectors.cols()}) {
    const auto count = static_cast<uint32_t>(size);
    sizes += AsBytes(std::span<const uint32_t, 1>(&count, 1));
  }
  std::string bytes;
  bytes += AsBytes(
      std::span<const float>(retrieval.words.data(), static_cast<size_t>(retrieval.words.size())));
  for (const auto& vector : retrieval.vectors.colwise()) {
    const float largest = std::max(vector.cwiseAbs().maxCoeff(), 1e-12f);
    for (const float value : vector) {
      bytes += static_cast<char>(std::lround(value / largest * kVectorSteps));
    }
  }
  return sizes + Deflated(bytes);
}

PackedRetrieval DecodeRetrieval(const path& file, const std::string& bytes, size_t num_references) {
  constexpr size_t kSizes = 3 * sizeof(uint32_t);
  const auto fail = [&] {
    throw InputError(file, std::string(kRetrieval), "the entry is damaged");
  };
  if (bytes.size() < kSizes) fail();
  const uint64_t dimension = LoadNumber<uint32_t>(bytes.data());
  const uint64_t num_words = LoadNumber<uint32_t>(bytes.data() + sizeof(uint32_t));
  const uint64_t count = LoadNumber<uint32_t>(bytes.data() + 2 * sizeof(uint32_t));
  const uint64_t size = dimension * num_words;
  if (count != num_references || size > kMaxDeflateRatio * bytes.size()) fail();
  const std::string body =
      Inflated(file, std::string(kRetrieval), std::string_view(bytes).substr(kSizes),
               size * sizeof(float) + count * size);
  PackedRetrieval retrieval;
  retrieval.words.resize(static_cast<Eigen::Index>(dimension),
                         static_cast<Eigen::Index>(num_words));
  const char* next = body.data();
  for (float& value : retrieval.words.reshaped()) {
    value = LoadNumber<float>(next);
    if (!std::isfinite(value)) fail();
    next += sizeof(float);
  }
  retrieval.vectors.resize(static_cast<Eigen::Index>(size), static_cast<Eigen::Index>(count));
  for (float& value : retrieval.vectors.reshaped()) value = static_cast<signed char>(*next++);
  for (auto vector : retrieval.vectors.colwise()) {
    if (const float norm = vector.norm(); norm > 0) vector /= norm;  // 0: without features
  }
  return retrieval;
}

}  // namespace

bool IsPackedMap(const path& file) {
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(file, ignored)) return false;
  std::string start(kNameAt + kHeader.size(), '\0');
  std::ifstream(file, std::ios::binary)
      .read(start.data(), static_cast<std::streamsize>(start.size()));
  return StartsAsMap(start);
}

struct PackedMap::Impl {
  explicit Impl(const path& from)
      : file(from), mapped(from), archive(from, RequireMap(from, mapped.contents())) {
    names.insert(archive.names().begin(), archive.names().end());
    header = ParseHeader(file / kHeader, archive.Read(std::string(kHeader)));
    references = ParseReferences(file, archive.Read(std::string(kReferences)));
  }

  std::string Read(const std::string& entry) const {
    const std::lock_guard<std::mutex> lock(mutex);
    return archive.Read(entry);
  }

  path file;
  MappedFile mapped;
  ZipReader archive;
  std::set<std::string, std::less<>> names;
  MapHeader header;
  std::vector<PosedImage> references;
  mutable std::mutex mutex;  // libzip's archives are of one thread
};

PackedMap::PackedMap(const path& file) : impl_(std::make_unique<Impl>(file)) {}
PackedMap::~PackedMap() = default;
PackedMap::PackedMap(PackedMap&&) noexcept = default;
PackedMap& PackedMap::operator=(PackedMap&&) noexcept = default;

const path& PackedMap::file() const { return impl_->file; }
const MapHeader& PackedMap::header() const { return impl_->header; }
const std::vector<PosedImage>& PackedMap::references() const { return impl_->references; }

bool PackedMap::HasDepth(const std::string& reference) const {
  return impl_->names.contains(DepthEntry(reference));
}
bool PackedMap::HasFeatures(const std::string& reference) const {
  return impl_->names.contains(FeaturesEntry(reference));
}
std::string PackedMap::DepthBytes(const std::string& reference) const {
  return HasDepth(reference) ? impl_->Read(DepthEntry(reference)) : std::string();
}
std::string PackedMap::FeatureBytes(const std::string& reference) const {
  return HasFeatures(reference) ? impl_->Read(FeaturesEntry(reference)) : std::string();
}
size_t PackedMap::IndexOf(const std::string& reference) const {
  const auto found = std::ranges::lower_bound(impl_->references, reference, {}, &PosedImage::name);
  if (found == impl_->references.end() || found->name != reference) {
    throw InputError(impl_->file, reference, "the reference is not in the map");
  }
  return static_cast<size_t>(found - impl_->references.begin());
}
DepthMap PackedMap::ReadDepth(const std::string& reference) const {
  const std::string entry = DepthEntry(reference);
  return DecodeDepth(impl_->file, entry, impl_->Read(entry));
}
Features PackedMap::ReadFeatures(const std::string& reference) const {
  const std::string entry = FeaturesEntry(reference);
  return DecodeFeatures(impl_->file, entry, impl_->Read(entry));
}
std::optional<PackedRetrieval> PackedMap::ReadRetrieval() const {
  if (!impl_->names.contains(kRetrieval)) return std::nullopt;
  return DecodeRetrieval(impl_->file, impl_->Read(std::string(kRetrieval)),
                         impl_->references.size());
}
std::string PackedMap::ReadCalibration() const {
  return impl_->names.contains(kCalibration) ? impl_->Read(std::string(kCalibration))
                                             : std::string();
}

std::shared_ptr<const PackedMap> OpenPackedMap(const path& file) {
  return IsPackedMap(file) ? std::make_shared<const PackedMap>(file) : nullptr;
}

void WritePackedMap(const path& file, const MapContents& contents) {
  std::vector<ZipEntry> entries;
  const auto add = [&](std::string_view name, std::function<std::string()> bytes) {
    entries.push_back({std::string(name), std::move(bytes)});
  };
  add(kHeader, [&] { return HeaderText(contents.header); });
  add(kReferences, [&] { return ReferencesText(file, contents.references); });
  if (!contents.calibration.empty()) add(kCalibration, [&] { return contents.calibration; });
  if (contents.retrieval) {
    add(kRetrieval, [&] { return EncodeRetrieval(*contents.retrieval); });
  }
  for (size_t i = 0; i < contents.references.size(); ++i) {
    const std::string& name = contents.references[i].name;
    if (contents.has_depth[i]) add(DepthEntry(name), [&, i] { return contents.depth(i); });
    if (contents.has_features[i]) add(FeaturesEntry(name), [&, i] { return contents.features(i); });
  }
  WriteZip(file, entries);
}

}  // namespace raylift
