#include "raylift/localization/hloc_matches.h"

#include <mutex>
#include <set>
#include <unordered_map>

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/io/hloc_features.h"
#include "raylift/io/hloc_matches.h"
#include "raylift/io/retrieval_pairs.h"
#include "raylift/scene/keypoints.h"

namespace raylift {
namespace {

class HlocMatches final : public MatchSource {
 public:
  HlocMatches(const HlocFiles& files, const ReferenceSet& references, int top_k,
              const JoiningQueries& joining)
      : files_(files),
        features_(files.features),
        matches_(files.matches),
        pairs_(ReadPairs(files.pairs)),
        top_k_(static_cast<size_t>(top_k)),
        max_joined_(static_cast<size_t>(joining.max_joined)) {
    for (const Query& query : joining.queries) joining_.insert(query.name);
    for (const PosedImage& image : references.images) {
      references_.emplace(image.name, image);
    }
    const std::set<std::string> thinned_out(references.thinned_out.begin(),
                                            references.thinned_out.end());
    for (auto& [query, retrieved] : pairs_) {
      for (const std::string& name : retrieved) {
        if (!references_.contains(name) && !thinned_out.contains(name) &&
            !joining_.contains(name)) {
          throw InputError(files.pairs, fmt::format("query {}", query),
                           fmt::format("the retrieved reference \"{}\" has no pose in the model {}",
                                       name, references.model.string()));
        }
      }
      std::erase_if(retrieved, [&](const std::string& name) {
        return thinned_out.contains(name) && !joining_.contains(name);
      });
    }
  }

  QueryMatches Match(const Query& query) const override {
    QueryMatches result;
    const auto retrieved = pairs_.find(query.name);
    if (retrieved == pairs_.end()) {
      return result;
    }
    const Keypoints query_keypoints = ReadKeypoints(query.name, query.camera);
    size_t num_joined = 0;
    for (const std::string& name : retrieved->second) {
      if (result.references.size() == top_k_) {
        break;
      }
      if (joining_.contains(name)) {
        if (name == query.name || !references_.contains(name) || num_joined == max_joined_) {
          continue;
        }
        ++num_joined;
      }
      const int reference = static_cast<int>(result.references.size());
      result.references.push_back(references_.at(name));
      const auto matches = matches_.Read(query.name, name);
      if (!matches) {
        Warn(
            fmt::format("{}: no matches of {} with {}", files_.matches.string(), query.name, name));
        continue;
      }
      const Keypoints reference_keypoints = ReadKeypoints(name, result.references.back().camera);
      for (const FeatureMatch& match : *matches) {
        CheckIndex(match.query_index, query_keypoints, query.name, query.name, name);
        CheckIndex(match.reference_index, reference_keypoints, name, query.name, name);
        const auto query_index = static_cast<size_t>(match.query_index);
        const auto reference_index = static_cast<size_t>(match.reference_index);
        result.matches.push_back(
            {.reference = reference,
             .query_px = query_keypoints.pixels[query_index],
             .reference_px = reference_keypoints.pixels[reference_index],
             .query_keypoint = query_keypoints.canonical[query_index],
             .reference_keypoint = reference_keypoints.canonical[reference_index]});
      }
    }
    return result;
  }

  void Join(const PosedImage& localized_query) override {
    RAYLIFT_CHECK(joining_.contains(localized_query.name));
    references_.insert_or_assign(localized_query.name, localized_query);
  }

  std::vector<std::string> Warnings() const override {
    std::vector<std::string> warnings = features_.Warnings();
    const std::lock_guard<std::mutex> lock(mutex_);
    warnings.insert(warnings.end(), warnings_.begin(), warnings_.end());
    return warnings;
  }

 private:
  struct Keypoints {
    std::vector<Eigen::Vector2d> pixels;
    std::vector<int> canonical;
  };

  Keypoints ReadKeypoints(const std::string& name, const Camera& camera) const {
    Features features = features_.Read(name);
    if (features.image_width_px > 0 && (features.image_width_px != camera.width_px() ||
                                        features.image_height_px != camera.height_px())) {
      Warn(fmt::format("{}: {} was {} x {} when its features were made, its camera is {} x {}",
                       files_.features.string(), name, features.image_width_px,
                       features.image_height_px, camera.width_px(), camera.height_px()));
    }
    std::vector<int> canonical = CanonicalKeypoints(features.keypoints_px);
    return {std::move(features.keypoints_px), std::move(canonical)};
  }

  void CheckIndex(int index, const Keypoints& keypoints, const std::string& image,
                  const std::string& query, const std::string& reference) const {
    if (index < 0 || static_cast<size_t>(index) >= keypoints.pixels.size()) {
      throw InputError(files_.matches, fmt::format("pair {} {}", query, reference),
                       fmt::format("keypoint {} of {} is out of range, there are {}", index, image,
                                   keypoints.pixels.size()));
    }
  }

  // Kept in order, so that the thread that met one first does not show.
  void Warn(std::string warning) const {
    const std::lock_guard<std::mutex> lock(mutex_);
    warnings_.insert(std::move(warning));
  }

  HlocFiles files_;
  FeatureFile features_;
  MatchFile matches_;
  RetrievalPairs pairs_;
  size_t top_k_;
  size_t max_joined_;
  std::set<std::string> joining_;
  std::unordered_map<std::string, PosedImage> references_;
  mutable std::mutex mutex_;
  mutable std::set<std::string> warnings_;
};

}  // namespace

std::unique_ptr<MatchSource> OpenHlocMatches(const HlocFiles& files, const ReferenceSet& references,
                                             int top_k, const JoiningQueries& joining) {
  return std::make_unique<HlocMatches>(files, references, top_k, joining);
}

}  // namespace raylift
