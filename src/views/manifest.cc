#include <optional>

#include "base/json_text.h"
#include "jobs/file_promises.h"
#include "jobs/manifest_file.h"

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
  entry.files = FilesFromJson(json.at("files"));
  return entry;
}

}  // namespace

std::string ToJsonLine(const ManifestEntry& entry) {
  Json json = {{"name", entry.name},     {"place", entry.place},    {"key", entry.key},
               {"camera", entry.camera}, {"pixels", entry.pixels},  {"hits", entry.hits},
               {"depth_range", nullptr}, {"dropped", entry.dropped}};
  if (entry.depth_range) {
    json["depth_range"] = {entry.depth_range->first, entry.depth_range->second};
  }
  json["files"] = FilesJson(entry.files);
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

}  // namespace raylift
