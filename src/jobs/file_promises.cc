#include "jobs/file_promises.h"

#include <algorithm>

#include "base/hash.h"
#include "base/input_paths.h"
#include "jobs/manifest_file.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"

namespace raylift {
namespace {

using std::filesystem::path;
using Json = nlohmann::ordered_json;

// Returns whether a file belongs to one run: it holds where the run was made and on how many
// threads.
bool IsOfOneRun(const path& file) { return file.filename() == "options.json"; }

// Links may stand for folders on the way from one that is beside the other.
path Relative(const path& file, const path& folder) {
  if (const auto below = Below(file, folder)) return *below;
  std::error_code ignored;
  return weakly_canonical(file, ignored).lexically_relative(weakly_canonical(folder, ignored));
}

// Returns a file's name as JSON; a name that is not UTF-8, as JSON must be, is a list of its bytes.
Json PathJson(const std::string& name) {
  Json text = Json::parse(JsonText(Json(name)));
  return text == name ? text : Json(std::vector<uint8_t>(name.begin(), name.end()));
}

std::string PathFromJson(const Json& json) {
  if (json.is_string()) return json;
  const auto bytes = json.get<std::vector<uint8_t>>();
  return {bytes.begin(), bytes.end()};
}

PromisedFile Promise(const path& folder, const path& file) {
  PromisedFile promised{.path = Relative(file, folder).string()};
  std::error_code error;
  const auto size = file_size(file, error);
  const auto hash = FileHash(file);
  if (error || !hash) throw OutputError(file, "is gone after it was written");
  if (!IsOfOneRun(file)) {
    promised.bytes = size;
    promised.xxh3 = *hash;
  }
  return promised;
}

}  // namespace

std::vector<PromisedFile> PromiseFiles(const path& folder, std::span<const path> files) {
  std::vector<PromisedFile> promised;
  promised.reserve(files.size());
  for (const path& file : files) {
    // A run that finds all done writes no times.
    if (file.filename() != "timing.jsonl") promised.push_back(Promise(folder, file));
  }
  return promised;
}

void Members(JsonMembers& members, PromisedFile& file) {
  Json name = PathJson(file.path);
  members("path", name);
  if (members.reads()) file.path = PathFromJson(name);
  members.If(!file.xxh3.empty(), "bytes", file.bytes);
  members.If(!file.xxh3.empty(), "xxh3", file.xxh3);
}

Json FilesJson(std::span<const PromisedFile> files) {
  return ToJson(std::vector<PromisedFile>(files.begin(), files.end()));
}

std::vector<PromisedFile> FilesOfLine(const std::string& line) {
  // Most lines promise none, and are long.
  if (line.find(R"("files":[{)") == std::string::npos) return {};
  try {
    return FromJson<std::vector<PromisedFile>>(Json::parse(line).value("files", Json::array()));
  } catch (const Json::exception&) {
    return {};
  } catch (const InputError&) {
    return {};
  }
}

std::string InFolder(const std::string& line, const path& from, const path& to) {
  std::vector<PromisedFile> files = FilesOfLine(line);
  if (files.empty()) return line;
  for (PromisedFile& file : files) file.path = Relative(from / file.path, to).string();
  Json json = Json::parse(line);
  json["files"] = FilesJson(files);
  return JsonText(json);
}

std::optional<std::string> FaultOf(const path& folder, const PromisedFile& file, FileCheck check) {
  std::error_code error;
  const auto size = file_size(folder / file.path, error);
  if (error) return "is missing";
  if (file.xxh3.empty()) return std::nullopt;
  if (size != file.bytes) return fmt::format("has {} bytes, not {}", size, file.bytes);
  if (check == FileCheck::kSizes) return std::nullopt;
  const auto hash = FileHash(folder / file.path);
  if (!hash) return "cannot be read";
  if (*hash != file.xxh3) return "has other contents";
  return std::nullopt;
}

bool KeepsPromise(const path& folder, const std::string& line, FileCheck check) {
  const std::vector<PromisedFile> files = FilesOfLine(line);
  return std::none_of(files.begin(), files.end(), [&](const PromisedFile& file) {
    return FaultOf(folder, file, check).has_value();
  });
}

Verification VerifyFiles(const path& out, int threads) {
  Verification verification;
  std::vector<PromisedFile> files;
  for (const path& manifest : ListManifests(out)) {
    const ManifestText text = ReadManifestText(manifest);
    verification.tasks += text.CountTasks();
    for (const std::string& line : text.lines) {
      for (PromisedFile& file : FilesOfLine(line)) files.push_back(std::move(file));
    }
  }
  verification.files = files.size();
  std::vector<std::optional<std::string>> faults(files.size());
  ParallelFor(files.size(), threads,
              [&](size_t i) { faults[i] = FaultOf(out, files[i], FileCheck::kContents); });
  for (size_t i = 0; i < files.size(); ++i) {
    verification.bytes += files[i].bytes;
    if (faults[i]) verification.faults.push_back({files[i].path, *faults[i]});
  }
  return verification;
}

}  // namespace raylift
