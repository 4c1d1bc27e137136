#include <algorithm>
#include <set>
#include <string>
#include <utility>

#include "estimation/fields.h"
#include "evaluation/fields.h"
#include "io/text/toml_file.h"
#include "lifting/fields.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/experiment/experiment.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/io/scene_file.h"
#include "raylift/lifting/depth_alignment.h"

namespace raylift {

static std::vector<Field> FieldsOf(ExperimentScene& scene) {
  return {{"top_k", scene.top_k, "", kAtLeastOne},
          {"max_features", scene.max_features, "", kAtLeastOne},
          {"continuous", scene.continuous, ""},
          {"model_poses", scene.model_poses, ""}};
}

namespace {

using std::filesystem::path;

// Replaces ${NAME} by the value of the variable.
std::string ExpandVariables(const std::string& text, const VariableLookup& variables) {
  std::string expanded;
  size_t position = 0;
  for (size_t begin; (begin = text.find("${", position)) != std::string::npos;) {
    const size_t end = text.find('}', begin);
    if (end == std::string::npos) throw InputError("\"${\" is not closed");
    const std::string name = text.substr(begin + 2, end - begin - 2);
    const auto value = variables(name);
    if (!value) {
      throw InputError(fmt::format("${{{}}} is not set", name));
    }
    expanded += text.substr(position, begin - position) + *value;
    position = end + 1;
  }
  return expanded + text.substr(position);
}

AxisValue ReadAxisValue(const TomlTable& table, const Experiment& experiment, Axis axis,
                        const std::string& text) {
  const auto require = [&](bool good, const std::string& expected) {
    if (!good) {
      table.Fail(ToString(axis), fmt::format("expected {}, found \"{}\"", expected, text));
    }
  };
  const auto named = [&]<NamedEnum Enum>(std::optional<Enum> value) {
    require(value.has_value(), NameList<Enum>());
    return *value;
  };
  switch (axis) {
    case Axis::kScene:
      require(std::any_of(experiment.scenes.begin(), experiment.scenes.end(),
                          [&](const ExperimentScene& scene) { return scene.name == text; }),
              "names of [scenes]");
      return text;
    case Axis::kEvery: {
      const auto number = ParseInt(text);
      require(number && *number >= 1 && *number <= 1'000'000, "numbers of at least 1");
      return static_cast<size_t>(*number);
    }
    case Axis::kGeometry:
      require(std::any_of(experiment.scenes.begin(), experiment.scenes.end(),
                          [&](const ExperimentScene& scene) {
                            return scene.file_is_missing || scene.FindGeometry(text) != nullptr;
                          }),
              "names of a scene's geometry");
      return text;
    case Axis::kAlign:
      return named(FromName<AlignMode>(text));
    case Axis::kFilter:
      require(std::any_of(experiment.filters.begin(), experiment.filters.end(),
                          [&](const NamedFilter& filter) { return filter.name == text; }),
              NameList<FilterMode>() + " or names of [filters]");
      return text;
    case Axis::kMethod: {
      if (text == kOracleName) return Oracle();
      const auto method = FromName<Method>(text);
      require(method.has_value(), fmt::format("{}|{}", NameList<Method>(), kOracleName));
      return *method;
    }
    case Axis::kScore:
      return named(FromName<ScoreCombination>(text));
    case Axis::kLo:
      return named(FromName<LocalOptimization>(text));
    case Axis::kAlpha: {
      const auto number = ParseDouble(text);
      require(number && *number >= 0, "numbers of at least 0");
      return *number;
    }
  }
  RAYLIFT_CHECK(false);
}

std::vector<LayoutAxis> ReadAxes(TomlTable& table, std::string_view key) {
  std::vector<LayoutAxis> axes;
  for (const std::string& name : table.Values(key)) {
    if (const auto axis = FromName<Axis>(name)) {
      axes.emplace_back(*axis);
    } else if (const auto part = FromName<FilterPart>(name)) {
      axes.emplace_back(*part);
    } else {
      table.Fail(key, fmt::format("expected {}, {}, found \"{}\"", NameList<Axis>(),
                                  NameList<FilterPart>(), name));
    }
  }
  return axes;
}

// Reads every axis that the table names. Throws InputError where an axis cannot have a value: the
// experiment's scenes and filters must be known.
Selection ReadSelection(TomlTable& table, const Experiment& experiment) {
  Selection selection;
  for (const Axis axis : AllValues<Axis>()) {
    std::vector<AxisValue> values;
    for (const std::string& text : table.Values(ToString(axis))) {
      values.push_back(ReadAxisValue(table, experiment, axis, text));
    }
    if (!values.empty()) selection.values.emplace(axis, std::move(values));
  }
  return selection;
}

class LayoutReader {
 public:
  explicit LayoutReader(Experiment& experiment) : experiment_(experiment) {}

  TableLayout ReadLayout(TomlTable& table, std::string_view rows, std::string_view columns) {
    TableLayout layout;
    layout.name = ReadName(table);
    layout.title = table.Text("title").value_or(layout.name);
    layout.rows = ReadAxes(table, rows);
    layout.columns = ReadAxes(table, columns);
    if (layout.rows.empty()) table.Fail(rows, "is missing");
    layout.value = table.Named<TableValue>("value").value_or(TableValue::kRecalls);
    layout.where = ReadSelection(table, "where");
    table.RequireAllRead();
    return layout;
  }

  void ReadClaim(TomlTable& table) {
    Claim claim;
    claim.text = table.RequiredText("text");
    claim.name = table.Text("name").value_or(std::to_string(experiment_.claims.size() + 1));
    claim.where = ReadSelection(table, "where");
    claim.first = ReadSelection(table, "first");
    claim.second = ReadSelection(table, "second");
    claim.relation = table.Named<Claim::Relation>("relation").value_or(claim.relation);
    claim.from = ReadSelection(table, "from");
    claim.to = ReadSelection(table, "to");
    for (const auto& [key, selection] :
         {std::pair("first", &claim.first), {"second", &claim.second}}) {
      if (selection->values.empty()) table.Fail(key, "is missing");
    }
    if (claim.from.values.empty() != claim.to.values.empty()) {
      table.Fail("from", "from and to go together");
    }
    table.RequireAllRead();
    experiment_.claims.push_back(std::move(claim));
  }

 private:
  Selection ReadSelection(TomlTable& parent, std::string_view key) const {
    auto table = parent.Table(key);
    if (!table) return {};
    Selection selection = raylift::ReadSelection(*table, experiment_);
    table->RequireAllRead();
    return selection;
  }

  // Reads the name of a file of results, which is a plain one for that reason and may stand once.
  std::string ReadName(TomlTable& table) {
    std::string name = table.RequiredText("name");
    const bool plain = !name.empty() && std::all_of(name.begin(), name.end(), [](char c) {
      return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
             c == '_' || c == '-';
    });
    if (!plain) table.Fail("name", "expected letters, digits, _ and -");
    if (!names_.insert(name).second) table.Fail("name", "stands twice");
    return name;
  }

  Experiment& experiment_;
  std::set<std::string> names_;
};

// Adds [[table]], [[figure]] and [[claim]] of the whole file to the experiment.
void ReadLayouts(TomlTable& top, Experiment& experiment) {
  LayoutReader reader(experiment);
  for (TomlTable& table : top.Tables("table")) {
    experiment.tables.push_back(reader.ReadLayout(table, "rows", "columns"));
  }
  for (TomlTable& figure : top.Tables("figure")) {
    experiment.figures.push_back(reader.ReadLayout(figure, "lines", "panels"));
  }
  for (TomlTable& claim : top.Tables("claim")) reader.ReadClaim(claim);
}

constexpr std::string_view kEstimatorKeys[] = {"refinement",           "reprojection_threshold_px",
                                               "sampson_threshold_px", "min_iterations",
                                               "max_iterations",       "confidence"};

// Takes what a scene file says; returns its thresholds.
std::string TakeSceneFile(const path& file, ExperimentScene& scene) {
  scene.file = file;
  scene.file_is_missing = !Exists(file);
  if (scene.file_is_missing) return {};
  const SceneFile read = ReadSceneFile(file);
  scene.model = read.references;
  scene.images = read.images;
  scene.queries = read.queries;
  scene.query_images = read.query_images;
  scene.ground_truth = read.ground_truth;
  scene.groups = read.groups;
  scene.priors = read.priors;
  scene.times = read.times;
  for (const SceneGeometry& geometry : read.geometries) {
    scene.geometry.push_back(
        {.name = geometry.name, .title = geometry.name, .specs = {geometry.spec}});
  }
  return read.thresholds;
}

// Requires the inputs that every scene needs; a scene file that is missing may hold them.
void CheckScene(const TomlTable& table, const ExperimentScene& scene) {
  const auto hloc = {scene.features, scene.matches, scene.pairs};
  const bool any = std::any_of(hloc.begin(), hloc.end(), [](const path& p) { return !p.empty(); });
  const bool all = std::all_of(hloc.begin(), hloc.end(), [](const path& p) { return !p.empty(); });
  if (any && !all) table.Fail("features", "features, matches and pairs go together");
  if (scene.file_is_missing) return;
  if (scene.model.empty()) table.Fail("model", "is missing");
  if (scene.queries.empty()) table.Fail("queries", "is missing");
  if (scene.thresholds.empty()) table.Fail("thresholds", "is missing");
  if (!any && scene.images.empty()) {
    table.Fail("images", "is missing: needed where there are no features, matches and pairs");
  }
  if (!scene.group.empty() && scene.groups.empty()) {
    table.Fail("group", "needs groups, a list of lines \"query group\"");
  }
}

class ExperimentReader {
 public:
  ExperimentReader(const path& file, const VariableLookup& variables)
      : file_(file), top_(ReadToml(file, [variables](const std::string& text) {
          return ExpandVariables(text, variables);
        })) {}

  Experiment Read() {
    experiment_.file = file_;
    experiment_.title = top_.Text("title").value_or(file_.stem().string());
    ReadSeeds();
    experiment_.offsets = top_.Named<SubsamplingOffsets>("offsets").value_or(experiment_.offsets);
    ReadEstimator();
    ReadScenes();
    ReadFilters();
    for (TomlTable& block : top_.Tables("grid")) {
      experiment_.blocks.push_back({ReadSelection(block, experiment_)});
      block.RequireAllRead();
    }
    if (experiment_.blocks.empty()) top_.Fail("grid", "is missing");
    ReadLayouts(top_, experiment_);
    top_.RequireAllRead();
    return std::move(experiment_);
  }

 private:
  path Resolve(const std::string& text) const {
    if (text.empty()) return {};
    return (file_.parent_path() / text).lexically_normal();
  }

  void ReadSeeds() {
    if (!top_.Has("seeds")) return;
    experiment_.seeds.clear();
    for (const std::string& text : top_.Values("seeds")) {
      const auto seed = ParseUint(text);
      if (!seed) top_.Fail("seeds", "expected whole numbers of at least 0");
      experiment_.seeds.push_back(*seed);
    }
  }

  void ReadEstimator() {
    auto table = top_.Table("estimator");
    if (!table) return;
    // Other options would have to be among the inputs of cells.
    const auto fields = [this] {
      std::vector<Field> all = NumberFieldsOf(experiment_.estimator);
      std::erase_if(all, [](const Field& field) {
        return std::ranges::find(kEstimatorKeys, field.name) == std::end(kEstimatorKeys);
      });
      return all;
    };
    table->TakeFields(fields());
    table->CheckFields(fields());
    table->RequireAllRead();
  }

  void ReadScenes() {
    auto scenes = top_.Table("scenes");
    if (!scenes) top_.Fail("scenes", "is missing");
    for (const std::string& name : scenes->Keys()) {
      auto table = scenes->Table(name);
      if (!table) continue;
      experiment_.scenes.push_back(ReadScene(name, *table));
    }
    if (experiment_.scenes.empty()) top_.Fail("scenes", "holds none");
    OrderAsWritten(*scenes);
  }

  // A TOML table has no order of its own; that of the lines is meant.
  void OrderAsWritten(const TomlTable& scenes) {
    std::stable_sort(experiment_.scenes.begin(), experiment_.scenes.end(),
                     [&](const ExperimentScene& a, const ExperimentScene& b) {
                       return scenes.LineOf(a.name) < scenes.LineOf(b.name);
                     });
  }

  ExperimentScene ReadScene(const std::string& name, TomlTable& table) {
    ExperimentScene scene;
    scene.name = name;
    scene.title = table.Text("title").value_or(name);
    std::string thresholds;
    if (const auto file = table.Text("scene")) thresholds = TakeSceneFile(Resolve(*file), scene);
    TakePath(table, "model", scene.model);
    TakePath(table, "images", scene.images);
    TakePath(table, "query_images", scene.query_images);
    if (scene.query_images.empty()) scene.query_images = scene.images;
    TakePath(table, "queries", scene.queries);
    TakePath(table, "groups", scene.groups);
    TakePath(table, "priors", scene.priors);
    scene.group = table.Text("group").value_or("");
    TakePath(table, "times", scene.times);
    TakePath(table, "ground_truth", scene.ground_truth);
    for (const auto& [key, file] : {std::pair("features", &scene.features),
                                    {"matches", &scene.matches},
                                    {"pairs", &scene.pairs}}) {
      TakePath(table, key, *file);
    }
    table.Take(scene);
    thresholds = table.Text("thresholds").value_or(thresholds);
    if (!thresholds.empty()) {
      try {
        scene.thresholds = ParseThresholds(thresholds);
      } catch (const OptionError& error) {
        table.Fail("thresholds", error.what());
      }
    }
    if (auto geometry = table.Table("geometry")) TakeGeometries(*geometry, scene.geometry);
    CheckScene(table, scene);
    table.RequireAllRead();
    return scene;
  }

  void TakePath(TomlTable& table, std::string_view key, path& value) const {
    if (const auto text = table.Text(key)) value = Resolve(*text);
  }

  // Adds the table's geometries after those of the scene file, in the order of their lines; one of
  // the same name replaces the scene file's.
  void TakeGeometries(TomlTable& table, std::vector<ExperimentGeometry>& all) {
    std::vector<ExperimentGeometry> geometries;
    for (const std::string& name : table.Keys()) {
      ExperimentGeometry& geometry = geometries.emplace_back();
      geometry.name = geometry.title = name;
      if (table.IsTable(name)) {
        TomlTable entry = *table.Table(name);
        geometry.title = entry.Text("title").value_or(name);
        ReadPoints(entry, geometry);
        entry.RequireAllRead();
      } else {
        geometry.specs = {ResolveSpec(table.RequiredText(name))};
      }
    }
    std::stable_sort(geometries.begin(), geometries.end(),
                     [&](const ExperimentGeometry& a, const ExperimentGeometry& b) {
                       return table.LineOf(a.name) < table.LineOf(b.name);
                     });
    for (ExperimentGeometry& geometry : geometries) {
      std::erase_if(all,
                    [&](const ExperimentGeometry& other) { return other.name == geometry.name; });
      all.push_back(std::move(geometry));
    }
  }

  void ReadPoints(TomlTable& table, ExperimentGeometry& geometry) {
    geometry.mode = table.Named<GeometryMode>("mode").value_or(geometry.mode);
    table.Take(geometry.candidates);
    if (table.Has("spec")) {
      for (const std::string& spec : table.Values("spec")) {
        geometry.specs.push_back(ResolveSpec(spec));
      }
    }
    if (geometry.specs.empty() && geometry.candidates.mode != CandidateMode::kTriangulate) {
      table.Fail("spec", "is missing");
    }
    DepthPerturbation perturbation;
    table.Take(perturbation);
    if (perturbation != DepthPerturbation()) geometry.perturbation = perturbation;
    if (geometry.perturbation && geometry.specs.size() != 1) {
      table.Fail("spec", "expected one source, whose depth is made worse");
    }
  }

  // The paths of a specification are relative to the file.
  std::string ResolveSpec(const std::string& spec) const {
    return MapSpecPaths(spec, [this](const path& given) { return Resolve(given.string()); });
  }

  void ReadFilters() {
    for (const EnumName<FilterMode>& mode : kEnumNames<FilterMode>) {
      experiment_.filters.push_back({std::string(mode.name), mode.value, {}});
    }
    auto filters = top_.Table("filters");
    if (!filters) return;
    for (const std::string& name : filters->Keys()) {
      auto table = filters->Table(name);
      NamedFilter filter{name, FilterMode::kFixed, {}};
      filter.thresholds.min_ratio = 0;
      table->Take(filter.thresholds, "filter_");
      table->RequireAllRead();
      if (std::any_of(experiment_.filters.begin(), experiment_.filters.end(),
                      [&](const NamedFilter& other) { return other.name == name; })) {
        filters->Fail(name, "off, fixed and auto have their meaning already");
      }
      experiment_.filters.push_back(filter);
    }
  }

  path file_;
  TomlTable top_;
  Experiment experiment_;
};

}  // namespace

Experiment ReadExperiment(const path& file, const VariableLookup& variables) {
  return ExperimentReader(file, variables).Read();
}

}  // namespace raylift
