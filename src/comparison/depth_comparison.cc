#include "raylift/comparison/depth_comparison.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "base/statistics.h"
#include "comparison/image_errors.h"
#include "comparison/surface_distance.h"
#include "comparison/view_consistency.h"
#include "diagnosis/depth_explanation.h"
#include "lifting/source_view.h"

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"
#include "raylift/geometry/residuals.h"

namespace raylift {
namespace {

constexpr int kDistanceBins = 10;
constexpr double kSmoothFront = 0.03;  // edges per pixel: below, what stands in front has none

using ValueOfImage = std::function<std::optional<double>(const ImageComparison&)>;

std::vector<double> Collect(const SourceComparison& source, const ValueOfImage& value) {
  std::vector<double> values;
  for (const ImageComparison& image : source.images) {
    if (const auto v = value(image)) values.push_back(*v);
  }
  return values;
}

std::optional<double> MedianOverImages(const SourceComparison& source, const ValueOfImage& value) {
  auto values = Collect(source, value);
  if (values.empty()) return std::nullopt;
  return MidpointMedianInPlace(std::span(values));
}

ImageCurves EmptyCurves(const std::vector<double>& sorted_depths) {
  const double far = sorted_depths.empty() ? 1 : sorted_depths[sorted_depths.size() * 99 / 100];
  std::vector<double> distances;
  for (int i = 0; i <= kDistanceBins; ++i) distances.push_back(far * i / kDistanceBins);
  return {BinnedDepthErrors(distances), BinnedDepthErrors({0, 10, 20, 30, 40, 50, 60, 70, 80, 90}),
          BinnedDepthErrors({0, 1, 2, 3, 5, 8, 12, 20, 40, 80})};
}

// Judges the noise of all images together, which have a wider range of depths than one.
void JudgeNoise(SourceComparison& source) {
  std::vector<NoiseLevel> levels;
  std::vector<double> lengths;
  for (const ImageComparison& image : source.images) {
    if (!image.deviation) continue;
    for (const NoiseLevel& level : image.deviation->noise_levels) {
      levels.push_back(level);
      lengths.push_back(level.depth * level.sigma);
    }
  }
  source.traits.noise_exponent = NoiseExponent(levels);
  if (!lengths.empty()) source.traits.noise_length = MidpointMedianInPlace(std::span(lengths));
}

void JudgeByTruth(SourceComparison& source) {
  SourceTraits& traits = source.traits;
  const auto of_deviation = [](double DepthDeviation::*member) -> ValueOfImage {
    return [member](const ImageComparison& image) -> std::optional<double> {
      if (!image.deviation) return std::nullopt;
      return (*image.deviation).*member;
    };
  };
  const ValueOfImage log_scale = of_deviation(&DepthDeviation::log_scale);
  traits.log_scale = MedianOverImages(source, log_scale);
  traits.log_scale_sigma = RobustSigma(Collect(source, log_scale));
  traits.warp_sigma = MedianOverImages(source, of_deviation(&DepthDeviation::warp_sigma));
  traits.noise_sigma = MedianOverImages(source, of_deviation(&DepthDeviation::noise_sigma));
  JudgeNoise(source);
  traits.edge_outliers_percent =
      MedianOverImages(source, [](const ImageComparison& image) -> std::optional<double> {
        if (!image.deviation) return std::nullopt;
        return image.deviation->edge_outliers_percent - image.deviation->interior_outliers_percent;
      });
  traits.in_front_percent = MeanOverImages(source, of_deviation(&DepthDeviation::in_front_percent));
  const auto sharpness =
      MeanOverImages(source, of_deviation(&DepthDeviation::edges_per_pixel_in_front));
  traits.front_is_smooth = sharpness && *sharpness < kSmoothFront;
}

// Matches say more of the scale than views do, where there are some.
void JudgeWithoutTruth(SourceComparison& source) {
  SourceTraits& traits = source.traits;
  const ValueOfImage by_matches = [](const ImageComparison& image) {
    return image.match_log_scale;
  };
  const ValueOfImage by_views = [](const ImageComparison& image) {
    return image.relative_log_scale;
  };
  const auto match_scales = Collect(source, by_matches);
  const auto view_scales = Collect(source, by_views);
  traits.log_scale =
      match_scales.empty() ? source.common_log_scale : MedianOverImages(source, by_matches);
  if (!match_scales.empty()) {
    traits.log_scale_sigma = RobustSigma(match_scales);
  } else if (!view_scales.empty()) {
    traits.log_scale_sigma = RobustSigma(view_scales);
  }
  // Keypoints' noise alone spreads a grid of factors by so much.
  constexpr double kGridNoise = 0.02;
  if (source.match_warp_sigma) {
    traits.warp_sigma = std::max(0.0, *source.match_warp_sigma - kGridNoise);
  }
}

void Judge(bool has_truth, SourceComparison& source) {
  SourceTraits& traits = source.traits;
  if (!has_truth) JudgeWithoutTruth(source);
  if (!source.is_truth) {
    if (has_truth) JudgeByTruth(source);
    traits.relative_quantization =
        MedianOverImages(source, [](const ImageComparison& image) -> std::optional<double> {
          if (!(image.median_depth > 0)) return std::nullopt;
          return image.quantization_step / image.median_depth;
        });
    const auto covered =
        MeanOverImages(source, [](const ImageComparison& image) -> std::optional<double> {
          return image.coverage.covered_percent;
        });
    if (covered) traits.missing_percent = 100 - *covered;
  }
  source.findings = FindFaults(traits);
}

class Comparer {
 public:
  Comparer(std::span<const ComparedSource> sources, std::span<const PosedImage> images,
           std::span<const ReferenceMatch> matches, const DepthComparisonOptions& options)
      : sources_(sources), images_(images), options_(options) {
    RAYLIFT_CHECK(!sources.empty());
    std::copy_if(matches.begin(), matches.end(), std::back_inserter(matches_),
                 [&](const ReferenceMatch& match) { return FitsPoses(match); });
    for (const PosedImage& image : images) views_.push_back(Sparse(image, Stride(image)));
  }

  DepthComparison Run() {
    DepthComparison result;
    result.truth = options_.truth;
    result.overlaps = FindOverlaps(*sources_[options_.truth.value_or(0)].source, images_,
                                   options_.max_overlaps, options_.threads);
    const std::vector<double> depths = SampleDepths();
    const double median_depth = depths.empty() ? 1 : depths[depths.size() / 2];
    const ImageCurves curves = EmptyCurves(depths);
    thresholds_ = options_.surface_thresholds;
    if (thresholds_.empty()) {
      for (const double share : {0.01, 0.02, 0.05}) thresholds_.push_back(share * median_depth);
    }
    std::sort(thresholds_.begin(), thresholds_.end());
    for (size_t s = 0; s < sources_.size(); ++s) {
      SourceComparison& source = result.sources.emplace_back();
      source.name = sources_[s].name;
      source.spec = sources_[s].spec;
      source.interpretation = sources_[s].interpretation;
      source.is_truth = options_.truth == s;
      source.by_distance = curves.by_distance;
      source.by_incidence = curves.by_incidence;
      source.by_edge_distance = curves.by_edge_distance;
    }
    if (options_.truth && sources_[*options_.truth].mesh != nullptr) {
      const ComparedSource& truth = sources_[*options_.truth];
      surfaces_ = std::make_unique<SurfaceScorer>(*truth.mesh, *truth.source, views_,
                                                  sources_.size(), thresholds_, options_.threads);
    }
    CompareImages(curves, result);
    for (size_t s = 0; s < sources_.size(); ++s) {
      MeasureByMatches(*sources_[s].source, result.sources[s]);
      FinishConsistency(result.sources[s]);
      if (surfaces_ && s != *options_.truth) result.sources[s].surface = surfaces_->Score(s);
    }
    for (size_t s = 0; s < sources_.size(); ++s) {
      Judge(options_.truth.has_value(), result.sources[s]);
      if (options_.truth && s != *options_.truth) Explain(*sources_[s].source, result.sources[s]);
      if (options_.on_judged) options_.on_judged();
    }
    return result;
  }

 private:
  int Stride(const PosedImage& image) const {
    return ComparedStride(image.camera, options_.max_side_px);
  }

  // A match off the epipolar line is wrong whatever the geometry.
  bool FitsPoses(const ReferenceMatch& match) const {
    constexpr double kMaxSampsonPx = 3;
    const PosedImage& a = images_[static_cast<size_t>(match.reference_a)];
    const PosedImage& b = images_[static_cast<size_t>(match.reference_b)];
    const auto error = SampsonError(a.camera, a.cam_from_world, match.a_px, b.camera,
                                    b.cam_from_world, match.b_px);
    return error && std::abs(error->error_px) <= kMaxSampsonPx;
  }

  // Returns depths of the truth (else of the first source), sorted.
  std::vector<double> SampleDepths() const {
    constexpr int kPixels = 64;
    const GeometrySource& source = *sources_[options_.truth.value_or(0)].source;
    std::vector<std::vector<double>> depths(images_.size());
    ParallelFor(images_.size(), options_.threads, [&](size_t i) {
      for (const auto& point : source.Lift(images_[i], GridPixels(images_[i].camera, kPixels))) {
        if (point && point->depth_z > 0) depths[i].push_back(point->depth_z);
      }
    });
    std::vector<double> all;
    for (const auto& part : depths) all.insert(all.end(), part.begin(), part.end());
    std::sort(all.begin(), all.end());
    return all;
  }

  // Works in batches: images are compared in parallel and added in order.
  void CompareImages(const ImageCurves& curves, DepthComparison& result) {
    const size_t batch = 4 * static_cast<size_t>(ResolveThreads(options_.threads));
    for (size_t begin = 0; begin < images_.size(); begin += batch) {
      const size_t count = std::min(batch, images_.size() - begin);
      std::vector<ImageResults> found(count);
      ParallelFor(count, options_.threads, [&](size_t k) {
        found[k] = CompareOne(begin + k, result.overlaps[begin + k], curves);
      });
      for (ImageResults& image : found) {
        for (size_t s = 0; s < sources_.size(); ++s) {
          SourceComparison& source = result.sources[s];
          source.images.push_back(std::move(image.of_source[s]));
          source.by_distance.Add(image.curves[s].by_distance);
          source.by_incidence.Add(image.curves[s].by_incidence);
          source.by_edge_distance.Add(image.curves[s].by_edge_distance);
        }
        if (surfaces_) surfaces_->Add(image.points_of_source, *options_.truth);
      }
    }
  }

  ImageResults CompareOne(size_t image, std::span<const size_t> overlaps,
                          const ImageCurves& curves) const {
    std::vector<SourceView> views;
    for (const ComparedSource& source : sources_) {
      views.push_back(LookThrough(*source.source, images_[image], Stride(images_[image])));
    }
    if (options_.on_views) options_.on_views(image, views_[image], views);
    ImageResults results =
        CompareImage(sources_, views_[image], views, options_.truth, options_.range, curves);
    for (size_t s = 0; s < sources_.size(); ++s) {
      results.of_source[s].consistency =
          MeasureConsistency(*sources_[s].source, images_, image, overlaps);
      if (options_.on_progress) options_.on_progress();
    }
    return results;
  }

  void MeasureByMatches(const GeometrySource& geometry, SourceComparison& source) const {
    if (matches_.empty()) return;
    const auto errors = MeasureMatches(geometry, images_, matches_, options_.threads);
    const MatchScales scales = ScalesByMatches(geometry, images_, matches_, options_.threads);
    std::vector<const LiftedMatchErrors*> all;
    for (size_t i = 0; i < images_.size(); ++i) {
      const LiftedMatchErrors* one = &errors[i];
      source.images[i].matches = SummarizeMatches({&one, 1});
      source.images[i].match_log_scale = scales.log_scales[i];
      all.push_back(one);
    }
    source.matches = SummarizeMatches(all);
    source.match_warp_sigma = scales.warp_sigma;
  }

  void FinishConsistency(SourceComparison& source) const {
    std::vector<ImageConsistency> consistency;
    for (const ImageComparison& image : source.images) consistency.push_back(image.consistency);
    const auto scales = RelativeLogScales(consistency);
    for (size_t i = 0; i < source.images.size(); ++i) {
      source.images[i].relative_log_scale = scales[i];
    }
    source.common_log_scale = CommonLogScale(consistency);
  }

  void Explain(const GeometrySource& geometry, SourceComparison& source) const {
    const GeometrySource& truth = *sources_[*options_.truth].source;
    source.explanation =
        ExplainDepthErrors(ViewsToExplain(geometry, truth, images_, options_.threads),
                           source.traits.noise_sigma.value_or(0), options_.threads);
    if (source.explanation) AddExplanation(*source.explanation, source.findings);
  }

  std::span<const ComparedSource> sources_;
  std::span<const PosedImage> images_;
  std::vector<ReferenceMatch> matches_;
  const DepthComparisonOptions& options_;
  std::vector<PosedImage> views_;
  std::vector<double> thresholds_;
  std::unique_ptr<SurfaceScorer> surfaces_;  // null where no mesh is the truth
};

}  // namespace

std::vector<ComparedSource> ComparedSourcesOf(const Scene& scene) {
  std::vector<ComparedSource> sources;
  for (const SceneSource& source : scene.sources) {
    const NamedGeometry& geometry = source.geometry;
    sources.push_back({.name = source.name,
                       .spec = source.spec,
                       .interpretation = geometry.interpretation,
                       .source = geometry.source,
                       .mesh = geometry.mesh ? std::shared_ptr<const TriangleMesh>(
                                                   geometry.mesh, &geometry.mesh->mesh())
                                             : nullptr});
  }
  return sources;
}

int ComparedStride(const Camera& camera, int max_side_px) {
  RAYLIFT_CHECK(max_side_px > 0);
  return (std::max(camera.width_px(), camera.height_px()) + max_side_px - 1) / max_side_px;
}

DepthComparison CompareDepth(std::span<const ComparedSource> sources,
                             std::span<const PosedImage> images,
                             std::span<const ReferenceMatch> matches,
                             const DepthComparisonOptions& options) {
  return Comparer(sources, images, matches, options).Run();
}

std::optional<double> MeanOverImages(const SourceComparison& source, const ValueOfImage& value) {
  const auto values = Collect(source, value);
  if (values.empty()) return std::nullopt;
  double sum = 0;
  for (const double v : values) sum += v;
  return sum / static_cast<double>(values.size());
}

}  // namespace raylift
