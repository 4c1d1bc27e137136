#include <algorithm>
#include <chrono>
#include <set>
#include <tuple>

#include "base/hash.h"
#include "base/input_paths.h"
#include "base/json_members.h"
#include "evaluation/fields.h"
#include "geometry/pose_json.h"
#include "lifting/fields.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/experiment/run_cells.h"
#include "raylift/io/pose_priors.h"
#include "raylift/io/query_list.h"
#include "raylift/io/scene_file.h"

namespace raylift {
namespace {

using Json = nlohmann::ordered_json;
using std::filesystem::path;

// The version of the cells' format and of what fills them: a change of either makes all cells anew.
constexpr int kCellVersion = 3;
// A cell's queries are in memory with all their matches, and those that noise is learned from.
constexpr size_t kQueriesPerCell = 256;
// Larger inputs are identified by sizes and times.
constexpr uintmax_t kMaxHashedBytes = uintmax_t{64} << 20;

struct FoundFile {
  std::string name;  // relative to the input
  path file;
  uintmax_t bytes;
};

std::vector<FoundFile> FilesOf(const path& input) {
  namespace fs = std::filesystem;
  std::error_code error;
  if (fs::is_regular_file(input, error)) return {{"", input, fs::file_size(input)}};
  if (!fs::is_directory(input, error)) throw InputError(input, "does not exist");
  std::vector<FoundFile> files;
  for (const path& file : ListFilesBelow(input)) {
    files.push_back({file.lexically_relative(input).string(), file, fs::file_size(file)});
  }
  std::sort(files.begin(), files.end(),
            [](const FoundFile& a, const FoundFile& b) { return a.name < b.name; });
  return files;
}

std::string DescribeInput(const path& input) {
  const std::vector<FoundFile> files = FilesOf(input);
  uintmax_t bytes = 0;
  for (const FoundFile& file : files) bytes += file.bytes;
  std::string all;
  for (const FoundFile& file : files) {
    all += fmt::format("{} {} ", file.name, file.bytes);
    if (bytes <= kMaxHashedBytes) {
      all += HexText(HashBytes64(ReadFile(file.file)));
    } else {
      const auto time = std::filesystem::last_write_time(file.file).time_since_epoch();
      all += std::to_string(std::chrono::duration_cast<std::chrono::nanoseconds>(time).count());
    }
    all += '\n';
  }
  return fmt::format("{} files, {} bytes, {}", files.size(), bytes, HexText(HashBytes64(all)));
}

std::string Replaced(std::string text, const std::string& from, const std::string& to) {
  for (size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size()) {
    text.replace(at, from.size(), to);
  }
  return text;
}

// Takes "kind:PLACE[,key=value...]".
std::string PlaceOfSpec(const std::string& spec) {
  const size_t colon = spec.find(':');
  const size_t comma = spec.find(',');
  if (colon == std::string::npos || colon > comma) return {};
  return spec.substr(colon + 1, comma == std::string::npos ? comma : comma - colon - 1);
}

// Returns the files or folders of a specification of geometry; empty where it names none ("sfm").
std::vector<path> PathsOfSpec(const std::string& spec) {
  const std::string place = PlaceOfSpec(spec);
  std::vector<path> paths;
  if (place.empty()) return paths;
  if (Exists(place)) return {place};
  for (const std::string_view part : SplitBy(place, '+')) {
    path file(part);
    if (part.find('*') != std::string_view::npos) file = file.parent_path();
    paths.push_back(file.empty() ? path(".") : file);
  }
  return paths;
}

// Collects the inputs of cells; what many cells share is looked at once.
class InputCollector {
 public:
  explicit InputCollector(const Experiment& experiment) : experiment_(experiment) {}

  std::string Describe(const Cell& cell) {
    const Setting& setting = cell.setting;
    Json inputs = {{"version", kCellVersion},
                   {"raylift_version", RAYLIFT_VERSION},
                   {"scene", SceneJson(setting)},
                   {"every", TextOf(setting[Axis::kEvery])},
                   {"offset", cell.offset}};
    if (Matters(setting[Axis::kGeometry])) {
      inputs["geometry"] = GeometryJson(setting);
      inputs["align"] = TextOf(setting[Axis::kAlign]);
      inputs["filter"] = FilterJson(setting);
    }
    inputs["method"] = MethodJson(setting);
    inputs["seed"] = cell.seed;
    inputs["queries"] = {cell.begin, cell.end};
    return JsonText(inputs);
  }

 private:
  Json SceneJson(const Setting& setting) {
    const ExperimentScene& scene = experiment_.SceneOf(setting);
    const size_t every = setting.Every();
    Json json = {{"model", identity_.Of(scene.model)},
                 {"model_poses", ToString(scene.model_poses)},
                 {"queries", identity_.Of(scene.queries)},
                 {"top_k", scene.top_k}};
    if (scene.continuous) {
      json["continuous"] = scene.times.empty() ? "by name" : identity_.Of(scene.times);
    }
    if (!scene.group.empty()) json["group"] = {identity_.Of(scene.groups), scene.group};
    if (!scene.priors.empty()) json["priors"] = identity_.Of(scene.priors);
    if (scene.features.empty()) {
      json["images"] = identity_.Of(scene.images);
      json["query_images"] = identity_.Of(scene.query_images);
      json["max_features"] = scene.max_features;
    } else {
      json["features"] = identity_.Of(ForSubsampling(scene.features, every));
      json["matches"] = identity_.Of(ForSubsampling(scene.matches, every));
      json["pairs"] = identity_.Of(ForSubsampling(scene.pairs, every));
    }
    return json;
  }

  Json GeometryJson(const Setting& setting) {
    const ExperimentScene& scene = experiment_.SceneOf(setting);
    const ExperimentGeometry& geometry = *experiment_.GeometryOf(setting);
    Json json = Json::object();
    for (const std::string& spec : geometry.specs) {
      Json source = SourceJson(scene, ForSubsampling(spec, setting.Every()).string());
      if (json.empty()) {
        json = std::move(source);
      } else {
        AppendTo(json, "then", std::move(source));
      }
    }
    if (geometry.specs.size() > 1) json["mode"] = ToString(geometry.mode);
    if (geometry.candidates.mode != CandidateMode::kKeep) {
      json["candidates"] = {ToString(geometry.candidates.mode), geometry.candidates.max_error_px,
                            geometry.candidates.min_angle_deg};
    }
    if (geometry.perturbation)
      json["perturbation"] = FieldsJson(ConstFieldsOf(*geometry.perturbation));
    return json;
  }

  Json SourceJson(const ExperimentScene& scene, const std::string& spec) {
    // The path itself may change where the data were moved.
    const std::string place = PlaceOfSpec(spec);
    Json json = {{"spec", place.empty() ? spec : Replaced(spec, place, "")}};
    std::vector<path> inputs = PathsOfSpec(spec);
    if (inputs.empty()) inputs.push_back(scene.model);
    for (const path& input : inputs) AppendTo(json, "data", identity_.Of(input));
    return json;
  }

  Json FilterJson(const Setting& setting) const {
    const NamedFilter& filter = experiment_.FilterOf(setting);
    Json json = {{"mode", ToString(filter.mode)}};
    if (filter.mode == FilterMode::kFixed) {
      json.update(FieldsJson(ConstFieldsOf(filter.thresholds), "filter_"));
    }
    return json;
  }

  Json MethodJson(const Setting& setting) const {
    const EstimatorOptions& options = experiment_.estimator;
    return {{"name", TextOf(setting[Axis::kMethod])},
            {"score", TextOf(setting[Axis::kScore])},
            {"lo", TextOf(setting[Axis::kLo])},
            {"alpha", TextOf(setting[Axis::kAlpha])},
            {"reprojection_threshold_px", options.reprojection_threshold_px},
            {"sampson_threshold_px", options.sampson_threshold_px},
            {"min_iterations", options.min_iterations},
            {"max_iterations", options.max_iterations},
            {"confidence", options.confidence},
            {"refinement", ToString(options.refinement)}};
  }

  const Experiment& experiment_;
  InputIdentity identity_;
};

// Sorts in the order of the work: cells that open the same inputs stand together.
void SortByWork(std::vector<Cell>& cells, const Experiment& experiment) {
  const auto scene_index = [&](const Cell& cell) {
    return &experiment.SceneOf(cell.setting) - experiment.scenes.data();
  };
  std::stable_sort(cells.begin(), cells.end(), [&](const Cell& a, const Cell& b) {
    const auto key = [&](const Cell& cell) {
      return std::tuple(scene_index(cell), cell.setting.Every(), cell.offset, cell.begin);
    };
    return key(a) < key(b);
  });
}

// The contents of a cell's file.
struct CellRecord {
  std::string setting;
  Json inputs;
  std::vector<QueryOutcome> outcomes;
};

}  // namespace

static void Members(JsonMembers& members, QueryOutcome& outcome) {
  members("name", outcome.name);
  members("pose", outcome.cam_from_world);
  members("position_observable", outcome.position_observable);
  members("reason", outcome.reason);
  members("inliers_2d3d", outcome.inliers_2d3d);
  members("inliers_2d2d", outcome.inliers_2d2d);
  members("matches_2d3d", outcome.matches_2d3d);
  members("matches_2d2d", outcome.matches_2d2d);
  members("solver", outcome.solver);
}

static void Members(JsonMembers& members, CellRecord& record) {
  members("setting", record.setting);
  members("inputs", record.inputs);
  members("outcomes", record.outcomes);
}

std::string Cell::Key() const { return HexText(HashBytes64(inputs)); }

const std::string& InputIdentity::Of(const path& input) {
  const auto known = known_.find(input);
  if (known != known_.end()) return known->second;
  return known_.emplace(input, DescribeInput(input)).first->second;
}

path ForSubsampling(const path& input, size_t every) {
  return Replaced(input.string(), "{every}", std::to_string(every));
}

std::vector<Query> QueriesOf(const ExperimentScene& scene) {
  std::vector<Query> queries = ReadQueryList(scene.queries, scene.query_images);
  if (!scene.priors.empty()) TakePosePriors(scene.priors, queries);
  if (!scene.group.empty()) {
    const std::map<std::string, std::string> groups = ReadGroups(scene.groups);
    std::erase_if(queries, [&](const Query& query) {
      const auto group = groups.find(query.name);
      return group == groups.end() || group->second != scene.group;
    });
  }
  if (queries.empty()) {
    throw InputError(scene.queries, scene.group.empty()
                                        ? std::string("holds no queries")
                                        : fmt::format("no query is of group {}", scene.group));
  }
  return queries;
}

std::vector<path> MissingInputs(const Experiment& experiment, std::span<const Setting> settings) {
  std::vector<path> missing;
  std::set<path> seen;
  const auto look = [&](const path& input) {
    if (input.empty() || !seen.insert(input).second) return;
    if (!Exists(input)) missing.push_back(input);
  };
  for (const Setting& setting : settings) {
    const ExperimentScene& scene = experiment.SceneOf(setting);
    const size_t every = setting.Every();
    look(scene.file);
    look(scene.model);
    look(scene.queries);
    look(scene.groups);
    look(scene.priors);
    if (scene.continuous) look(scene.times);
    look(scene.ground_truth);
    if (scene.features.empty()) {
      look(scene.images);
      look(scene.query_images);
    }
    for (const path& file : {scene.features, scene.matches, scene.pairs}) {
      look(ForSubsampling(file, every));
    }
    if (const auto* geometry = experiment.GeometryOf(setting)) {
      for (const std::string& spec : geometry->specs) {
        for (const path& file : PathsOfSpec(ForSubsampling(spec, every).string())) look(file);
      }
    }
  }
  return missing;
}

size_t NumOffsets(const Experiment& experiment, const Setting& setting) {
  return experiment.offsets == SubsamplingOffsets::kAll ? setting.Every() : 1;
}

std::vector<Cell> ListCells(const Experiment& experiment, std::span<const Setting> settings) {
  InputCollector collector(experiment);
  std::map<std::string, size_t> num_queries;  // by scene
  std::vector<Cell> cells;
  for (const Setting& setting : settings) {
    const ExperimentScene& scene = experiment.SceneOf(setting);
    auto count = num_queries.find(scene.name);
    if (count == num_queries.end()) {
      count = num_queries.emplace(scene.name, QueriesOf(scene).size()).first;
    }
    const size_t step = scene.continuous ? count->second : kQueriesPerCell;
    for (const uint64_t seed : experiment.seeds) {
      for (size_t offset = 0; offset < NumOffsets(experiment, setting); ++offset) {
        for (size_t begin = 0; begin < count->second; begin += step) {
          Cell cell{setting, seed, offset, begin, std::min(begin + step, count->second), {}};
          cell.inputs = collector.Describe(cell);
          cells.push_back(std::move(cell));
        }
      }
    }
  }
  SortByWork(cells, experiment);
  return cells;
}

bool QueryOutcome::operator==(const QueryOutcome& other) const {
  return ToJson(*this) == ToJson(other);
}

CellStore::CellStore(std::filesystem::path folder) : folder_(std::move(folder)) {}

std::filesystem::path CellStore::FileOf(const Cell& cell) const {
  return folder_ / (cell.Key() + ".json");
}

std::optional<std::vector<QueryOutcome>> CellStore::Read(const Cell& cell) const {
  const auto file = FileOf(cell);
  if (!IsFile(file)) return std::nullopt;
  const std::string text = ReadFile(file);
  try {
    auto record = ParseJson<CellRecord>(text);
    if (record.inputs != Json::parse(cell.inputs)) return std::nullopt;
    if (record.outcomes.size() != cell.end - cell.begin) return std::nullopt;
    return std::move(record.outcomes);
  } catch (const InputError&) {
    return std::nullopt;  // damaged: made again
  }
}

void CellStore::Write(const Cell& cell, std::span<const QueryOutcome> outcomes) const {
  RAYLIFT_CHECK_EQ(outcomes.size(), cell.end - cell.begin);
  const CommittedFiles synced_with_its_line(CommittedFiles::Sync::kByPromise);
  WriteFile(FileOf(cell),
            JsonText(ToJson(CellRecord{.setting = cell.setting.Name(),
                                       .inputs = Json::parse(cell.inputs),
                                       .outcomes = {outcomes.begin(), outcomes.end()}})) +
                '\n');
}

}  // namespace raylift
