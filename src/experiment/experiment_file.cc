#include "raylift/experiment/experiment_file.h"

#include <algorithm>
#include <charconv>
#include <limits>
#include <set>

#include "toml_table.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/geometry/pose_convention.h"
#include "raylift/lifting/depth_alignment.h"

namespace raylift {
namespace {

using std::filesystem::path;

// ${NAME} by the value of the variable.
std::string ExpandVariables(const std::string& text, const VariableLookup& variables) {
  std::string expanded;
  size_t position = 0;
  for (size_t begin; (begin = text.find("${", position)) != std::string::npos;) {
    const size_t end = text.find('}', begin);
    if (end == std::string::npos) throw std::string("\"${\" is not closed");
    const std::string name = text.substr(begin + 2, end - begin - 2);
    const auto value = variables(name);
    if (!value) {
      throw fmt::format("${{{}}} is not set (--datasets DIR, --set NAME=VALUE or the environment)",
                        name);
    }
    expanded += text.substr(position, begin - position) + *value;
    position = end + 1;
  }
  return expanded + text.substr(position);
}

class ExperimentReader {
 public:
  ExperimentReader(const path& file, const VariableLookup& variables)
      : file_(file), top_(file, "", ParseTomlFile(file), [variables](const std::string& text) {
          return ExpandVariables(text, variables);
        }) {}

  Experiment Read() {
    experiment_.file = file_;
    experiment_.title = top_.Text("title").value_or(file_.stem().string());
    ReadSeeds();
    ReadEstimator();
    ReadScenes();
    ReadFilters();
    for (TomlTable& block : top_.Tables("grid")) experiment_.blocks.push_back(ReadBlock(block));
    if (experiment_.blocks.empty()) top_.Fail("grid", "is missing");
    for (TomlTable& table : top_.Tables("table")) ReadTable(table);
    for (TomlTable& figure : top_.Tables("figure")) ReadFigure(figure);
    for (TomlTable& claim : top_.Tables("claim")) ReadClaim(claim);
    top_.RequireAllRead();
    return std::move(experiment_);
  }

 private:
  path Resolve(const std::string& text) const {
    if (text.empty()) return {};
    return (file_.parent_path() / text).lexically_normal();
  }

  path OptionalPath(TomlTable& table, std::string_view key) const {
    return Resolve(table.Text(key).value_or(""));
  }

  static void ReadPositive(TomlTable& table, std::string_view key, int& value) {
    const auto number = table.Integer(key);
    if (!number) return;
    if (*number < 1 || *number > std::numeric_limits<int>::max()) {
      table.Fail(key, "must be at least 1");
    }
    value = static_cast<int>(*number);
  }

  static void ReadNumber(TomlTable& table, std::string_view key, double& value) {
    value = table.Number(key).value_or(value);
  }

  // What the options' own checks complain of, with the place in the file.
  template <typename Function>
  static auto Checked(const TomlTable& table, std::string_view key, const Function& function) {
    try {
      return function();
    } catch (const OptionError& error) {
      table.Fail(key, error.what());
    }
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
    EstimatorOptions& options = experiment_.estimator;
    ReadNumber(*table, "reprojection_threshold_px", options.reprojection_threshold_px);
    ReadNumber(*table, "sampson_threshold_px", options.sampson_threshold_px);
    ReadPositive(*table, "min_iterations", options.min_iterations);
    ReadPositive(*table, "max_iterations", options.max_iterations);
    ReadNumber(*table, "confidence", options.confidence);
    table->RequireAllRead();
    Checked(top_, "estimator", [&] { options.Validate(); });
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
    scene.model = Resolve(table.RequiredText("model"));
    scene.model_poses = table.Text("model_poses").value_or(scene.model_poses);
    if (!PoseConventionFromName(scene.model_poses)) {
      table.Fail("model_poses", "expected " + PoseConventionNames());
    }
    scene.images = OptionalPath(table, "images");
    scene.query_images = OptionalPath(table, "query_images");
    if (scene.query_images.empty()) scene.query_images = scene.images;
    scene.queries = Resolve(table.RequiredText("queries"));
    scene.ground_truth = OptionalPath(table, "ground_truth");
    scene.features = OptionalPath(table, "features");
    scene.matches = OptionalPath(table, "matches");
    scene.pairs = OptionalPath(table, "pairs");
    const auto hloc = {scene.features, scene.matches, scene.pairs};
    const bool any =
        std::any_of(hloc.begin(), hloc.end(), [](const path& p) { return !p.empty(); });
    const bool all =
        std::all_of(hloc.begin(), hloc.end(), [](const path& p) { return !p.empty(); });
    if (any && !all) table.Fail("features", "features, matches and pairs go together");
    if (!any && scene.images.empty()) {
      table.Fail("images", "is missing: needed where there are no features, matches and pairs");
    }
    ReadPositive(table, "top_k", scene.top_k);
    ReadPositive(table, "max_features", scene.max_features);
    const std::string thresholds = table.RequiredText("thresholds");
    scene.thresholds = Checked(table, "thresholds", [&] { return ParseThresholds(thresholds); });
    if (auto geometry = table.Table("geometry")) scene.geometry = ReadGeometries(*geometry);
    table.RequireAllRead();
    return scene;
  }

  std::vector<ExperimentGeometry> ReadGeometries(TomlTable& table) {
    std::vector<ExperimentGeometry> geometries;
    for (const std::string& name : table.Keys()) {
      ExperimentGeometry& geometry = geometries.emplace_back();
      geometry.name = geometry.title = name;
      if (table.IsTable(name)) {
        TomlTable entry = *table.Table(name);
        geometry.spec = ResolveSpec(entry.RequiredText("spec"));
        geometry.title = entry.Text("title").value_or(name);
        geometry.perturbation = ReadPerturbation(entry);
        entry.RequireAllRead();
      } else {
        geometry.spec = ResolveSpec(table.RequiredText(name));
      }
    }
    std::stable_sort(geometries.begin(), geometries.end(),
                     [&](const ExperimentGeometry& a, const ExperimentGeometry& b) {
                       return table.LineOf(a.name) < table.LineOf(b.name);
                     });
    return geometries;
  }

  // "mesh:PATH,key=value": the path is relative to the file.
  std::string ResolveSpec(const std::string& spec) const {
    const size_t colon = spec.find(':');
    if (colon == std::string::npos) return spec;
    const size_t comma = spec.find(',', colon);
    const std::string place =
        spec.substr(colon + 1, comma == std::string::npos ? std::string::npos : comma - colon - 1);
    return spec.substr(0, colon + 1) + Resolve(place).string() +
           (comma == std::string::npos ? std::string() : spec.substr(comma));
  }

  std::optional<DepthPerturbation> ReadPerturbation(TomlTable& table) {
    DepthPerturbation p;
    const DepthPerturbation none;
    ReadNumber(table, "scale", p.scale);
    ReadNumber(table, "scale_sigma", p.scale_sigma);
    ReadNumber(table, "warp", p.warp_sigma);
    ReadNumber(table, "noise", p.noise_sigma);
    ReadNumber(table, "relative_noise", p.relative_noise_sigma);
    ReadNumber(table, "flying", p.flying_share);
    ReadNumber(table, "quantize", p.quantization_step);
    ReadNumber(table, "holes", p.hole_share);
    if (table.Has("bubbles")) ReadPositive(table, "bubbles", p.bubbles);
    if (table.Has("floaters")) ReadPositive(table, "floaters", p.floaters);
    ReadNumber(table, "bubble_height", p.bubble_height);
    const bool any = p.scale != none.scale || p.scale_sigma > 0 || p.warp_sigma > 0 ||
                     p.noise_sigma > 0 || p.relative_noise_sigma > 0 || p.flying_share > 0 ||
                     p.quantization_step > 0 || p.hole_share > 0 || p.bubbles > 0 || p.floaters > 0;
    Checked(table, "spec", [&] { p.Validate(); });
    return any ? std::optional(p) : std::nullopt;
  }

  void ReadFilters() {
    experiment_.filters = {{"off", FilterMode::kOff, {}},
                           {"fixed", FilterMode::kFixed, {}},
                           {"auto", FilterMode::kAuto, {}}};
    auto filters = top_.Table("filters");
    if (!filters) return;
    for (const std::string& name : filters->Keys()) {
      auto table = filters->Table(name);
      NamedFilter filter{name, FilterMode::kFixed, {}};
      filter.thresholds.min_ratio = 0;
      ReadNumber(*table, "reprojection_px", filter.thresholds.reprojection_px);
      ReadPositive(*table, "min_views", filter.thresholds.min_views);
      ReadNumber(*table, "min_ratio", filter.thresholds.min_ratio);
      table->RequireAllRead();
      Checked(*filters, name, [&] { filter.thresholds.Validate(); });
      if (std::any_of(experiment_.filters.begin(), experiment_.filters.end(),
                      [&](const NamedFilter& other) { return other.name == name; })) {
        filters->Fail(name, "off, fixed and auto have their meaning already");
      }
      experiment_.filters.push_back(filter);
    }
  }

  GridBlock ReadBlock(TomlTable& table) {
    GridBlock block{ReadSelection(table)};
    table.RequireAllRead();
    return block;
  }

  // Every axis that the table names, with values that the axis can have.
  Selection ReadSelection(TomlTable& table) const {
    Selection selection;
    for (const Axis axis : kAllAxes) {
      std::vector<std::string> values = table.Values(ToString(axis));
      if (values.empty()) continue;
      for (std::string& value : values) value = CheckValue(table, axis, value);
      selection.values.emplace(axis, std::move(values));
    }
    return selection;
  }

  Selection ReadSelection(TomlTable& parent, std::string_view key) const {
    auto table = parent.Table(key);
    if (!table) return {};
    Selection selection = ReadSelection(*table);
    table->RequireAllRead();
    return selection;
  }

  // The value as settings hold it.
  std::string CheckValue(const TomlTable& table, Axis axis, const std::string& value) const {
    const auto require = [&](bool good, const std::string& expected) {
      if (!good) {
        table.Fail(ToString(axis), fmt::format("expected {}, found \"{}\"", expected, value));
      }
    };
    switch (axis) {
      case Axis::kScene:
        require(std::any_of(experiment_.scenes.begin(), experiment_.scenes.end(),
                            [&](const ExperimentScene& scene) { return scene.name == value; }),
                "names of [scenes]");
        return value;
      case Axis::kEvery: {
        const auto number = ParseInt(value);
        require(number && *number >= 1 && *number <= 1'000'000, "numbers of at least 1");
        return std::to_string(*number);
      }
      case Axis::kGeometry:
        require(std::any_of(experiment_.scenes.begin(), experiment_.scenes.end(),
                            [&](const ExperimentScene& scene) {
                              return scene.FindGeometry(value) != nullptr;
                            }),
                "names of a scene's geometry");
        return value;
      case Axis::kAlign:
        require(AlignModeFromName(value).has_value(), "off|scale|affine|grid");
        return value;
      case Axis::kFilter:
        require(std::any_of(experiment_.filters.begin(), experiment_.filters.end(),
                            [&](const NamedFilter& filter) { return filter.name == value; }),
                "off|fixed|auto or names of [filters]");
        return value;
      case Axis::kMethod:
        require(value == kOracle || MethodFromName(value).has_value(),
                "p3p|e5p1|adaptive|select|hybrid_ransac|hloc|oracle");
        return value;
      case Axis::kScore:
        require(ScoreCombinationFromName(value).has_value(),
                "sum_inl|sum_inl_rat|mult_inl|sum_msac|mult_msac");
        return value;
      case Axis::kLo:
        require(LocalOptimizationFromName(value).has_value(), "hybrid|split");
        return value;
      case Axis::kAlpha: {
        const auto number = ParseDouble(value);
        require(number && *number >= 0, "numbers of at least 0");
        return FormatDouble(*number);
      }
    }
    return value;
  }

  std::vector<std::string> ReadAxes(TomlTable& table, std::string_view key) const {
    static const std::set<std::string> kOfFilter = {"filter_reprojection_px", "filter_min_views",
                                                    "filter_min_ratio"};
    std::vector<std::string> axes = table.Values(key);
    for (const std::string& axis : axes) {
      if (!AxisFromName(axis) && !kOfFilter.contains(axis)) {
        table.Fail(key, fmt::format("expected {}, filter_reprojection_px|filter_min_views|"
                                    "filter_min_ratio, found \"{}\"",
                                    AxisNames(), axis));
      }
    }
    return axes;
  }

  // Of a file of results, hence a plain one, once.
  std::string ReadName(TomlTable& table) {
    const std::string name = table.RequiredText("name");
    const bool plain = !name.empty() && std::all_of(name.begin(), name.end(), [](char c) {
      return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
             c == '_' || c == '-';
    });
    if (!plain) table.Fail("name", "expected letters, digits, _ and -");
    if (!names_.insert(name).second) table.Fail("name", "stands twice");
    return name;
  }

  static TableValue ReadValue(TomlTable& table) {
    return table.Named("value", &TableValueFromName, "recalls|median|auc|localized")
        .value_or(TableValue::kRecalls);
  }

  void ReadTable(TomlTable& table) {
    TableLayout layout;
    layout.name = ReadName(table);
    layout.title = table.Text("title").value_or(layout.name);
    layout.rows = ReadAxes(table, "rows");
    layout.columns = ReadAxes(table, "columns");
    if (layout.rows.empty()) table.Fail("rows", "is missing");
    layout.value = ReadValue(table);
    layout.where = ReadSelection(table, "where");
    table.RequireAllRead();
    experiment_.tables.push_back(std::move(layout));
  }

  void ReadFigure(TomlTable& table) {
    FigureLayout layout;
    layout.name = ReadName(table);
    layout.title = table.Text("title").value_or(layout.name);
    layout.panels = ReadAxes(table, "panels");
    layout.lines = ReadAxes(table, "lines");
    if (layout.lines.empty()) table.Fail("lines", "is missing");
    layout.value = ReadValue(table);
    layout.where = ReadSelection(table, "where");
    table.RequireAllRead();
    experiment_.figures.push_back(std::move(layout));
  }

  static std::optional<Claim::Relation> RelationFromName(std::string_view name) {
    if (name == "better") return Claim::Relation::kBetter;
    if (name == "not_worse") return Claim::Relation::kNotWorse;
    return std::nullopt;
  }

  void ReadClaim(TomlTable& table) {
    Claim claim;
    claim.text = table.RequiredText("text");
    claim.name = table.Text("name").value_or(std::to_string(experiment_.claims.size() + 1));
    claim.where = ReadSelection(table, "where");
    claim.first = ReadSelection(table, "first");
    claim.second = ReadSelection(table, "second");
    claim.relation =
        table.Named("relation", &RelationFromName, "better|not_worse").value_or(claim.relation);
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

  path file_;
  TomlTable top_;
  Experiment experiment_;
  std::set<std::string> names_;
};

}  // namespace

Experiment ReadExperiment(const path& file, const VariableLookup& variables) {
  return ExperimentReader(file, variables).Read();
}

}  // namespace raylift
