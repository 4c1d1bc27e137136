#include "match_errors.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>

#include "raylift/base/parallel.h"
#include "raylift/lifting/depth_alignment.h"

namespace raylift {
namespace {

// One end of a match: where it is lifted and where it should land.
struct MatchEnd {
  Eigen::Vector2d from_px;
  size_t to_image;
  Eigen::Vector2d to_px;
};

// Indices of the matches of each image.
std::vector<std::vector<uint32_t>> MatchesByImage(size_t num_images,
                                                  std::span<const ReferenceMatch> matches) {
  std::vector<std::vector<uint32_t>> indices(num_images);
  for (uint32_t i = 0; i < matches.size(); ++i) {
    indices[static_cast<size_t>(matches[i].reference_a)].push_back(i);
    indices[static_cast<size_t>(matches[i].reference_b)].push_back(i);
  }
  return indices;
}

MatchEnd EndIn(size_t image, const ReferenceMatch& match) {
  if (static_cast<size_t>(match.reference_a) == image) {
    return {match.a_px, static_cast<size_t>(match.reference_b), match.b_px};
  }
  return {match.b_px, static_cast<size_t>(match.reference_a), match.a_px};
}

}  // namespace

std::vector<LiftedMatchErrors> MeasureMatches(const GeometrySource& source,
                                              std::span<const PosedImage> images,
                                              std::span<const ReferenceMatch> matches,
                                              int threads) {
  const auto indices = MatchesByImage(images.size(), matches);
  std::vector<LiftedMatchErrors> errors(images.size());
  ParallelFor(images.size(), threads, [&](size_t i) {
    std::vector<MatchEnd> ends;
    std::vector<Eigen::Vector2d> pixels;
    for (const uint32_t index : indices[i]) {
      ends.push_back(EndIn(i, matches[index]));
      pixels.push_back(ends.back().from_px);
    }
    const auto points = source.Lift(images[i], pixels);
    for (size_t k = 0; k < points.size(); ++k) {
      if (!points[k]) {
        ++errors[i].missing;
        continue;
      }
      const PosedImage& to = images[ends[k].to_image];
      const auto pixel = to.camera.ImgFromCam(to.cam_from_world * points[k]->point_in_world);
      if (pixel) {
        errors[i].errors_px.push_back((*pixel - ends[k].to_px).norm());
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
  if (!all.empty()) summary.median_px = MedianOf(std::span(all));
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
  if (!sigmas.empty()) scales.warp_sigma = MedianOf(std::span(sigmas));
  return scales;
}

}  // namespace raylift
