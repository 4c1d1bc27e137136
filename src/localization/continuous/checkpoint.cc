#include "localization/continuous/checkpoint.h"

#include <string_view>
#include <system_error>
#include <utility>

#include "geometry/pose_json.h"
#include "localization/results/result_json.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/io/query_list.h"

namespace raylift {
namespace {

constexpr const char* kFormat = "raylift-continuous/2";
constexpr std::string_view kRunFile = "run.json";

struct RunKey {
  std::string key;
};

std::string AsUtf8(const std::string& text) {
  using Json = nlohmann::json;
  return Json::parse(JsonText(Json(text))).get<std::string>();
}

// Records are numbered; nothing else in the folder is ours.
bool IsRecord(const std::filesystem::path& file) {
  return file.extension() == ".json" && ParseUint(file.stem().string()).has_value();
}

void RemoveRecords(const std::filesystem::path& folder) {
  std::error_code error;
  std::vector<std::filesystem::path> records;
  for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
    if (IsRecord(entry.path())) records.push_back(entry.path());
  }
  for (const auto& record : records) std::filesystem::remove(record, error);
}

}  // namespace

static void Members(JsonMembers& members, RunKey& run) {
  members.Format(kFormat);
  members("key", run.key);
}

static void Members(JsonMembers& members, PointLink& link) {
  members.Row(link.pixel.x(), link.pixel.y(), link.point_in_world.x(), link.point_in_world.y(),
              link.point_in_world.z());
}

static void Members(JsonMembers& members, JoinedReference& joined) {
  std::string camera = joined.image.camera.ToString();
  members("camera", camera);
  joined.image.camera = ParseCamera("camera", camera);
  members("cam_from_world", joined.image.cam_from_world);
  members("covariance", joined.covariance);
  members("distance", joined.distance);
  members("links", joined.links);
}

static void Members(JsonMembers& members, ContinuousRecord& record) {
  members.Format(kFormat);
  MembersOfDiagnostics(members, record.diagnostics, record.localized);
  members("milliseconds", record.localized.times);
  members("joined", record.joined);
}

// What a file of the folder holds.
template <typename Record>
static Record ReadRecord(const std::filesystem::path& file) {
  const std::string text = ReadFile(file);
  try {
    return ParseJson<Record>(text);
  } catch (const InputError& error) {
    throw InputError(file, fmt::format("no checkpoint of a continuous run: {}", error.what()));
  }
}

ContinuousCheckpoint::ContinuousCheckpoint(std::filesystem::path folder, const std::string& key,
                                           bool resume)
    : folder_(std::move(folder)) {
  const std::filesystem::path run_file = folder_ / kRunFile;
  std::error_code error;
  if (resume && std::filesystem::exists(run_file, error)) {
    if (ReadRecord<RunKey>(run_file).key != key) {
      throw InputError(run_file,
                       "the run that is to go on had other options, queries or references; a run "
                       "that does not resume starts anew");
    }
    return;
  }
  // In this order: killed in between, old records are never taken for those of the new run.
  std::filesystem::remove(run_file, error);
  RemoveRecords(folder_);
  WriteFile(run_file, JsonText(ToJson(RunKey{key})) + '\n');
}

std::filesystem::path ContinuousCheckpoint::FileOf(size_t place) const {
  return folder_ / fmt::format("{:06}.json", place);
}

std::optional<ContinuousRecord> ContinuousCheckpoint::Read(size_t place, const Query& query) const {
  const std::filesystem::path file = FileOf(place);
  std::error_code error;
  if (!std::filesystem::exists(file, error)) return std::nullopt;
  auto record = ReadRecord<ContinuousRecord>(file);
  std::string& name = record.localized.name;
  if (name != AsUtf8(query.name)) {
    throw InputError(
        file, fmt::format("expected the query \"{}\", found \"{}\"", AsUtf8(query.name), name));
  }
  name = query.name;
  if (record.joined) record.joined->image.name = query.name;
  return record;
}

void ContinuousCheckpoint::Write(size_t place, const ContinuousRecord& record) const {
  WriteFile(FileOf(place), JsonText(ToJson(record)) + '\n');
}

}  // namespace raylift
