#include "raylift/views/manifest.h"

#include <algorithm>
#include <cerrno>
#include <cstring>

#include <fcntl.h>
#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <unistd.h>

#include "raylift/base/file.h"
#include "raylift/base/json_text.h"
#include "raylift/base/output_error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

using Json = nlohmann::ordered_json;
using std::filesystem::path;

ManifestEntry FromJson(const Json& json) {
  ManifestEntry entry;
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
    entry.files.push_back({file.at("path"), file.at("bytes")});
  }
  return entry;
}

[[noreturn]] void FailToWrite(const path& file) {
  throw OutputError(file, fmt::format("cannot be written: {}", std::strerror(errno)));
}

}  // namespace

std::string ToJsonLine(const ManifestEntry& entry) {
  Json json = {{"name", entry.name},      {"key", entry.key},   {"camera", entry.camera},
               {"pixels", entry.pixels},  {"hits", entry.hits}, {"depth_range", nullptr},
               {"dropped", entry.dropped}};
  if (entry.depth_range) {
    json["depth_range"] = {entry.depth_range->first, entry.depth_range->second};
  }
  Json files = Json::array();
  for (const ManifestEntry::File& file : entry.files) {
    files.push_back({{"path", file.path}, {"bytes", file.bytes}});
  }
  json["files"] = std::move(files);
  return JsonText(json);
}

ManifestEntries ReadManifest(const path& file) {
  ManifestEntries entries;
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(file, ignored)) return entries;
  LineReader lines(file);
  while (const auto line = lines.NextContent()) {
    try {
      ManifestEntry entry = FromJson(Json::parse(*line));
      entries.insert_or_assign(entry.name, std::move(entry));
    } catch (const nlohmann::json::exception&) {
      continue;  // the header, or a line that a crash cut off
    }
  }
  return entries;
}

std::string ReadManifestHeader(const path& file) {
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(file, ignored)) return {};
  LineReader lines(file);
  return std::string(lines.NextContent().value_or(""));
}

void WriteManifest(const path& file, const std::string& header, const ManifestEntries& entries) {
  std::string text = header + '\n';
  for (const auto& [name, entry] : entries) {
    text += ToJsonLine(entry);
    text += '\n';
  }
  WriteFile(file, text);
}

ManifestAppender::ManifestAppender(path file)
    : path_(std::move(file)), descriptor_(open(path_.c_str(), O_WRONLY | O_APPEND | O_CLOEXEC)) {
  if (descriptor_ < 0) FailToWrite(path_);
}

ManifestAppender::~ManifestAppender() { close(descriptor_); }

void ManifestAppender::Append(const ManifestEntry& entry) {
  const std::string line = ToJsonLine(entry) + '\n';
  const std::lock_guard<std::mutex> lock(mutex_);
  size_t written = 0;
  while (written < line.size()) {
    const ssize_t count = write(descriptor_, line.data() + written, line.size() - written);
    if (count < 0 && errno != EINTR) FailToWrite(path_);
    written += static_cast<size_t>(std::max<ssize_t>(count, 0));
  }
}

}  // namespace raylift
