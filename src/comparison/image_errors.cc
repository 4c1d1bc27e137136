#include "comparison/image_errors.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/statistics.h"
#include "comparison/surface_distance.h"
#include "diagnosis/value_models.h"
#include "lifting/reference_matches.h"
#include "lifting/source_view.h"

#include "raylift/base/parallel.h"
#include "raylift/lifting/depth_alignment.h"

namespace raylift {
namespace {

double MedianDepth(const DepthMap& map) {
  std::vector<float> known;
  for (const float z : map.z) {
    if (z > 0) known.push_back(z);
  }
  return known.empty() ? 0 : MidpointMedianInPlace(std::span(known));
}

void CompareWithTruth(const SourceView& view, const SourceView& truth,
                      std::span<const uint8_t> true_edges, std::span<const float> to_true_edge_px,
                      const DepthRange& range, ImageComparison& result) {
  for (const DepthProtocol protocol : AllValues<DepthProtocol>()) {
    result.errors[protocol] = ComputeDepthErrors(view.depth.z, truth.depth.z, protocol, range);
  }
  result.deviation = MeasureDeviation(view.depth, truth.depth, to_true_edge_px);
  result.edges = ComputeEdgeErrors(FindDepthEdges(view.depth), true_edges, view.depth.width_px);
  result.normals = ComputeNormalErrors(view.normals_in_world, truth.normals_in_world);
}

std::vector<Eigen::Vector3d> PointsOf(const DepthMap& map, const PosedImage& view) {
  const Rigid3 world_from_cam = view.cam_from_world.Inverse();
  std::vector<Eigen::Vector3d> points;
  for (const Eigen::Vector2d& pixel : ScoredPixels(view.camera)) {
    const float z = map.At(static_cast<int>(pixel.x()), static_cast<int>(pixel.y()));
    if (!(z > 0)) continue;
    const auto ray = view.camera.RayInCam(pixel);
    if (ray && ray->z() > 0) {
      points.push_back(world_from_cam * (*ray * (static_cast<double>(z) / ray->z())));
    }
  }
  return points;
}

// Returns the surface points of a grid of about `count` pixels.
std::vector<DensePoint> SeenPoints(const GeometrySource& source, const PosedImage& true_view,
                                   int count) {
  const auto pixels = GridPixels(true_view.camera, count);
  const auto points = source.Lift(true_view, pixels);
  std::vector<DensePoint> seen;
  for (size_t i = 0; i < pixels.size(); ++i) {
    const auto ray = true_view.camera.RayInCam(pixels[i]);
    if (!points[i] || !ray || !(ray->z() > 0) || !(points[i]->depth_z > 0)) continue;
    seen.push_back({pixels[i], *ray * (points[i]->depth_z / ray->z())});
  }
  return seen;
}

}  // namespace

ImageResults CompareImage(std::span<const ComparedSource> sources, const PosedImage& view,
                          std::span<const SourceView> views, std::optional<size_t> truth,
                          const DepthRange& range, const ImageCurves& empty_curves) {
  ImageResults results;
  results.of_source.resize(sources.size());
  results.curves.assign(sources.size(), empty_curves);
  results.points_of_source.resize(sources.size());
  std::vector<uint8_t> true_edges;
  std::vector<float> to_true_edge_px;
  if (truth) {
    true_edges = FindDepthEdges(views[*truth].depth);
    to_true_edge_px = DistanceToSet(true_edges, view.camera.width_px());
  }
  const bool wants_points = truth && sources[*truth].mesh != nullptr;
  for (size_t s = 0; s < sources.size(); ++s) {
    ImageComparison& result = results.of_source[s];
    result.image = view.name;
    result.median_depth = MedianDepth(views[s].depth);
    result.quantization_step = FindQuantizationStep(views[s].depth);
    const std::span<const float> true_z =
        truth ? std::span<const float>(views[*truth].depth.z) : std::span<const float>();
    result.coverage = ComputeCoverage(views[s].depth.z, true_z, view.camera.width_px());
    if (wants_points && s != *truth) results.points_of_source[s] = PointsOf(views[s].depth, view);
    if (!truth || s == *truth) continue;
    CompareWithTruth(views[s], views[*truth], true_edges, to_true_edge_px, range, result);
    ImageCurves& curves = results.curves[s];
    curves.by_distance.Add(views[s].depth.z, true_z, true_z);
    curves.by_incidence.Add(views[s].depth.z, true_z, views[*truth].incidence_deg);
    curves.by_edge_distance.Add(views[s].depth.z, true_z, to_true_edge_px);
  }
  return results;
}

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
  const DepthAlignment by_scale = AlignDepth(source, images, matches, AlignMode::kScale, threads);
  for (size_t i = 0; i < by_scale.maps.size(); ++i) {
    if (by_scale.maps[i].own_correction) {
      scales.log_scales[i] = -by_scale.maps[i].correction.log_factors.front();
    }
  }
  const DepthAlignment by_grid = AlignDepth(source, images, matches, AlignMode::kGrid, threads);
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

std::vector<std::vector<DcreQuery>> MeasureDcre(const GeometrySource& source,
                                                std::span<const PosedImage> true_views,
                                                std::span<const PosesByName> matched_poses,
                                                int count, int threads) {
  std::vector<std::vector<DcreQuery>> results(matched_poses.size(),
                                              std::vector<DcreQuery>(true_views.size()));
  ParallelFor(true_views.size(), threads, [&](size_t i) {
    const PosedImage& view = true_views[i];
    const auto points = SeenPoints(source, view, count);
    for (size_t r = 0; r < matched_poses.size(); ++r) {
      DcreQuery& query = results[r][i];
      query.name = view.name;
      query.has_depth = !points.empty();
      const auto pose = matched_poses[r].find(view.name);
      if (pose != matched_poses[r].end() && pose->second.IsFinite()) {
        query.dcre = ComputeDcre(view.camera, view.cam_from_world, pose->second, points);
      }
    }
  });
  return results;
}

}  // namespace raylift
