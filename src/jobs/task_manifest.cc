#include "raylift/jobs/task_manifest.h"

#include <utility>

#include "base/json_text.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/jobs/manifest_file.h"

namespace raylift {
namespace {

using Json = nlohmann::ordered_json;
using std::filesystem::path;

void TakeLine(const std::string& line, TaskManifest& manifest) {
  const Json json = Json::parse(line, nullptr, /*allow_exceptions=*/false);
  if (!json.is_object()) return;
  if (!json.contains("name")) {
    manifest.facts = line;
    return;
  }
  try {
    manifest.records.insert_or_assign(json.at("key").get<std::string>(),
                                      TaskRecord{json.at("place").get<size_t>(), line});
  } catch (const Json::exception&) {
    return;
  }
}

}  // namespace

TaskManifest ReadTaskManifest(const path& file, const IsReadable& is_readable) {
  TaskManifest manifest;
  const ManifestText text = ReadManifestText(file);
  manifest.header = text.header;
  for (const std::string& line : text.lines) {
    if (is_readable(line)) TakeLine(line, manifest);
  }
  return manifest;
}

void AddPart(TaskManifest part, TaskManifest& all) {
  all.header = std::move(part.header);
  if (part.facts) all.facts = std::move(part.facts);
  for (auto& [key, record] : part.records) all.records.insert_or_assign(key, std::move(record));
}

TaskManifest ReadTaskManifests(std::span<const path> files, const IsReadable& is_readable) {
  TaskManifest all;
  for (const path& file : files) {
    TaskManifest manifest = ReadTaskManifest(file, is_readable);
    if (!all.header.empty() && manifest.header != all.header) {
      throw InputError(file, fmt::format("is of another run than {} ({})", files.front().string(),
                                         HeaderDifference(all.header, manifest.header)));
    }
    AddPart(std::move(manifest), all);
  }
  return all;
}

void WriteTaskManifest(const path& file, const TaskManifest& manifest) {
  std::multimap<size_t, const std::string*> in_order;
  for (const auto& [key, record] : manifest.records) in_order.emplace(record.place, &record.line);
  std::vector<std::string> lines;
  if (manifest.facts) lines.push_back(*manifest.facts);
  for (const auto& [place, line] : in_order) lines.push_back(*line);
  WriteManifestText(file, manifest.header, lines);
}

void WriteWholeManifest(const path& out, const TaskManifest& manifest) {
  const path whole = ManifestPath(out, {});
  WriteTaskManifest(whole, manifest);
  for (const path& part : ListManifests(out)) {
    std::error_code ignored;
    if (part != whole) std::filesystem::remove(part, ignored);
  }
}

std::string HeaderDifference(const std::string& there, const std::string& here) {
  const Json a = Json::parse(there, nullptr, /*allow_exceptions=*/false);
  const Json b = Json::parse(here, nullptr, /*allow_exceptions=*/false);
  if (!a.is_object() || !b.is_object()) return "it is no manifest";
  const Json values_there = a.flatten();
  const Json values_here = b.flatten();
  const auto text = [](const Json& values, const std::string& name) -> std::string {
    return values.contains(name) ? JsonText(values.at(name)) : "nothing";
  };
  for (const Json& values : {values_there, values_here}) {
    for (const auto& [name, value] : values.items()) {
      if (text(values_there, name) == text(values_here, name)) continue;
      return fmt::format("{}: {} there, {} here", name.substr(1), text(values_there, name),
                         text(values_here, name));
    }
  }
  return "the order of its fields differs";
}

}  // namespace raylift
