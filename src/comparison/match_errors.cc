#include "match_errors.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/statistics.h"

#include "raylift/base/parallel.h"
#include "raylift/lifting/depth_alignment.h"
#include "raylift/lifting/reference_matches.h"

namespace raylift {

std::vector<LiftedMatchErrors> MeasureMatches(const GeometrySource& source,
                                              std::span<const PosedImage> images,
                                              std::span<const ReferenceMatch> matches,
                                              int threads) {
  const auto halves = HalvesByReference(matches, images.size());
  std::vector<LiftedMatchErrors> errors(images.size());
  ParallelFor(images.size(), threads, [&](size_t i) {
    std::vector<Eigen::Vector2d> pixels;
    for (const HalfMatch& match : halves[i]) pixels.push_back(match.pixel);
    const auto points = source.Lift(images[i], pixels);
    for (size_t k = 0; k < points.size(); ++k) {
      if (!points[k]) {
        ++errors[i].missing;
        continue;
      }
      const HalfMatch& match = halves[i][k];
      const PosedImage& to = images[static_cast<size_t>(match.other)];
      const auto pixel = to.camera.ImgFromCam(to.cam_from_world * points[k]->point_in_world);
      if (pixel) {
        errors[i].errors_px.push_back((*pixel - match.other_px).norm());
      } else {
        ++errors[i].missing;
      }
    }
  });
  return errors;
}

std::optional<MatchErrors> SummarizeMatches(std::span<const LiftedMatchErrors* const> errors) {
  MatchErrors summary;
  std::vector<double> all;
  for (const LiftedMatchErrors* part : errors) {
    all.insert(all.end(), part->errors_px.begin(), part->errors_px.end());
    summary.missing += part->missing;
  }
  summary.count = all.size();
  if (summary.count + summary.missing == 0) return std::nullopt;
  for (size_t k = 0; k < kMatchErrorThresholdsPx.size(); ++k) {
    const auto within = std::count_if(all.begin(), all.end(), [k](double error_px) {
      return error_px <= kMatchErrorThresholdsPx[k];
    });
    summary.within_percent[k] =
        100.0 * static_cast<double>(within) / static_cast<double>(summary.count + summary.missing);
  }
  if (!all.empty()) summary.median_px = MidpointMedianInPlace(std::span(all));
  return summary;
}

MatchScales ScalesByMatches(const GeometrySource& source, std::span<const PosedImage> images,
                            std::span<const ReferenceMatch> matches, int threads) {
  MatchScales scales;
  scales.log_scales.resize(images.size());
  if (matches.empty()) return scales;
  const DepthAlignment by_scale =
      AlignDepth(source, images, matches, {.mode = AlignMode::kScale}, threads);
  for (size_t i = 0; i < by_scale.maps.size(); ++i) {
    if (by_scale.maps[i].own_correction) {
      scales.log_scales[i] = -by_scale.maps[i].correction.log_factors.front();
    }
  }
  const DepthAlignment by_grid =
      AlignDepth(source, images, matches, {.mode = AlignMode::kGrid}, threads);
  std::vector<double> sigmas;
  for (const MapAlignment& map : by_grid.maps) {
    if (!map.own_correction) continue;
    const std::vector<double>& nodes = map.correction.log_factors;
    const auto n = static_cast<double>(nodes.size());
    const double mean = std::accumulate(nodes.begin(), nodes.end(), 0.0) / n;
    double square = 0;
    for (const double node : nodes) square += (node - mean) * (node - mean) / n;
    sigmas.push_back(std::sqrt(square));
  }
  if (!sigmas.empty()) scales.warp_sigma = MidpointMedianInPlace(std::span(sigmas));
  return scales;
}

}  // namespace raylift
