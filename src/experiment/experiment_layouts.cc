#include "experiment/experiment_layouts.h"

#include <algorithm>
#include <set>
#include <string>
#include <utility>

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/lifting/depth_alignment.h"

namespace raylift {
namespace {

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

  // The name of a file of results, hence a plain one, once.
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

}  // namespace

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

}  // namespace raylift
