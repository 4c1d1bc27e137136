// Computes the errors of all sources in one image.

#pragma once

#include <span>
#include <vector>

#include "evaluation/dcre.h"

#include "raylift/comparison/depth_comparison.h"
#include "raylift/evaluation/pose_errors.h"
#include "raylift/lifting/geometry_source.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// The part of one image in the curves of one source.
struct ImageCurves {
  BinnedDepthErrors by_distance, by_incidence, by_edge_distance;
};

struct ImageResults {
  std::vector<ImageComparison> of_source;
  std::vector<ImageCurves> curves;
  std::vector<std::vector<Eigen::Vector3d>> points_of_source;  // where a mesh is the truth
};

// Returns the errors of every source's view against the truth's, of depths within `range`.
ImageResults CompareImage(std::span<const ComparedSource> sources, const PosedImage& view,
                          std::span<const SourceView> views, std::optional<size_t> truth,
                          const DepthRange& range, const ImageCurves& empty_curves);

// Compares lifted keypoints with their matches in other images.

// Distances in pixels of keypoints of one image, lifted and projected, from their matches.
struct LiftedMatchErrors {
  std::vector<double> errors_px;
  size_t missing = 0;
};

// Measures both ends of every match; the results are by the image that is lifted from.
std::vector<LiftedMatchErrors> MeasureMatches(const GeometrySource& source,
                                              std::span<const PosedImage> images,
                                              std::span<const ReferenceMatch> matches, int threads);

// Returns nullopt where there are no matches.
std::optional<MatchErrors> SummarizeMatches(std::span<const LiftedMatchErrors* const> errors);

// Factors by which depth is too large: the inverse of the corrections that align it with matches.
struct MatchScales {
  std::vector<std::optional<double>> log_scales;  // one per image
  std::optional<double> warp_sigma;
};
MatchScales ScalesByMatches(const GeometrySource& source, std::span<const PosedImage> images,
                            std::span<const ReferenceMatch> matches, int threads);

// Computes the DCRE of whole results: a source of geometry gives the surface that each photograph
// shows at the true pose.

// Returns the errors per result and query, in the order of `true_views`. `matched_poses` holds each
// result's poses by the true views' names (MatchNames).
std::vector<std::vector<DcreQuery>> MeasureDcre(const GeometrySource& source,
                                                std::span<const PosedImage> true_views,
                                                std::span<const PosesByName> matched_poses,
                                                int count, int threads);

}  // namespace raylift
