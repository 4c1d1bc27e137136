#include "jobs/manifest_file.h"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <limits>
#include <system_error>
#include <thread>
#include <utility>

#include "base/json_text.h"
#include "jobs/file_promises.h"
#include <fcntl.h>
#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/parallel.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

using std::filesystem::path;

constexpr std::string_view kStem = "manifest";
constexpr std::string_view kExtension = ".jsonl";

constexpr int kTries = 5;
constexpr std::chrono::milliseconds kBetweenTries{20};
constexpr std::chrono::milliseconds kBetweenLookups{100};  // at a folder that another run holds

[[noreturn]] void FailToWrite(const path& file) {
  throw OutputError(file, fmt::format("cannot be written: {}", std::strerror(errno)));
}

[[noreturn]] void FailAsOtherRun(const path& file) {
  throw InputError(file, "another run is writing to this file");
}

// Returns the text of a file; it is empty where there is none, or where another shard, the last one
// to end, is just removing it.
std::string TextIfThere(const path& file) {
  try {
    if (IsFile(file)) return ReadFile(file);
  } catch (const InputError&) {
    if (Exists(file)) throw;
  }
  return {};
}

using Json = nlohmann::ordered_json;

// The member of a shard's line with the vector instructions of its machine.
constexpr const char* kInstructions = "instructions";
constexpr std::string_view kBeginOfInstructions = R"({"instructions":)";

bool TakeInstructions(const std::string& line, TaskManifest& manifest) {
  if (!line.starts_with(kBeginOfInstructions)) return false;
  const Json json = Json::parse(line, nullptr, /*allow_exceptions=*/false);
  if (!json.is_object() || !json.at(kInstructions).is_string()) return false;
  manifest.instructions.insert(json.at(kInstructions).get<std::string>());
  return true;
}

void TakeLine(const std::string& line, TaskManifest& manifest) {
  const Json json = Json::parse(line, nullptr, /*allow_exceptions=*/false);
  if (!json.is_object()) return;
  if (!json.contains("name")) {
    const bool is_of_results = json.size() == 1 && json.contains("files");
    if (!is_of_results) manifest.facts = line;
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

path ManifestPath(const path& out, const Shard& shard) {
  if (shard.IsAll()) return out / fmt::format("{}{}", kStem, kExtension);
  return out / fmt::format("{}.{}-of-{}{}", kStem, shard.index, shard.count, kExtension);
}

std::optional<Shard> ShardOfManifest(const path& manifest) {
  const std::string name = manifest.filename().string();
  if (name == ManifestPath({}, {}).string()) return Shard{};
  const size_t begin = kStem.size() + 1;
  const size_t middle = name.find("-of-");
  if (middle == std::string::npos || middle < begin) return std::nullopt;
  const std::string count_text = path(name.substr(middle + 4)).stem().string();
  const auto index = ParseInt(name.substr(begin, middle - begin));
  const auto count = ParseInt(count_text);
  const bool in_range =
      index && count && *index >= 0 && *index < *count && *count <= std::numeric_limits<int>::max();
  if (!in_range) return std::nullopt;
  const Shard shard{static_cast<int>(*index), static_cast<int>(*count)};
  return name == ManifestPath({}, shard).string() ? std::optional(shard) : std::nullopt;
}

std::vector<path> ListManifests(const path& out) {
  std::vector<path> manifests;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(out, error)) {
    if (ShardOfManifest(entry.path())) manifests.push_back(entry.path());
  }
  std::sort(manifests.begin(), manifests.end());
  return manifests;
}

bool IsManifestOfOtherShard(const path& manifest, const Shard& shard) {
  const auto of = ShardOfManifest(manifest);
  return of && !shard.IsAll() && of->count == shard.count && of->index != shard.index;
}

size_t ManifestText::CountTasks() const {
  return static_cast<size_t>(std::count_if(lines.begin(), lines.end(), [](const std::string& line) {
    return line.starts_with(R"({"name":)");
  }));
}

ManifestText ReadManifestText(const path& manifest) {
  ManifestText read;
  const std::string text = TextIfThere(manifest);
  size_t begin = 0;
  for (size_t end = text.find('\n'); end != std::string::npos; end = text.find('\n', begin)) {
    std::string line = text.substr(begin, end - begin);
    if (begin == 0) {
      read.header = std::move(line);
    } else {
      read.lines.push_back(std::move(line));
    }
    begin = end + 1;
  }
  return read;
}

void WriteManifestText(const path& manifest, const std::string& header,
                       std::span<const std::string> lines) {
  std::string text = header + '\n';
  for (const std::string& line : lines) {
    text += line;
    text += '\n';
  }
  WriteFile(manifest, text);
}

bool IsBeingAppended(const path& manifest) {
  const int descriptor = open(manifest.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor < 0) return false;
  const bool held = flock(descriptor, LOCK_SH | LOCK_NB) != 0 && errno == EWOULDBLOCK;
  close(descriptor);
  return held;
}

void RefuseIfAppended(const path& manifest) {
  if (IsBeingAppended(manifest)) FailAsOtherRun(manifest);
}

ManifestAppender::ManifestAppender(path manifest)
    : path_(std::move(manifest)),
      descriptor_(open(path_.c_str(), O_WRONLY | O_APPEND | O_CLOEXEC)) {
  if (descriptor_ < 0) FailToWrite(path_);
  // IsBeingAppended() locks for a moment, too.
  for (int tries = 1; flock(descriptor_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK; ++tries) {
    if (tries == kTries) {
      close(descriptor_);
      FailAsOtherRun(path_);
    }
    std::this_thread::sleep_for(kBetweenTries);
  }
  try {
    writer_ = std::thread([this] { WriteLines(); });
  } catch (const std::system_error& error) {
    close(descriptor_);
    throw ResourceError(fmt::format("a thread cannot be started: {}", error.what()));
  }
}

ManifestAppender::~ManifestAppender() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    ends_ = true;
  }
  changed_.notify_all();
  writer_.join();
  close(descriptor_);
}

void ManifestAppender::Append(std::string line) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (failure_) std::rethrow_exception(failure_);
  waiting_.push_back(std::move(line));
  changed_.notify_all();
}

void ManifestAppender::Flush() {
  std::unique_lock<std::mutex> lock(mutex_);
  changed_.wait(lock, [this] { return failure_ || (waiting_.empty() && !writing_); });
  if (failure_) std::rethrow_exception(failure_);
}

void ManifestAppender::WriteLines() {
  std::unique_lock<std::mutex> lock(mutex_);
  while (!failure_) {
    changed_.wait(lock, [this] { return ends_ || !waiting_.empty(); });
    if (waiting_.empty()) return;
    const std::vector<std::string> lines = std::exchange(waiting_, {});
    writing_ = true;
    lock.unlock();
    std::exception_ptr failure;
    try {
      Write(lines);
    } catch (...) {
      failure = std::current_exception();
    }
    lock.lock();
    writing_ = false;
    failure_ = failure;
    changed_.notify_all();
  }
}

void ManifestAppender::Write(std::span<const std::string> lines) const {
  std::vector<path> files;
  std::string text;
  for (const std::string& line : lines) {
    for (const PromisedFile& file : FilesOfLine(line)) {
      files.push_back(path_.parent_path() / file.path);
    }
    text += line + '\n';
  }
  SyncFiles(files);
  for (size_t written = 0; written < text.size();) {
    const ssize_t count = write(descriptor_, text.data() + written, text.size() - written);
    if (count < 0 && errno != EINTR) FailToWrite(path_);
    written += static_cast<size_t>(std::max<ssize_t>(count, 0));
  }
  if (fdatasync(descriptor_) != 0 && !CannotSyncHere(errno)) FailToWrite(path_);
}

void ManifestAppender::RequireInPlace() const {
  struct stat open_file {
  }, there{};
  if (fstat(descriptor_, &open_file) == 0 && stat(path_.c_str(), &there) == 0 &&
      open_file.st_ino == there.st_ino && open_file.st_dev == there.st_dev) {
    return;
  }
  throw OutputError(path_, "has been removed while the run was at work: what it holds is lost");
}

FolderLock::FolderLock(const std::filesystem::path& folder, Mode mode, IfHeld if_held)
    : descriptor_(open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)) {
  if (descriptor_ < 0) return;
  const int operation = mode == Mode::kExclusive ? LOCK_EX : LOCK_SH;
  try {
    while (flock(descriptor_, operation | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
      if (if_held == IfHeld::kFail) {
        throw InputError(folder, "another run is writing to this folder");
      }
      if (CallWatch* const watch = CallWatch::Current()) watch->Check();
      std::this_thread::sleep_for(kBetweenLookups);
    }
  } catch (...) {
    close(descriptor_);
    throw;
  }
}

FolderLock::~FolderLock() {
  if (descriptor_ >= 0) close(descriptor_);
}

TaskManifest ReadTaskManifest(const path& file, const IsReadable& is_readable) {
  TaskManifest manifest;
  const ManifestText text = ReadManifestText(file);
  manifest.header = text.header;
  for (const std::string& line : text.lines) {
    if (TakeInstructions(line, manifest)) continue;
    if (is_readable(line)) TakeLine(line, manifest);
  }
  return manifest;
}

void AddPart(TaskManifest part, TaskManifest& all) {
  all.header = std::move(part.header);
  if (part.facts) all.facts = std::move(part.facts);
  for (auto& [key, record] : part.records) all.records.insert_or_assign(key, std::move(record));
  all.instructions.merge(part.instructions);
}

TaskManifest ReadTaskManifests(std::span<const path> files, const IsReadable& is_readable,
                               const path& out) {
  TaskManifest all;
  for (const path& file : files) {
    TaskManifest manifest = ReadTaskManifest(file, is_readable);
    if (!all.header.empty() && manifest.header != all.header) {
      throw InputError(file, fmt::format("is of another run than {} ({})", files.front().string(),
                                         HeaderDifference(all.header, manifest.header)));
    }
    for (auto& [key, record] : manifest.records) {
      record.line = InFolder(record.line, file.parent_path(), out);
    }
    AddPart(std::move(manifest), all);
  }
  return all;
}

std::vector<std::string> MachineWarnings(const TaskManifest& manifest) {
  if (manifest.instructions.size() < 2) return {};
  return {fmt::format(
      "the shards ran on machines whose vector instructions differ ({}): their last digits may not "
      "be those of one run",
      fmt::join(manifest.instructions, ", "))};
}

void WriteTaskManifest(const path& file, const TaskManifest& manifest) {
  std::multimap<size_t, const std::string*> in_order;
  for (const auto& [key, record] : manifest.records) in_order.emplace(record.place, &record.line);
  std::vector<std::string> lines;
  const std::optional<Shard> shard = ShardOfManifest(file);
  if (shard && !shard->IsAll()) {  // whose whole does not show who has done what
    for (const std::string& instructions : manifest.instructions) {
      lines.push_back(JsonText(Json{{kInstructions, instructions}}));
    }
  }
  if (manifest.facts) lines.push_back(*manifest.facts);
  for (const auto& [place, line] : in_order) lines.push_back(*line);
  if (!manifest.results.empty()) {
    lines.push_back(JsonText(Json{{"files", FilesJson(manifest.results)}}));
  }
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
