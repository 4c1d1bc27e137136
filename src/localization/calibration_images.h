// Chooses the images that a scene is calibrated by, with their matches, and computes what these
// tell of the references.

#pragma once

#include <cstddef>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include "raylift/lifting/depth_alignment.h"
#include "raylift/localization/localizer.h"
#include "raylift/localization/match_source.h"
#include "raylift/localization/scene.h"
#include "raylift/localization/scene_calibration.h"

namespace raylift {

// Keeps the first matches that a source is asked for, up to so much memory: a scene is calibrated
// by matches that are asked for again when their query is localized. Thread safe. The source must
// not be told of more references.
class CachedMatches final : public MatchSource {
 public:
  explicit CachedMatches(std::shared_ptr<const MatchSource> source,
                         size_t most_bytes = size_t{256} << 20);

  QueryMatches Match(const Query& query) const override;
  QueryMatches MatchPhotograph(const Query& query, const Image& photograph) const override;
  QueryMatches MatchFeatures(const Query& query, const Features& features) const override;
  QueryMatches MatchWithin(const SearchRegions& regions, const Query& query,
                           std::span<const PosedImage> references) const override {
    return source_->MatchWithin(regions, query, references);
  }
  bool MatchesReferences() const override { return source_->MatchesReferences(); }
  QueryMatches MatchReference(const Query& reference) const override;
  std::vector<std::string> Warnings() const override { return source_->Warnings(); }

 private:
  using ByName = std::unordered_map<std::string, QueryMatches>;

  QueryMatches Cached(const Query& query, ByName& known,
                      QueryMatches (MatchSource::*match)(const Query&) const) const;

  std::shared_ptr<const MatchSource> source_;
  size_t most_bytes_;
  mutable std::mutex mutex_;
  mutable size_t bytes_ = 0;
  mutable ByName of_query_, of_reference_;
};

struct CalibrationImages {
  CalibratedBy by = CalibratedBy::kReferences;
  std::vector<Query> images;
  std::shared_ptr<const MatchSource> matches;  // knows these images by their names
};

// Returns the references, where they are the queries or the source matches them with each other;
// else the queries. Depth and noise ask for the same matches, which the source should keep.
CalibrationImages ImagesToCalibrateBy(const ReferenceSet& references,
                                      const std::shared_ptr<const MatchSource>& matches,
                                      std::span<const Query> queries);

// Returns whether these images tell how noisy matches with photographs are: rendered references do
// not.
bool TellsNoise(const CalibrationImages& images, const Scene& scene);

std::vector<size_t> OrderByName(std::span<const Query> queries);

// Returns evenly spaced queries in the order of their names: the same ones whatever order they
// stand in.
std::vector<size_t> SampleByName(std::span<const Query> queries, size_t count);

// Returns the images that noise is learned from: some 30.
std::vector<size_t> NoiseSample(std::span<const Query> images);

// Returns the matches between references that the images' matches imply, on which depth alignment
// and the check of the input rest. An image that is itself a reference brings its own matches.
// Indices count in references.images; sorted, each match once, whatever the number of threads.
// References that have `enough` matches already take no more from later images, so that memory
// stays bounded.
std::vector<ReferenceMatch> CollectReferenceMatches(std::span<const Query> images,
                                                    const MatchSource& match_source,
                                                    const ReferenceSet& references, int threads,
                                                    size_t enough = 5000);

// Returns how noisy the scene's geometry is in the views of the images' sample; nullopt where the
// options do not use it (the filter is not automatic, or points are triangulated) and where no
// image tells, as rendered references do not.
std::optional<MultiViewNoise> LearnGeometryNoise(const CalibrationImages& images,
                                                 const Scene& scene,
                                                 const LocalizerOptions& options, int threads);

}  // namespace raylift
