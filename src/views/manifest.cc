#include <optional>

#include "base/hash.h"
#include "base/json_text.h"
#include "jobs/manifest_file.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/parallel.h"
#include "raylift/views/render_job.h"

namespace raylift {
namespace {

using Json = nlohmann::ordered_json;
using std::filesystem::path;

ManifestEntry FromJson(const Json& json) {
  ManifestEntry entry;
  entry.place = json.value("place", size_t{0});
  entry.name = json.at("name");
  entry.key = json.at("key");
  entry.camera = json.at("camera");
  entry.pixels = json.at("pixels");
  entry.hits = json.at("hits");
  if (json.at("depth_range").is_array()) {
    entry.depth_range =
        std::pair<float, float>(json.at("depth_range").at(0), json.at("depth_range").at(1));
  }
  entry.dropped = json.at("dropped");
  for (const Json& file : json.at("files")) {
    entry.files.push_back({file.at("path"), file.at("bytes"), file.value("xxh3", "")});
  }
  return entry;
}

std::optional<std::string> FaultOf(const std::filesystem::path& out,
                                   const ManifestEntry::File& file) {
  std::error_code error;
  const auto size = std::filesystem::file_size(out / file.path, error);
  if (error) return "is missing";
  if (size != file.bytes) return fmt::format("has {} bytes, not {}", size, file.bytes);
  if (file.xxh3.empty()) return "has no checksum in the manifest";
  const auto hash = FileHash(out / file.path);
  if (!hash) return "cannot be read";
  if (*hash != file.xxh3) return "has other contents";
  return std::nullopt;
}

}  // namespace

std::string ToJsonLine(const ManifestEntry& entry) {
  Json json = {{"name", entry.name},     {"place", entry.place},    {"key", entry.key},
               {"camera", entry.camera}, {"pixels", entry.pixels},  {"hits", entry.hits},
               {"depth_range", nullptr}, {"dropped", entry.dropped}};
  if (entry.depth_range) {
    json["depth_range"] = {entry.depth_range->first, entry.depth_range->second};
  }
  Json files = Json::array();
  for (const ManifestEntry::File& file : entry.files) {
    files.push_back({{"path", file.path}, {"bytes", file.bytes}, {"xxh3", file.xxh3}});
  }
  json["files"] = std::move(files);
  return JsonText(json);
}

std::optional<ManifestEntry> ParseEntry(const std::string& line) {
  try {
    return FromJson(Json::parse(line));
  } catch (const Json::exception&) {
    return std::nullopt;
  }
}

ManifestEntries ReadManifest(const path& file) {
  ManifestEntries entries;
  for (const std::string& line : ReadManifestText(file).lines) {
    if (auto entry = ParseEntry(line)) entries.insert_or_assign(entry->name, std::move(*entry));
  }
  return entries;
}

ManifestEntries EntriesOf(const TaskManifest& manifest) {
  ManifestEntries entries;
  for (const auto& [key, record] : manifest.records) {
    ManifestEntry entry = ParseEntry(record.line).value();
    entries.emplace(entry.name, std::move(entry));
  }
  return entries;
}

Verification VerifyRenderedFiles(const std::filesystem::path& out, int threads) {
  ManifestEntries entries;
  for (const auto& manifest : ListManifests(out)) entries.merge(ReadManifest(manifest));
  std::vector<const ManifestEntry::File*> files;
  Verification verification{.images = entries.size()};
  for (const auto& [name, entry] : entries) {
    for (const ManifestEntry::File& file : entry.files) {
      files.push_back(&file);
      verification.bytes += file.bytes;
    }
  }
  verification.files = files.size();
  std::vector<std::optional<std::string>> faults(files.size());
  ParallelFor(files.size(), threads, [&](size_t i) { faults[i] = FaultOf(out, *files[i]); });
  for (size_t i = 0; i < files.size(); ++i) {
    if (faults[i]) verification.faults.push_back({files[i]->path, *faults[i]});
  }
  return verification;
}

}  // namespace raylift
