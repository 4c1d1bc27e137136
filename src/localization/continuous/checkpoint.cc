#include "localization/continuous/checkpoint.h"

#include <string_view>
#include <system_error>
#include <utility>

#include "base/json_text.h"
#include "geometry/pose_json.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/geometry/camera_models.h"
#include "raylift/localization/result_files.h"

namespace raylift {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::string_view kFormat = "raylift-continuous/1";
constexpr std::string_view kRunFile = "run.json";

std::string AsUtf8(const std::string& text) {
  return Json::parse(JsonText(Json(text))).get<std::string>();
}

template <typename Matrix>
Json NumbersOf(const Matrix& matrix) {
  return std::vector<double>(matrix.data(), matrix.data() + matrix.size());
}

template <typename Matrix>
Matrix MatrixOf(const Json& numbers) {
  Matrix matrix;
  for (Eigen::Index i = 0; i < matrix.size(); ++i) {
    matrix.data()[i] = numbers.at(static_cast<size_t>(i)).get<double>();
  }
  return matrix;
}

Json CameraJson(const Camera& camera) {
  return {{"model", GetCameraModelInfo(camera.model()).name},
          {"width", camera.width_px()},
          {"height", camera.height_px()},
          {"params", std::vector<double>(camera.params().begin(), camera.params().end())}};
}

Camera CameraOf(const Json& json) {
  const auto model = CameraModelFromName(json.at("model").get<std::string>());
  if (!model) throw InputError("unknown camera model");
  return Camera(*model, json.at("width").get<int>(), json.at("height").get<int>(),
                json.at("params").get<std::vector<double>>());
}

Json JoinedJson(const std::optional<JoinedReference>& joined) {
  if (!joined) return nullptr;
  Json links = Json::array();
  for (const PointLink& link : joined->links) {
    Eigen::Matrix<double, 5, 1> row;
    row << link.pixel, link.point_in_world;
    links.push_back(NumbersOf(row));
  }
  return {{"camera", CameraJson(joined->image.camera)},
          {"cam_from_world", PoseJson<Json>(joined->image.cam_from_world)},
          {"covariance", joined->covariance ? NumbersOf(*joined->covariance) : Json(nullptr)},
          {"distance", joined->distance},
          {"links", std::move(links)}};
}

std::optional<JoinedReference> JoinedOf(const Json& json, const std::string& name) {
  if (json.is_null()) return std::nullopt;
  JoinedReference joined;
  joined.image = {name, CameraOf(json.at("camera")), PoseFromJson(json.at("cam_from_world"))};
  if (!json.at("covariance").is_null()) {
    joined.covariance = MatrixOf<PoseCovariance>(json.at("covariance"));
  }
  joined.distance = json.at("distance").get<double>();
  for (const Json& link : json.at("links")) {
    const auto row = MatrixOf<Eigen::Matrix<double, 5, 1>>(link);
    joined.links.push_back({row.head<2>(), row.tail<3>()});
  }
  return joined;
}

Json ParseFile(const std::filesystem::path& file) {
  try {
    Json json = Json::parse(ReadFile(file));
    if (json.at("format").get<std::string>() != kFormat) {
      throw InputError(file, fmt::format("expected the format \"{}\"", kFormat));
    }
    return json;
  } catch (const nlohmann::json::exception& error) {
    throw InputError(file, fmt::format("no checkpoint of a continuous run: {}", error.what()));
  }
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

ContinuousCheckpoint::ContinuousCheckpoint(std::filesystem::path folder, const std::string& key,
                                           bool resume)
    : folder_(std::move(folder)) {
  const std::filesystem::path run_file = folder_ / kRunFile;
  std::error_code error;
  if (resume && std::filesystem::exists(run_file, error)) {
    const Json run = ParseFile(run_file);
    if (!run.contains("key") || run["key"] != key) {
      throw InputError(run_file,
                       "the run that is to go on had other options, queries or references; a run "
                       "that does not resume starts anew");
    }
    return;
  }
  // In this order: killed in between, old records are never taken for those of the new run.
  std::filesystem::remove(run_file, error);
  RemoveRecords(folder_);
  WriteFile(run_file, JsonText(Json({{"format", kFormat}, {"key", key}})) + '\n');
}

std::filesystem::path ContinuousCheckpoint::FileOf(size_t place) const {
  return folder_ / fmt::format("{:06}.json", place);
}

std::optional<ContinuousRecord> ContinuousCheckpoint::Read(size_t place, const Query& query) const {
  const std::filesystem::path file = FileOf(place);
  std::error_code error;
  if (!std::filesystem::exists(file, error)) return std::nullopt;
  const Json json = ParseFile(file);
  try {
    const Json& diagnostics = json.at("diagnostics");
    const auto name = diagnostics.at("name").get<std::string>();
    if (name != AsUtf8(query.name)) {
      throw InputError(
          fmt::format("expected the query \"{}\", found \"{}\"", AsUtf8(query.name), name));
    }
    ContinuousRecord record{ParseQueryDiagnostics(JsonText(diagnostics), query.name),
                            JsonText(diagnostics), JoinedOf(json.at("joined"), query.name)};
    record.localized.times = TimesFromJson(json.at("milliseconds"));
    return record;
  } catch (const nlohmann::json::exception& e) {
    throw InputError(file, e.what());
  } catch (const InputError& e) {
    throw InputError(file, e.what());
  }
}

void ContinuousCheckpoint::Write(size_t place, const ContinuousRecord& record) const {
  const Json json = {{"format", kFormat},
                     {"diagnostics", Json::parse(record.diagnostics)},
                     {"milliseconds", TimesJson(record.localized.times)},
                     {"joined", JoinedJson(record.joined)}};
  WriteFile(FileOf(place), JsonText(json) + '\n');
}

}  // namespace raylift
