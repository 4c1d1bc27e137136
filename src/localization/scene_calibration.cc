#include "raylift/localization/scene_calibration.h"

#include <algorithm>
#include <set>
#include <utility>

#include "localization/calibration_images.h"
#include "localization/results/result_json.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/parallel.h"

namespace raylift {
namespace {

AlignMode AlignModeOf(const Scene& scene, const CalibrationOptions& options) {
  const LocalizerOptions& localizer = options.localizer;
  if (options.align != AlignMode::kAuto) return options.align;
  const bool is_of_use = Uses2D3D(localizer.estimator.method) &&
                         localizer.estimator.refinement == Refinement::kRobust &&
                         localizer.candidates.mode != CandidateMode::kTriangulate &&
                         scene.rendered == nullptr && !scene.sources.empty();
  return is_of_use ? AlignMode::kAuto : AlignMode::kOff;
}

std::vector<std::optional<DepthAlignment>> AlignSources(const Scene& scene, AlignMode mode,
                                                        std::span<const ReferenceMatch> matches,
                                                        int threads) {
  std::vector<std::optional<DepthAlignment>> alignments(scene.sources.size());
  for (size_t i = 0; i < scene.sources.size(); ++i) {
    const NamedGeometry& geometry = scene.sources[i].geometry;
    if (geometry.kind == GeometryKind::kSfm) continue;
    alignments[i] = AlignDepth(*geometry.source, scene.references.images, matches, mode, threads);
  }
  return alignments;
}

// Returns what the confidences of each source are worth, nullopt for a source that has none. The
// list is empty where no source has any.
std::vector<std::optional<ConfidenceWorth>> LearnConfidences(
    const Scene& scene, std::span<const std::optional<DepthAlignment>> alignments,
    std::span<const ReferenceMatch> matches, int threads) {
  std::vector<std::optional<ConfidenceWorth>> found(scene.sources.size());
  for (size_t i = 0; i < found.size(); ++i) {
    const NamedGeometry& geometry = scene.sources[i].geometry;
    if (geometry.maps == nullptr || !geometry.maps->HasConfidences()) continue;
    found[i] =
        LearnConfidence(*geometry.source, *geometry.maps, alignments[i].value_or(DepthAlignment()),
                        scene.references.images, matches, threads);
  }
  const bool any = std::any_of(found.begin(), found.end(), [](const auto& of) { return !!of; });
  return any ? found : std::vector<std::optional<ConfidenceWorth>>();
}

std::optional<SceneNoise> LearnMatchNoise(const CalibrationImages& images, const Scene& scene,
                                          const CalibrationOptions& options) {
  const bool is_of_use =
      UsesSceneNoise(options.localizer.estimator) && !options.localizer.estimator.scene_noise &&
      TellsNoise(images, scene) &&
      (images.by == CalibratedBy::kReferences || options.queries_tell_match_noise);
  const std::vector<size_t> sample = NoiseSample(images.images);
  if (!is_of_use || sample.size() < kLeastForCommonNoise) return std::nullopt;
  const Localizer localizer(std::make_shared<const Scene>(scene), images.matches,
                            options.localizer);
  std::vector<PoseEstimate> estimates(sample.size());
  ParallelFor(sample.size(), options.threads, [&](size_t i) {
    estimates[i] = localizer.Localize(images.images[sample[i]]).localized.estimate;
  });
  return CommonNoise(estimates);
}

}  // namespace

Scene Calibrate(const Scene& scene, const std::shared_ptr<const MatchSource>& matches,
                std::span<const Query> queries, const CalibrationOptions& options) {
  if (scene.calibration != nullptr) return scene;
  const bool are_cached = std::dynamic_pointer_cast<const CachedMatches>(matches) != nullptr;
  const CalibrationImages images = ImagesToCalibrateBy(
      scene.references, are_cached ? matches : std::make_shared<const CachedMatches>(matches),
      queries);
  SceneCalibration found{.by = images.by};
  if (const AlignMode mode = AlignModeOf(scene, options); mode != AlignMode::kOff) {
    constexpr size_t kImagesOfAuto = 500;
    std::vector<Query> asked;
    const size_t most = mode == AlignMode::kAuto ? kImagesOfAuto : images.images.size();
    for (const size_t i : SampleByName(images.images, most)) asked.push_back(images.images[i]);
    const std::vector<ReferenceMatch> among_references =
        CollectReferenceMatches(asked, *images.matches, scene.references, options.threads);
    found.depth = AlignSources(scene, mode, among_references, options.threads);
    found.confidences = LearnConfidences(scene, found.depth, among_references, options.threads);
  }
  const bool by_queries = options.noise_by == CalibratedBy::kQueries && !queries.empty();
  const CalibrationImages tell_noise =
      by_queries ? CalibrationImages{.by = CalibratedBy::kQueries,
                                     .images = {queries.begin(), queries.end()},
                                     .matches = matches}
                 : images;
  found.by = tell_noise.by;
  // Each step goes on with the scene as far as it is known.
  const auto so_far = [&] {
    return Calibrated(scene, std::make_shared<const SceneCalibration>(found));
  };
  LocalizerOptions filtering = options.localizer;
  if (options.any_filter) filtering.filter.mode = FilterMode::kAuto;
  found.geometry_noise = LearnGeometryNoise(tell_noise, so_far(), filtering, options.threads);
  found.match_noise = LearnMatchNoise(tell_noise, so_far(), options);
  return so_far();
}

Scene Calibrated(const Scene& scene, std::shared_ptr<const SceneCalibration> calibration) {
  RAYLIFT_CHECK(calibration != nullptr);
  const auto& depth = calibration->depth;
  for (const size_t count : {depth.size(), calibration->confidences.size()}) {
    if (count == 0 || count == scene.sources.size()) continue;
    throw InputError(
        fmt::format("the calibration is of a scene with {} sources of geometry, found {}", count,
                    scene.sources.size()));
  }
  std::set<std::string> names;
  for (const PosedImage& image : scene.references.images) names.insert(image.name);
  Scene calibrated = scene;
  for (size_t i = 0; i < depth.size(); ++i) {
    SceneSource& source = calibrated.sources[i];
    source.alignment = depth[i];
    if (!depth[i]) continue;
    if (depth[i]->mode == AlignMode::kOff) {
      if (source.as_read != nullptr) source.geometry.source = source.as_read;
      continue;
    }
    const auto corrections = depth[i]->Corrections();
    if (std::none_of(corrections.begin(), corrections.end(),
                     [&](const auto& correction) { return names.contains(correction.first); })) {
      throw InputError("the calibration corrects the depth of none of the scene's references");
    }
    if (source.as_read == nullptr) source.as_read = source.geometry.source;
    source.geometry.source = std::make_shared<const AlignedSource>(source.as_read, corrections);
  }
  for (size_t i = 0; i < calibration->confidences.size(); ++i) {
    const auto& worth = calibration->confidences[i];
    if (!worth || !worth->tells()) continue;
    NamedGeometry& geometry = calibrated.sources[i].geometry;
    if (geometry.maps == nullptr || !geometry.maps->HasConfidences()) {
      throw InputError(fmt::format("the calibration weighs confidences that {} does not have",
                                   calibrated.sources[i].spec));
    }
    if (calibrated.sources[i].as_read == nullptr) calibrated.sources[i].as_read = geometry.source;
    geometry.source = std::make_shared<const WeighedSource>(geometry.source, geometry.maps, *worth);
  }
  calibrated.calibration = std::move(calibration);
  return calibrated;
}

Scene Aligned(const Scene& scene, AlignMode mode, std::span<const ReferenceMatch> matches,
              int threads) {
  if (mode == AlignMode::kOff) return scene;
  Scene aligned = Calibrated(scene, std::make_shared<const SceneCalibration>(SceneCalibration{
                                        .depth = AlignSources(scene, mode, matches, threads)}));
  aligned.calibration = scene.calibration;
  return aligned;
}

std::optional<ConfidenceWorth> ConfidencesOf(const Scene& scene, size_t source) {
  if (scene.calibration == nullptr) return std::nullopt;
  const auto& confidences = scene.calibration->confidences;
  return source < confidences.size() ? confidences[source] : std::nullopt;
}

std::string FormatSceneCalibration(const SceneCalibration& calibration) {
  return JsonText(ToJson(calibration));
}

SceneCalibration ParseSceneCalibration(const std::string& text) {
  try {
    return ParseJson<SceneCalibration>(text);
  } catch (const InputError& error) {
    throw InputError(fmt::format("no calibration of a scene: {}", error.what()));
  }
}

void WriteSceneCalibration(const std::filesystem::path& path, const SceneCalibration& calibration) {
  WriteFile(path, FormatSceneCalibration(calibration) + '\n');
}

std::shared_ptr<const SceneCalibration> ReadSceneCalibration(const std::filesystem::path& path) {
  const std::string text = ReadFile(path);
  try {
    return std::make_shared<const SceneCalibration>(ParseSceneCalibration(text));
  } catch (const InputError& error) {
    throw InputError(path, error.what());
  }
}

}  // namespace raylift
