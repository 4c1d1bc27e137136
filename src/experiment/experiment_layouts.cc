#include "experiment_layouts.h"

#include <algorithm>
#include <set>
#include <string>
#include <utility>

#include <fmt/format.h>

#include "raylift/base/text.h"
#include "raylift/lifting/depth_alignment.h"

namespace raylift {
namespace {

// The value as settings hold it.
std::string CheckValue(const TomlTable& table, const Experiment& experiment, Axis axis,
                       const std::string& value) {
  const auto require = [&](bool good, const std::string& expected) {
    if (!good) {
      table.Fail(ToString(axis), fmt::format("expected {}, found \"{}\"", expected, value));
    }
  };
  switch (axis) {
    case Axis::kScene:
      require(std::any_of(experiment.scenes.begin(), experiment.scenes.end(),
                          [&](const ExperimentScene& scene) { return scene.name == value; }),
              "names of [scenes]");
      return value;
    case Axis::kEvery: {
      const auto number = ParseInt(value);
      require(number && *number >= 1 && *number <= 1'000'000, "numbers of at least 1");
      return std::to_string(*number);
    }
    case Axis::kGeometry:
      require(std::any_of(experiment.scenes.begin(), experiment.scenes.end(),
                          [&](const ExperimentScene& scene) {
                            return scene.file_is_missing || scene.FindGeometry(value) != nullptr;
                          }),
              "names of a scene's geometry");
      return value;
    case Axis::kAlign:
      require(FromName<AlignMode>(value).has_value(), NameList<AlignMode>());
      return value;
    case Axis::kFilter:
      require(std::any_of(experiment.filters.begin(), experiment.filters.end(),
                          [&](const NamedFilter& filter) { return filter.name == value; }),
              NameList<FilterMode>() + " or names of [filters]");
      return value;
    case Axis::kMethod:
      require(value == kOracle || FromName<Method>(value).has_value(),
              fmt::format("{}|{}", NameList<Method>(), kOracle));
      return value;
    case Axis::kScore:
      require(FromName<ScoreCombination>(value).has_value(), NameList<ScoreCombination>());
      return value;
    case Axis::kLo:
      require(FromName<LocalOptimization>(value).has_value(), NameList<LocalOptimization>());
      return value;
    case Axis::kAlpha: {
      const auto number = ParseDouble(value);
      require(number && *number >= 0, "numbers of at least 0");
      return FormatDouble(*number);
    }
  }
  return value;
}

std::vector<std::string> ReadAxes(TomlTable& table, std::string_view key) {
  static const std::set<std::string> kOfFilter = {"filter_reprojection_px", "filter_min_views",
                                                  "filter_min_ratio"};
  std::vector<std::string> axes = table.Values(key);
  for (const std::string& axis : axes) {
    if (!FromName<Axis>(axis) && !kOfFilter.contains(axis)) {
      table.Fail(key, fmt::format("expected {}, filter_reprojection_px|filter_min_views|"
                                  "filter_min_ratio, found \"{}\"",
                                  NameList<Axis>(), axis));
    }
  }
  return axes;
}

class LayoutReader {
 public:
  explicit LayoutReader(Experiment& experiment) : experiment_(experiment) {}

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
    return table.Named<TableValue>("value").value_or(TableValue::kRecalls);
  }

  Experiment& experiment_;
  std::set<std::string> names_;
};

}  // namespace

Selection ReadSelection(TomlTable& table, const Experiment& experiment) {
  Selection selection;
  for (const Axis axis : AllValues<Axis>()) {
    std::vector<std::string> values = table.Values(ToString(axis));
    if (values.empty()) continue;
    for (std::string& value : values) value = CheckValue(table, experiment, axis, value);
    selection.values.emplace(axis, std::move(values));
  }
  return selection;
}

void ReadLayouts(TomlTable& top, Experiment& experiment) {
  LayoutReader reader(experiment);
  for (TomlTable& table : top.Tables("table")) reader.ReadTable(table);
  for (TomlTable& figure : top.Tables("figure")) reader.ReadFigure(figure);
  for (TomlTable& claim : top.Tables("claim")) reader.ReadClaim(claim);
}

}  // namespace raylift
