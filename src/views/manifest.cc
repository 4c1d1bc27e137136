#include <optional>

#include "base/json_members.h"
#include "jobs/file_promises.h"
#include "jobs/manifest_file.h"

#include "raylift/views/render_job.h"

namespace raylift {

using std::filesystem::path;

static void Members(JsonMembers& members, ManifestEntry& entry) {
  members("name", entry.name);
  members.If(true, "place", entry.place);
  members("key", entry.key);
  members("camera", entry.camera);
  members("pixels", entry.pixels);
  members("hits", entry.hits);
  members("depth_range", entry.depth_range);
  members("dropped", entry.dropped);
  members("files", entry.files);
}

std::string ToJsonLine(const ManifestEntry& entry) { return JsonText(ToJson(entry)); }

std::optional<ManifestEntry> ParseEntry(const std::string& line) {
  try {
    return ParseJson<ManifestEntry>(line);
  } catch (const InputError&) {
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
