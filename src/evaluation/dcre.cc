#include "evaluation/dcre.h"

#include <algorithm>
#include <cmath>

#include "base/constants.h"
#include "base/statistics.h"
#include <fmt/format.h>

#include "raylift/base/text.h"
#include "raylift/evaluation/depth_errors.h"

namespace raylift {
namespace {

double RecallPercent(const std::vector<double>& errors, double threshold) {
  if (errors.empty()) return 0;
  const auto close = std::count_if(errors.begin(), errors.end(),
                                   [threshold](double error) { return error <= threshold; });
  return 100.0 * static_cast<double>(close) / static_cast<double>(errors.size());
}

}  // namespace

std::optional<Dcre> ComputeDcre(const Camera& camera, const Rigid3& true_cam_from_world,
                                const Rigid3& estimated_cam_from_world,
                                std::span<const DensePoint> points) {
  if (points.empty()) return std::nullopt;
  const Rigid3 estimated_from_true = estimated_cam_from_world * true_cam_from_world.Inverse();
  const double diagonal_px = std::hypot(camera.width_px(), camera.height_px());
  Dcre dcre;
  dcre.count = points.size();
  for (const DensePoint& point : points) {
    const auto moved = camera.ImgFromCam(estimated_from_true * point.point_in_true_cam);
    const double error = moved ? std::min(1.0, (*moved - point.pixel).norm() / diagonal_px) : 1.0;
    dcre.mean += error / static_cast<double>(points.size());
    dcre.max = std::max(dcre.max, error);
  }
  return dcre;
}

DcreSummary SummarizeDcre(std::string name, std::span<const DcreQuery> queries) {
  DcreSummary summary;
  summary.name = std::move(name);
  std::vector<double> means, maxima;
  for (const DcreQuery& query : queries) {
    if (!query.has_depth) {
      summary.without_depth.push_back(query.name);
      continue;
    }
    ++summary.num_queries;
    means.push_back(query.dcre ? query.dcre->mean : kInfinity);
    maxima.push_back(query.dcre ? query.dcre->max : kInfinity);
  }
  for (const double threshold : kDcreThresholds) {
    summary.mean_recalls_percent.push_back(RecallPercent(means, threshold));
    summary.max_recalls_percent.push_back(RecallPercent(maxima, threshold));
  }
  summary.median_of_mean = UpperMedianOr(std::move(means), kInfinity);
  summary.median_of_max = UpperMedianOr(std::move(maxima), kInfinity);
  return summary;
}

std::string FormatDcreText(std::span<const DcreSummary> results) {
  TableRow header = {"DCRE, % of the diagonal", "queries", "without depth"};
  for (const char* what : {"mean", "max"}) {
    for (const double threshold : kDcreThresholds) {
      header.push_back(fmt::format("{}<{}%", what, FormatDouble(100 * threshold)));
    }
  }
  header.insert(header.end(), {"median of mean", "median of max"});
  const auto share = [](double value) {
    return std::isfinite(value) ? fmt::format("{:.3f}", 100 * value) : std::string("inf");
  };
  std::vector<TableRow> rows = {header};
  for (const DcreSummary& result : results) {
    TableRow row = {Printable(result.name), std::to_string(result.num_queries),
                    std::to_string(result.without_depth.size())};
    for (const auto* recalls : {&result.mean_recalls_percent, &result.max_recalls_percent}) {
      for (const double recall : *recalls) row.push_back(fmt::format("{:.1f}", recall));
    }
    row.push_back(share(result.median_of_mean));
    row.push_back(share(result.median_of_max));
    rows.push_back(std::move(row));
  }
  return AlignColumns(rows);
}

}  // namespace raylift
