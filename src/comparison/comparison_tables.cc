#include "raylift/comparison/comparison_tables.h"

#include <array>
#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/json_text.h"
#include "raylift/base/text_table.h"

namespace raylift {
namespace {

using Json = nlohmann::ordered_json;
using Better = DepthMetric::Better;
using Value = std::optional<double>;

// A member of an optional part of an image's comparison.
template <typename Part, typename Member>
auto Of(std::optional<Part> ImageComparison::*part, Member Part::*member) {
  return [part, member](const ImageComparison& image) -> Value {
    if (!(image.*part)) return std::nullopt;
    if constexpr (std::is_same_v<Member, std::optional<double>>) {
      return *(image.*part).*member;
    } else {
      return static_cast<double>(*(image.*part).*member);
    }
  };
}

template <typename Part, size_t N>
auto Of(std::optional<Part> ImageComparison::*part, std::array<double, N> Part::*member,
        size_t index) {
  return [part, member, index](const ImageComparison& image) -> Value {
    if (!(image.*part)) return std::nullopt;
    return (*(image.*part).*member)[index];
  };
}

auto OfConsistency(double ImageConsistency::*member) {
  return [member](const ImageComparison& image) -> Value {
    if (image.consistency.count == 0) return std::nullopt;
    return image.consistency.*member;
  };
}

// ln of a factor as percent too large.
auto AsPercent(std::optional<double> ImageComparison::*log_scale) {
  return [log_scale](const ImageComparison& image) -> Value {
    if (!(image.*log_scale)) return std::nullopt;
    return 100 * std::expm1(*(image.*log_scale));
  };
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
  struct Fit {
    std::optional<DepthErrors> I::*part;
    std::array<std::string_view, 10> keys, titles;
  };
  const Fit fits[] = {{&I::raw,
                       {"abs_rel", "sq_rel", "rmse", "rmse_log", "si_log", "delta1_percent",
                        "delta2_percent", "delta3_percent", "mae", "median_signed_error"},
                       {"AbsRel", "SqRel", "RMSE", "RMSE log", "SILog", "delta1 %", "delta2 %",
                        "delta3 %", "MAE", "bias"}},
                      {&I::median_fitted,
                       {"median_abs_rel", "median_sq_rel", "median_rmse", "median_rmse_log",
                        "median_si_log", "median_delta1_percent", "median_delta2_percent",
                        "median_delta3_percent", "median_mae", "median_median_signed_error"},
                       {"AbsRel (median)", "SqRel (median)", "RMSE (median)", "RMSE log (median)",
                        "SILog (median)", "delta1 % (median)", "delta2 % (median)",
                        "delta3 % (median)", "MAE (median)", "bias (median)"}},
                      {&I::affine_fitted,
                       {"affine_abs_rel", "affine_sq_rel", "affine_rmse", "affine_rmse_log",
                        "affine_si_log", "affine_delta1_percent", "affine_delta2_percent",
                        "affine_delta3_percent", "affine_mae", "affine_median_signed_error"},
                       {"AbsRel (affine)", "SqRel (affine)", "RMSE (affine)", "RMSE log (affine)",
                        "SILog (affine)", "delta1 % (affine)", "delta2 % (affine)",
                        "delta3 % (affine)", "MAE (affine)", "bias (affine)"}}};
  for (const Fit& fit : fits) {
    const auto add = [&](size_t k, Better better, int digits, auto value) {
      metrics.push_back({fit.keys[k], fit.titles[k], better, digits, value});
    };
    add(0, Better::kLow, 4, Of(fit.part, &DepthErrors::abs_rel));
    add(1, Better::kLow, 4, Of(fit.part, &DepthErrors::sq_rel));
    add(2, Better::kLow, 4, Of(fit.part, &DepthErrors::rmse));
    add(3, Better::kLow, 4, Of(fit.part, &DepthErrors::rmse_log));
    add(4, Better::kLow, 2, Of(fit.part, &DepthErrors::si_log));
    for (size_t k = 0; k < 3; ++k) {
      add(5 + k, Better::kHigh, 1, Of(fit.part, &DepthErrors::delta_percent, k));
    }
    add(8, Better::kLow, 4, Of(fit.part, &DepthErrors::mae));
    add(9, Better::kNeither, 4, Of(fit.part, &DepthErrors::median_signed_error));
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
         if (!image.deviation) return std::nullopt;
         return 100 * std::expm1(image.deviation->log_scale);
       }},
      {"warp_percent", "warp %", Better::kLow, 2,
       [](const I& image) -> Value {
         if (!image.deviation) return std::nullopt;
         return 100 * image.deviation->warp_sigma;
       }},
      {"noise_percent", "noise %", Better::kLow, 2,
       [](const I& image) -> Value {
         if (!image.deviation) return std::nullopt;
         return 100 * image.deviation->noise_sigma;
       }},
      {"edge_outliers_percent", "outliers at edges %", Better::kLow, 1,
       Of(&I::deviation, &DepthDeviation::edge_outliers_percent)},
      {"in_front_percent", "in front %", Better::kLow, 2,
       Of(&I::deviation, &DepthDeviation::in_front_percent)},
      {"consistent_1_percent", "views agree < 1 %", Better::kHigh, 1,
       [](const I& image) -> Value {
         if (image.consistency.count == 0) return std::nullopt;
         return image.consistency.within_percent[0];
       }},
      {"consistent_2_percent", "views agree < 2 %", Better::kHigh, 1,
       [](const I& image) -> Value {
         if (image.consistency.count == 0) return std::nullopt;
         return image.consistency.within_percent[1];
       }},
      {"contradicted_percent", "contradicted %", Better::kLow, 1,
       OfConsistency(&ImageConsistency::contradicted_percent)},
      {"relative_scale_percent", "scale among views %", Better::kNeither, 2,
       AsPercent(&I::relative_log_scale)},
      {"match_median_px", "match error px", Better::kLow, 2,
       Of(&I::matches, &MatchErrors::median_px)},
      {"match_within_4px_percent", "matches < 4 px %", Better::kHigh, 1,
       Of(&I::matches, &MatchErrors::within_percent, 2)},
      {"match_scale_percent", "scale by matches %", Better::kNeither, 2,
       AsPercent(&I::match_log_scale)},
  };
  metrics.insert(metrics.end(), others.begin(), others.end());
  return metrics;
}

std::string Field(const Value& value, int digits) {
  if (!value) return "";
  return fmt::format("{:.{}f}", *value, digits);
}

// For machines: enough digits to tell values apart.
std::string Exact(const Value& value) { return value ? fmt::format("{:.9g}", *value) : ""; }

Json Number(const Value& value) { return value && std::isfinite(*value) ? Json(*value) : Json(); }

Value PercentOf(const Value& log_scale) {
  if (!log_scale) return std::nullopt;
  return 100 * std::expm1(*log_scale);
}

// The columns of the printed table.
constexpr std::string_view kPrinted[] = {"coverage_percent",     "abs_rel",
                                         "median_abs_rel",       "delta1_percent",
                                         "edge_accuracy_px",     "normal_median_deg",
                                         "consistent_2_percent", "contradicted_percent",
                                         "match_median_px",      "match_within_4px_percent"};

// The curves of a source as rows: name, from, to, bin.
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
               curves[name].push_back({{"from", from},
                                       {"to", to},
                                       {"count", bin.count},
                                       {"abs_rel", bin.AbsRel()},
                                       {"mae", bin.Mae()},
                                       {"bias", bin.Bias()}});
             });
  if (source.matches) {
    for (size_t k = 0; k < kMatchErrorThresholdsPx.size(); ++k) {
      curves["reprojection_px"].push_back(
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

Json SourceJson(const SourceComparison& source) {
  Json means = Json::object();
  for (const DepthMetric& metric : DepthMetrics()) {
    means[std::string(metric.key)] = Number(MeanOverImages(source, metric.value));
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
          {"understood", source.understood},
          {"is_truth", source.is_truth},
          {"findings", findings},
          {"scale_percent", Number(PercentOf(source.traits.log_scale))},
          {"scale_spread_percent", Number(PercentOf(source.traits.log_scale_sigma))},
          {"common_scale_by_views_percent", Number(PercentOf(source.common_log_scale))},
          {"means", means},
          {"surface", surface},
          {"curves", CurvesJson(source)},
          {"images", images}};
}

}  // namespace

const std::vector<DepthMetric>& DepthMetrics() {
  static const std::vector<DepthMetric> metrics = MakeMetrics();
  return metrics;
}

std::string FormatComparisonText(const DepthComparison& comparison) {
  std::vector<const DepthMetric*> columns;
  for (const std::string_view key : kPrinted) {
    for (const DepthMetric& metric : DepthMetrics()) {
      bool is_known = false;
      for (const SourceComparison& source : comparison.sources) {
        is_known = is_known || MeanOverImages(source, metric.value).has_value();
      }
      if (metric.key == key && is_known) columns.push_back(&metric);
    }
  }
  TableRow header = {"source"};
  for (const DepthMetric* metric : columns) header.emplace_back(metric->title);
  std::vector<TableRow> rows = {header};
  for (const SourceComparison& source : comparison.sources) {
    TableRow row = {Printable(source.name) + (source.is_truth ? " (truth)" : "")};
    for (const DepthMetric* metric : columns) {
      const Value mean = MeanOverImages(source, metric->value);
      row.push_back(mean ? Field(mean, metric->digits) : "-");
    }
    rows.push_back(std::move(row));
  }
  std::string text = AlignColumns(rows);
  for (const SourceComparison& source : comparison.sources) {
    if (source.is_truth) continue;
    text += fmt::format("{}: ", Printable(source.name));
    if (source.findings.empty()) text += "nothing to complain of";
    for (size_t i = 0; i < source.findings.size(); ++i) {
      text += (i > 0 ? "; " : "") + source.findings[i].text;
    }
    text += '\n';
  }
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
      row.push_back(Exact(MeanOverImages(source, metric.value)));
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
  const Json document = {{"truth", truth}, {"sources", sources}};
  return JsonText(document, 1) + '\n';
}

}  // namespace raylift
