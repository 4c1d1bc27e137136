// Compares sources of depth: which is best, where, and what is wrong with the others. Every source
// is looked at through every image, and compared with one source that is taken for the truth, with
// itself as other images see it, and with matches between images; the last two need no truth.
// Images are streamed: memory holds the maps of a few images, whatever their number.

#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/diagnosis/depth_faults.h"
#include "raylift/evaluation/depth_errors.h"
#include "raylift/lifting/depth_alignment.h"
#include "raylift/lifting/geometry_source.h"
#include "raylift/localization/scene.h"
#include "raylift/surfaces/triangle_mesh.h"

namespace raylift {

struct ComparedSource {
  std::string name;
  std::string spec;
  std::string interpretation;  // how its files were read
  std::shared_ptr<const GeometrySource> source;
  std::shared_ptr<const TriangleMesh> mesh = nullptr;  // null where it is none
};

std::vector<ComparedSource> ComparedSourcesOf(const Scene& scene);

// Distances of lifted keypoints from their matches in other images.
inline constexpr std::array<double, 6> kMatchErrorThresholdsPx = {1, 2, 4, 8, 16, 32};
struct MatchErrors {
  size_t count = 0;    // ends of matches that could be lifted and projected
  size_t missing = 0;  // that the source has no depth for
  double median_px = 0;
  std::array<double, kMatchErrorThresholdsPx.size()> within_percent = {};  // of count + missing
};

struct PairConsistency {
  size_t other = 0;
  size_t count = 0;
  double median_rho = 0;  // of |rho| < 0.25: which of the two images has the larger scale
};

// Agreement of an image's depth with that of others, see comparison/view_consistency.h.
struct ImageConsistency {
  size_t count = 0;                                  // samples that fall on depth in another image
  std::array<double, 3> within_percent = {0, 0, 0};  // |rho| below 1, 2 and 5 %
  double contradicted_percent = 0;                   // rho < -5 %
  double behind_percent = 0;                         // rho > 5 %
  std::vector<PairConsistency> pairs;
  std::vector<double> cost_of_scale;  // sum of min(|rho|, 10 %) per factor tried
};

// One source in one image.
struct ImageComparison {
  std::string image;
  double median_depth = 0;       // 0: no depth at all
  DepthCoverage coverage;        // of the truth, else of the image
  double quantization_step = 0;  // scene units
  // These rate it against the truth; there are none where the image has no depth in common with it.
  std::map<DepthProtocol, std::optional<DepthErrors>> errors;
  std::optional<DepthDeviation> deviation;
  std::optional<EdgeErrors> edges;
  std::optional<NormalErrors> normals;
  // Against other images.
  ImageConsistency consistency;
  std::optional<double> relative_log_scale;  // to the mean of the images, by consistency
  // Against matches.
  std::optional<MatchErrors> matches;
  std::optional<double> match_log_scale;  // by which the depths are too large
};

struct SourceComparison {
  std::string name;
  std::string spec;
  std::string interpretation;
  bool is_truth = false;
  std::vector<ImageComparison> images;
  BinnedDepthErrors by_distance, by_incidence, by_edge_distance;
  std::vector<SurfaceScore> surface;       // where a mesh is the truth
  std::optional<double> common_log_scale;  // by consistency
  std::optional<double> match_warp_sigma;  // by matches
  std::optional<MatchErrors> matches;      // of all images
  SourceTraits traits;
  std::optional<DepthExplanation> explanation;  // against the truth
  std::vector<Finding> findings;
};

struct DepthComparison {
  std::vector<SourceComparison> sources;
  std::optional<size_t> truth;
  std::vector<std::vector<size_t>> overlaps;  // of each image
};

struct DepthComparisonOptions {
  std::optional<size_t> truth;  // index of a source
  // Larger images are compared at every n-th pixel along each side, at the values that maps of the
  // image's own size have there.
  int max_side_px = 640;
  int max_overlaps = 5;
  DepthRange range;  // of the errors against the truth; all else looks at every depth
  std::vector<double> surface_thresholds;  // scene units; empty: 1, 2 and 5 % of the median depth
  int threads = 0;
  // Is called once for each image with its maps, from several threads.
  std::function<void(size_t image, const PosedImage& view, std::span<const SourceView> views)>
      on_views = {};
  std::function<void()> on_progress = {};  // once per image and source
  std::function<void()> on_judged = {};    // once per source, after all images
};

// Returns the n of DepthComparisonOptions::max_side_px.
int ComparedStride(const Camera& camera, int max_side_px);

// `matches` are between `images`, by their indices, and may be empty. The result does not depend on
// the number of threads.
DepthComparison CompareDepth(std::span<const ComparedSource> sources,
                             std::span<const PosedImage> images,
                             std::span<const ReferenceMatch> matches,
                             const DepthComparisonOptions& options);

// Returns the mean over the images that have the value; nullopt where no image has.
std::optional<double> MeanOverImages(
    const SourceComparison& source,
    const std::function<std::optional<double>(const ImageComparison&)>& value);

}  // namespace raylift
