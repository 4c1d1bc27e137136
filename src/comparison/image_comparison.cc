#include "image_comparison.h"

#include <algorithm>

#include "base/statistics.h"
#include "surface_scorer.h"

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

}  // namespace raylift
