#include "comparison/comparison_tables.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/json_text.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

using Json = nlohmann::ordered_json;
using Better = DepthMetric::Better;
using Value = std::optional<double>;

// Returns a function for a member of an optional part of an image's comparison, or of a source's.
template <typename Whole, typename Part, typename Member>
auto Of(std::optional<Part> Whole::*part, Member Part::*member) {
  return [part, member](const Whole& whole) -> Value {
    if (!(whole.*part)) return std::nullopt;
    if constexpr (std::is_same_v<Member, std::optional<double>>) {
      return *(whole.*part).*member;
    } else {
      return static_cast<double>(*(whole.*part).*member);
    }
  };
}

template <typename Whole, typename Part, size_t N>
auto Of(std::optional<Part> Whole::*part, std::array<double, N> Part::*member, size_t index) {
  return [part, member, index](const Whole& whole) -> Value {
    if (!(whole.*part)) return std::nullopt;
    return (*(whole.*part).*member)[index];
  };
}

// Returns nullopt where no match could be lifted: that is not an error of 0 px.
Value MedianMatchError(const std::optional<MatchErrors>& matches) {
  if (!matches || matches->count == 0) return std::nullopt;
  return matches->median_px;
}

// Returns a function; `take` returns a figure of an image's consistency.
template <typename Take>
auto OfConsistency(const Take& take) {
  return [take](const ImageComparison& image) -> Value {
    if (image.consistency.count == 0) return std::nullopt;
    return take(image.consistency);
  };
}

// Returns ln of a factor as percent too large.
Value PercentOf(const Value& log_scale) {
  if (!log_scale) return std::nullopt;
  return 100 * std::expm1(*log_scale);
}

auto AsPercent(std::optional<double> ImageComparison::*log_scale) {
  return [log_scale](const ImageComparison& image) { return PercentOf(image.*log_scale); };
}

auto SigmaPercent(double DepthDeviation::*sigma) {
  return [sigma](const ImageComparison& image) -> Value {
    if (!image.deviation) return std::nullopt;
    return 100 * (*image.deviation).*sigma;
  };
}

// The figures of merit of the depth networks' papers.
struct ProtocolColumn {
  std::string_view key, title;
  Better better;
  int digits;
  double (*value)(const DepthErrors&);
  bool is_standard = true;  // in the papers' tables
};
constexpr ProtocolColumn kProtocolColumns[] = {
    {"abs_rel", "AbsRel", Better::kLow, 4, [](const DepthErrors& e) { return e.abs_rel; }},
    {"sq_rel", "SqRel", Better::kLow, 4, [](const DepthErrors& e) { return e.sq_rel; }},
    {"rmse", "RMSE", Better::kLow, 4, [](const DepthErrors& e) { return e.rmse; }},
    {"rmse_log", "RMSE log", Better::kLow, 4, [](const DepthErrors& e) { return e.rmse_log; }},
    {"log10", "log10", Better::kLow, 4, [](const DepthErrors& e) { return e.log10; }},
    {"si_log", "SILog", Better::kLow, 2, [](const DepthErrors& e) { return e.si_log; }},
    {"delta1_percent", "delta1 %", Better::kHigh, 1,
     [](const DepthErrors& e) { return e.delta_percent[0]; }},
    {"delta2_percent", "delta2 %", Better::kHigh, 1,
     [](const DepthErrors& e) { return e.delta_percent[1]; }},
    {"delta3_percent", "delta3 %", Better::kHigh, 1,
     [](const DepthErrors& e) { return e.delta_percent[2]; }},
    {"mae", "MAE", Better::kLow, 4, [](const DepthErrors& e) { return e.mae; }, false},
    {"median_signed_error", "bias", Better::kNeither, 4,
     [](const DepthErrors& e) { return e.median_signed_error; }, false},
};

// Returns the prefix of a protocol's columns; in files those of the ratio of the medians keep the
// prefix "median".
std::string_view PrefixOf(DepthProtocol protocol) {
  using enum DepthProtocol;
  switch (protocol) {
    case kMetric:
      return "";
    case kScale:
      return "median";
    case kAffine:
      return "affine";
    case kScaleInverse:
      return "scale_inverse";
    case kAffineInverse:
      return "affine_inverse";
  }
  return {};
}

std::string KeyOf(const ProtocolColumn& column, DepthProtocol protocol) {
  const std::string prefix(PrefixOf(protocol));
  return prefix + (prefix.empty() ? "" : "_") + std::string(column.key);
}

std::string TitleOf(const ProtocolColumn& column, DepthProtocol protocol) {
  if (protocol == DepthProtocol::kMetric) return std::string(column.title);
  const std::string_view name =
      protocol == DepthProtocol::kScale ? PrefixOf(protocol) : ToString(protocol);
  return fmt::format("{} ({})", column.title, name);
}

std::vector<DepthMetric> MakeMetrics() {
  using I = ImageComparison;
  std::vector<DepthMetric> metrics = {
      {"coverage_percent", "coverage %", Better::kHigh, 1,
       [](const I& image) -> Value { return image.coverage.covered_percent; }},
      {"holes_per_megapixel", "holes / Mpx", Better::kLow, 0,
       [](const I& image) -> Value { return image.coverage.holes_per_megapixel; }},
      {"invented_percent", "invented %", Better::kLow, 1,
       [](const I& image) -> Value { return image.coverage.invented_percent; }},
      {"median_depth", "median depth", Better::kNeither, 4,
       [](const I& image) -> Value { return image.median_depth; }},
  };
  for (const DepthProtocol protocol : AllValues<DepthProtocol>()) {
    for (const ProtocolColumn& column : kProtocolColumns) {
      metrics.push_back({KeyOf(column, protocol), TitleOf(column, protocol), column.better,
                         column.digits, [protocol, &column](const I& image) -> Value {
                           const auto errors = image.errors.find(protocol);
                           if (errors == image.errors.end() || !errors->second) return {};
                           return column.value(*errors->second);
                         }});
    }
  }
  const std::vector<DepthMetric> others = {
      {"edge_accuracy_px", "edge acc px", Better::kLow, 2, Of(&I::edges, &EdgeErrors::accuracy_px)},
      {"edge_completeness_px", "edge comp px", Better::kLow, 2,
       Of(&I::edges, &EdgeErrors::completeness_px)},
      {"spurious_edges_percent", "spurious edges %", Better::kLow, 1,
       Of(&I::edges, &EdgeErrors::spurious_percent)},
      {"normal_mean_deg", "normals mean deg", Better::kLow, 2,
       Of(&I::normals, &NormalErrors::mean_deg)},
      {"normal_median_deg", "normals median deg", Better::kLow, 2,
       Of(&I::normals, &NormalErrors::median_deg)},
      {"normal_within_11deg_percent", "normals < 11.25 deg %", Better::kHigh, 1,
       Of(&I::normals, &NormalErrors::within_percent, 0)},
      {"scale_error_percent", "scale error %", Better::kNeither, 2,
       [](const I& image) -> Value {
         return PercentOf(Of(&I::deviation, &DepthDeviation::log_scale)(image));
       }},
      {"warp_percent", "warp %", Better::kLow, 2, SigmaPercent(&DepthDeviation::warp_sigma)},
      {"noise_percent", "noise %", Better::kLow, 2, SigmaPercent(&DepthDeviation::noise_sigma)},
      {"edge_outliers_percent", "outliers at edges %", Better::kLow, 1,
       Of(&I::deviation, &DepthDeviation::edge_outliers_percent)},
      {"in_front_percent", "in front %", Better::kLow, 2,
       Of(&I::deviation, &DepthDeviation::in_front_percent)},
      {"consistent_1_percent", "views agree < 1 %", Better::kHigh, 1,
       OfConsistency([](const ImageConsistency& c) { return c.within_percent[0]; })},
      {"consistent_2_percent", "views agree < 2 %", Better::kHigh, 1,
       OfConsistency([](const ImageConsistency& c) { return c.within_percent[1]; })},
      {"contradicted_percent", "contradicted %", Better::kLow, 1,
       OfConsistency([](const ImageConsistency& c) { return c.contradicted_percent; })},
      {"relative_scale_percent", "scale among views %", Better::kNeither, 2,
       AsPercent(&I::relative_log_scale)},
      {"match_median_px", "match error px", Better::kLow, 2,
       [](const I& image) { return MedianMatchError(image.matches); },
       [](const SourceComparison& source) { return MedianMatchError(source.matches); }},
      {"match_count", "matches", Better::kNeither, 0, Of(&I::matches, &MatchErrors::count),
       Of(&SourceComparison::matches, &MatchErrors::count)},
      {"match_within_4px_percent", "matches < 4 px %", Better::kHigh, 1,
       Of(&I::matches, &MatchErrors::within_percent, 2),
       Of(&SourceComparison::matches, &MatchErrors::within_percent, 2)},
      {"match_scale_percent", "scale by matches %", Better::kNeither, 2,
       AsPercent(&I::match_log_scale)},
  };
  metrics.insert(metrics.end(), others.begin(), others.end());
  return metrics;
}

std::string Cell(const Value& value, int digits) {
  return value ? fmt::format("{:.{}f}", *value, digits) : "-";
}

// Writes enough digits to tell values apart.
std::string Exact(const Value& value) { return value ? fmt::format("{:.9g}", *value) : ""; }

Json Number(const Value& value) { return value && std::isfinite(*value) ? Json(*value) : Json(); }

// The columns of the printed table.
constexpr std::string_view kPrinted[] = {
    "coverage_percent", "abs_rel",           "median_abs_rel",          "delta1_percent",
    "edge_accuracy_px", "normal_median_deg", "consistent_2_percent",    "contradicted_percent",
    "match_median_px",  "match_count",       "match_within_4px_percent"};

// Calls a function for the rows of a source's curves: name, from, to, bin.
template <typename Function>
void ForEachBin(const SourceComparison& source, Function function) {
  const std::pair<const char*, const BinnedDepthErrors*> curves[] = {
      {"distance", &source.by_distance},
      {"incidence_deg", &source.by_incidence},
      {"edge_distance_px", &source.by_edge_distance}};
  for (const auto& [name, curve] : curves) {
    for (size_t i = 0; i < curve->bins().size(); ++i) {
      function(name, curve->edges()[i], curve->edges()[i + 1], curve->bins()[i]);
    }
  }
}

Json CurvesJson(const SourceComparison& source) {
  Json curves = Json::object();
  ForEachBin(source,
             [&](const char* name, double from, double to, const BinnedDepthErrors::Bin& bin) {
               AppendTo(curves, name,
                        {{"from", from},
                         {"to", to},
                         {"count", bin.count},
                         {"abs_rel", bin.AbsRel()},
                         {"mae", bin.Mae()},
                         {"bias", bin.Bias()}});
             });
  if (source.matches) {
    for (size_t k = 0; k < kMatchErrorThresholdsPx.size(); ++k) {
      AppendTo(
          curves, "reprojection_px",
          {{"to", kMatchErrorThresholdsPx[k]}, {"percent", source.matches->within_percent[k]}});
    }
  }
  return curves;
}

Json ImageJson(const ImageComparison& image) {
  Json json = {{"image", image.image}};
  for (const DepthMetric& metric : DepthMetrics()) {
    json[std::string(metric.key)] = Number(metric.value(image));
  }
  return json;
}

Json ExplanationJson(const std::optional<DepthExplanation>& explanation) {
  if (!explanation) return {};
  Json alike = Json::array();
  for (const DepthFault fault : explanation->alike) alike.push_back(ToString(fault));
  return {{"cause", explanation->cause ? Json(ToString(*explanation->cause)) : Json()},
          {"size", explanation->size},
          {"explained_percent", explanation->explained_percent},
          {"alike", alike},
          {"error", explanation->error},
          {"noise", explanation->noise}};
}

Json SourceJson(const SourceComparison& source) {
  Json means = Json::object();
  for (const DepthMetric& metric : DepthMetrics()) {
    means[std::string(metric.key)] = Number(ValueOfSource(source, metric));
  }
  Json findings = Json::array();
  for (const Finding& finding : source.findings) {
    findings.push_back({{"distortion", ToString(finding.fault)},
                        {"amount", finding.amount},
                        {"severity", finding.severity},
                        {"text", finding.text}});
  }
  Json surface = Json::array();
  for (const SurfaceScore& score : source.surface) {
    surface.push_back({{"threshold", score.threshold},
                       {"accuracy_percent", score.accuracy_percent},
                       {"completeness_percent", score.completeness_percent},
                       {"f_percent", score.f_percent}});
  }
  Json images = Json::array();
  for (const ImageComparison& image : source.images) images.push_back(ImageJson(image));
  return {{"name", source.name},
          {"spec", source.spec},
          {"interpretation", source.interpretation},
          {"is_truth", source.is_truth},
          {"findings", findings},
          {"explanation", ExplanationJson(source.explanation)},
          {"scale_percent", Number(PercentOf(source.traits.log_scale))},
          {"scale_spread_percent", Number(PercentOf(source.traits.log_scale_sigma))},
          {"common_scale_by_views_percent", Number(PercentOf(source.common_log_scale))},
          {"means", means},
          {"surface", surface},
          {"curves", CurvesJson(source)},
          {"images", images}};
}

// Returns a paper's table with a row for each source that is not the truth.
std::string ProtocolText(const DepthComparison& comparison, DepthProtocol protocol) {
  TableRow header = {"source", "images"};
  for (const ProtocolColumn& column : kProtocolColumns) {
    if (column.is_standard) header.emplace_back(column.title);
  }
  std::vector<TableRow> rows = {header};
  for (const SourceComparison& source : comparison.sources) {
    if (source.is_truth) continue;
    const auto is_compared = [protocol](const ImageComparison& image) {
      const auto errors = image.errors.find(protocol);
      return errors != image.errors.end() && errors->second;
    };
    TableRow row = {
        Printable(source.name),
        std::to_string(std::count_if(source.images.begin(), source.images.end(), is_compared))};
    for (const ProtocolColumn& column : kProtocolColumns) {
      if (!column.is_standard) continue;
      const auto mean = MeanOverImages(source, [&](const ImageComparison& image) -> Value {
        if (!is_compared(image)) return std::nullopt;
        return column.value(*image.errors.at(protocol));
      });
      row.push_back(Cell(mean, column.digits));
    }
    rows.push_back(std::move(row));
  }
  return fmt::format("\nprotocol {}: {}; means over the images\n{}", ToString(protocol),
                     kEnumNames<DepthProtocol>[static_cast<size_t>(protocol)].description,
                     AlignColumns(rows));
}

// A purpose of depth, and the metric by which sources are ranked for it.
struct Purpose {
  std::string_view name, key;
};
constexpr Purpose kPurposes[] = {{"depth", "abs_rel"},
                                 {"depth up to a scale of each image", "median_abs_rel"},
                                 {"edges", "edge_accuracy_px"},
                                 {"normals", "normal_median_deg"},
                                 {"agreement with the matches", "match_within_4px_percent"},
                                 {"agreement among its views", "consistent_2_percent"},
                                 {"completeness", "coverage_percent"}};

const DepthMetric& MetricOf(std::string_view key) {
  const std::vector<DepthMetric>& metrics = DepthMetrics();
  const auto found = std::find_if(metrics.begin(), metrics.end(),
                                  [key](const DepthMetric& metric) { return metric.key == key; });
  RAYLIFT_CHECK(found != metrics.end());
  return *found;
}

// Returns the source that is not the truth with the best value, the first of several; null where
// none has a value or all have the same.
const SourceComparison* BestBy(const DepthComparison& comparison, const DepthMetric& metric) {
  const SourceComparison* best = nullptr;
  bool differs = false;
  const double sign = metric.better == Better::kLow ? -1 : 1;
  for (const SourceComparison& source : comparison.sources) {
    const Value value = ValueOfSource(source, metric);
    if (source.is_truth || !value) continue;
    if (best == nullptr) {
      best = &source;
      continue;
    }
    const double gain = sign * (*value - *ValueOfSource(*best, metric));
    // Values that are printed alike count as equal.
    differs = differs || std::abs(gain) >= std::pow(10, -metric.digits);
    if (gain >= std::pow(10, -metric.digits)) best = &source;
  }
  return differs ? best : nullptr;
}

}  // namespace

std::string Advice(const DepthComparison& comparison) {
  std::vector<std::pair<const SourceComparison*, std::string>> uses;
  for (const Purpose& purpose : kPurposes) {
    const DepthMetric& metric = MetricOf(purpose.key);
    const SourceComparison* best = BestBy(comparison, metric);
    if (best == nullptr) continue;
    auto use = std::find_if(uses.begin(), uses.end(),
                            [best](const auto& known) { return known.first == best; });
    if (use == uses.end()) use = uses.insert(use, {best, {}});
    use->second += fmt::format("{}{} ({} {})", use->second.empty() ? "" : ", ", purpose.name,
                               metric.title, Cell(ValueOfSource(*best, metric), metric.digits));
  }
  std::string text;
  for (const auto& [source, purposes] : uses) {
    text += fmt::format("{}{} for {}", text.empty() ? "best: " : "; ", Printable(source->name),
                        purposes);
  }
  return text;
}

const std::vector<DepthMetric>& DepthMetrics() {
  static const std::vector<DepthMetric> metrics = MakeMetrics();
  return metrics;
}

std::optional<double> ValueOfSource(const SourceComparison& source, const DepthMetric& metric) {
  return metric.pooled ? metric.pooled(source) : MeanOverImages(source, metric.value);
}

std::string FormatComparisonText(const DepthComparison& comparison,
                                 std::span<const DepthProtocol> protocols) {
  std::vector<const DepthMetric*> columns;
  for (const std::string_view key : kPrinted) {
    const DepthMetric& metric = MetricOf(key);
    if (std::any_of(comparison.sources.begin(), comparison.sources.end(), [&](const auto& source) {
          return ValueOfSource(source, metric).has_value();
        })) {
      columns.push_back(&metric);
    }
  }
  TableRow header = {"source"};
  for (const DepthMetric* metric : columns) header.emplace_back(metric->title);
  std::vector<TableRow> rows = {header};
  for (const SourceComparison& source : comparison.sources) {
    TableRow row = {Printable(source.name) + (source.is_truth ? " (truth)" : "")};
    for (const DepthMetric* metric : columns) {
      row.push_back(Cell(ValueOfSource(source, *metric), metric->digits));
    }
    rows.push_back(std::move(row));
  }
  std::string text = Advice(comparison);
  if (!text.empty()) text += '\n';
  text += AlignColumns(rows);
  for (const SourceComparison& source : comparison.sources) {
    if (source.is_truth) continue;
    text += fmt::format("{}: ", Printable(source.name));
    if (source.findings.empty()) text += "nothing to complain of";
    for (size_t i = 0; i < source.findings.size(); ++i) {
      text += (i > 0 ? "; " : "") + source.findings[i].text;
    }
    text += '\n';
  }
  for (const DepthProtocol protocol : protocols) text += ProtocolText(comparison, protocol);
  return text;
}

std::string FormatSourcesCsv(const DepthComparison& comparison) {
  TableRow header = {"source", "is_truth", "scale_percent", "scale_spread_percent", "findings"};
  for (const DepthMetric& metric : DepthMetrics()) header.emplace_back(metric.key);
  std::string text = CsvLine(header);
  for (const SourceComparison& source : comparison.sources) {
    std::string findings;
    for (const Finding& finding : source.findings) {
      findings += (findings.empty() ? "" : "; ") + std::string(ToString(finding.fault));
    }
    TableRow row = {source.name, source.is_truth ? "true" : "false",
                    Exact(PercentOf(source.traits.log_scale)),
                    Exact(PercentOf(source.traits.log_scale_sigma)), findings};
    for (const DepthMetric& metric : DepthMetrics()) {
      row.push_back(Exact(ValueOfSource(source, metric)));
    }
    text += CsvLine(row);
  }
  return text;
}

std::string FormatImagesCsv(const DepthComparison& comparison) {
  TableRow header = {"source", "image"};
  for (const DepthMetric& metric : DepthMetrics()) header.emplace_back(metric.key);
  std::string text = CsvLine(header);
  for (const SourceComparison& source : comparison.sources) {
    for (const ImageComparison& image : source.images) {
      TableRow row = {source.name, image.image};
      for (const DepthMetric& metric : DepthMetrics()) row.push_back(Exact(metric.value(image)));
      text += CsvLine(row);
    }
  }
  return text;
}

std::string FormatCurvesCsv(const DepthComparison& comparison) {
  std::string text = "source,curve,from,to,count,abs_rel,mae,bias,percent\n";
  for (const SourceComparison& source : comparison.sources) {
    ForEachBin(
        source, [&](const char* name, double from, double to, const BinnedDepthErrors::Bin& bin) {
          text += CsvLine({source.name, name, Exact(from), Exact(to), std::to_string(bin.count),
                           Exact(bin.AbsRel()), Exact(bin.Mae()), Exact(bin.Bias()), ""});
        });
    if (source.matches) {
      for (size_t k = 0; k < kMatchErrorThresholdsPx.size(); ++k) {
        text += CsvLine({source.name, "reprojection_px", "0", Exact(kMatchErrorThresholdsPx[k]),
                         std::to_string(source.matches->count), "", "", "",
                         Exact(source.matches->within_percent[k])});
      }
    }
    for (const SurfaceScore& score : source.surface) {
      for (const auto& [name, percent] :
           {std::pair("surface_accuracy", score.accuracy_percent),
            std::pair("surface_completeness", score.completeness_percent),
            std::pair("surface_f", score.f_percent)}) {
        text += CsvLine(
            {source.name, name, "0", Exact(score.threshold), "", "", "", "", Exact(percent)});
      }
    }
  }
  return text;
}

std::string FormatComparisonJson(const DepthComparison& comparison) {
  Json sources = Json::array();
  for (const SourceComparison& source : comparison.sources) sources.push_back(SourceJson(source));
  const Json truth = comparison.truth ? Json(comparison.sources[*comparison.truth].name) : Json();
  const Json document = {{"truth", truth}, {"advice", Advice(comparison)}, {"sources", sources}};
  return JsonText(document, 1) + '\n';
}

}  // namespace raylift
