#include "raylift/localization/pair_matches.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "io/scene/pair_pixels.h"
#include "localization/file_matches.h"
#include "localization/pair_files.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/scene/keypoints.h"

namespace raylift {
namespace {

using std::filesystem::path;

// The matches of a query with one reference; pixels are COLMAP's.
struct QueryPair {
  std::vector<Eigen::Vector2d> query_px, reference_px;
};

bool Shows(const Camera& camera, const Eigen::Vector2d& pixel) {
  constexpr double kRoundingPx = 1;
  return pixel.x() >= -kRoundingPx && pixel.x() <= camera.width_px() + kRoundingPx &&
         pixel.y() >= -kRoundingPx && pixel.y() <= camera.height_px() + kRoundingPx;
}

// From here on float16 has steps of half a pixel and more.
bool IsCoarseInHalf(const Camera& camera) {
  constexpr int kCoarseHalfPx = 512;
  return std::max(camera.width_px(), camera.height_px()) > kCoarseHalfPx;
}

class PairMatches final : public MatchSource {
 public:
  PairMatches(PairFiles files, std::optional<RetrievalPairs> ranked, const ReferenceSet& references,
              int top_k, const JoiningQueries& joining, const MatchReading& reading)
      : files_(std::move(files)),
        ranked_(std::move(ranked)),
        references_(references, top_k, joining),
        reading_(reading) {
    for (const PosedImage& image : references.images) cameras_.emplace(image.name, image.camera);
    for (const Query& query : joining.queries) cameras_.emplace(query.name, query.camera);
  }

  QueryMatches Match(const Query& query) const override {
    const auto files = files_.Of(query.name);
    std::map<std::string, QueryPair> pairs;  // that were read to rank them
    const std::vector<std::string> names =
        ranked_ ? Ranked(query.name) : RankedByMatches(query, files, pairs);
    QueryMatches result{.references = references_.Take(query.name, names), .matches = {}};
    KeypointsByPixel query_keypoints;
    int next_keypoint = 0;
    for (size_t r = 0; r < result.references.size(); ++r) {
      const std::string& name = result.references[r].name;
      const auto file = files.find(name);
      if (file == files.end()) {
        warnings_.Add(fmt::format("{}: no matches of {} with {}", files_.folder().string(),
                                  query.name, name));
        continue;
      }
      const auto known = pairs.find(name);
      const QueryPair pair =
          known != pairs.end() ? std::move(known->second) : Read(query, name, file->second);
      KeypointsByPixel reference_keypoints;
      for (size_t i = 0; i < pair.query_px.size(); ++i) {
        const int keypoint = query_keypoints.FindOrAdd(PlaceOf(pair.query_px[i]), next_keypoint);
        next_keypoint = std::max(next_keypoint, keypoint + 1);
        result.matches.push_back({.reference = static_cast<int>(r),
                                  .query_px = pair.query_px[i],
                                  .reference_px = pair.reference_px[i],
                                  .query_keypoint = keypoint,
                                  .reference_keypoint = reference_keypoints.FindOrAdd(
                                      pair.reference_px[i], static_cast<int>(i))});
      }
    }
    return result;
  }

  void Join(const PosedImage& localized_query) override { references_.Join(localized_query); }
  std::vector<std::string> Warnings() const override { return warnings_.All(); }

 private:
  std::vector<std::string> Ranked(const std::string& query) const {
    const auto listed = ranked_->find(query);
    return listed == ranked_->end() ? std::vector<std::string>() : listed->second;
  }

  // Those with the most matches first.
  std::vector<std::string> RankedByMatches(const Query& query,
                                           const std::map<std::string, PairFile>& files,
                                           std::map<std::string, QueryPair>& pairs) const {
    std::vector<std::string> names;
    for (const auto& [name, file] : files) {
      if (!cameras_.contains(name) || name == query.name) continue;
      names.push_back(name);
      pairs.emplace(name, Read(query, name, file));
    }
    std::stable_sort(names.begin(), names.end(), [&](const auto& a, const auto& b) {
      return pairs.at(a).query_px.size() > pairs.at(b).query_px.size();
    });
    return names;
  }

  QueryPair Read(const Query& query, const std::string& reference, const PairFile& file) const {
    PairPixels pixels = ReadPairPixels(file.file);
    if (file.reference_first) std::swap(pixels.first_px, pixels.second_px);
    const Camera& reference_camera = cameras_.at(reference);
    if (pixels.is_half && (IsCoarseInHalf(query.camera) || IsCoarseInHalf(reference_camera))) {
      warnings_.Add(
          fmt::format("{}: pixels are float16, which rounds them to 0.5 px beyond 512 px "
                      "and to 1 px beyond 1024 px",
                      files_.folder().string()));
    }
    const Eigen::Vector2d shift = Eigen::Vector2d::Constant(0.5 - reading_.first_pixel);
    QueryPair pair;
    size_t outside = 0;
    for (size_t i = 0; i < pixels.first_px.size(); ++i) {
      const double score = pixels.scores.empty() ? 1 : pixels.scores[i];
      if (reading_.min_score && !(score >= *reading_.min_score)) continue;
      const Eigen::Vector2d query_px = pixels.first_px[i] + shift;
      const Eigen::Vector2d reference_px = pixels.second_px[i] + shift;
      if (!Shows(query.camera, query_px) || !Shows(reference_camera, reference_px)) {
        ++outside;
        continue;
      }
      pair.query_px.push_back(query_px);
      pair.reference_px.push_back(reference_px);
    }
    CheckOutside(query, reference, file.file, outside, pair.query_px.size());
    return pair;
  }

  // A matcher may see things in the margin that it put round an image, but not everything.
  void CheckOutside(const Query& query, const std::string& reference, const path& file,
                    size_t outside, size_t inside) const {
    if (outside == 0) return;
    if (outside > inside) {
      const Camera& camera = cameras_.at(reference);
      throw InputError(
          file,
          fmt::format("{} of {} matches lie outside of {} ({} x {}) or {} ({} x {}): are "
                      "their pixels those of resized images?",
                      outside, outside + inside, query.name, query.camera.width_px(),
                      query.camera.height_px(), reference, camera.width_px(), camera.height_px()));
    }
    warnings_.Add(
        fmt::format("{}: matches outside of their images are left out", files_.folder().string()));
  }

  // By which a keypoint is told from others.
  Eigen::Vector2d PlaceOf(const Eigen::Vector2d& query_px) const {
    if (reading_.cell_px == 0) return query_px;
    return (query_px / reading_.cell_px).array().floor();
  }

  PairFiles files_;
  std::optional<RetrievalPairs> ranked_;
  KnownReferences references_;
  MatchReading reading_;
  std::map<std::string, Camera> cameras_;  // of all that are or may become references
  WarningSet warnings_;
};

}  // namespace

std::unique_ptr<MatchSource> OpenPairMatches(const path& folder, const path& pairs,
                                             const ReferenceSet& references, int top_k,
                                             const JoiningQueries& joining,
                                             const MatchReading& reading) {
  Check(reading);
  std::set<std::string> names(references.thinned_out.begin(), references.thinned_out.end());
  for (const PosedImage& image : references.images) names.insert(image.name);
  for (const Query& query : joining.queries) names.insert(query.name);
  PairFiles files(folder, std::vector<std::string>(names.begin(), names.end()));
  std::optional<RetrievalPairs> ranked;
  if (!pairs.empty()) {
    ranked = ReadPairsInUse(pairs, references, joining);
  } else if (files.listed()) {
    ranked = PairsInUse(*files.listed(), files.ListFile(), references, joining);
  }
  return std::make_unique<PairMatches>(std::move(files), std::move(ranked), references, top_k,
                                       joining, reading);
}

}  // namespace raylift
