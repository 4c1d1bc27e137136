#include "localization/file_matches.h"

#include <mutex>
#include <set>
#include <unordered_map>
#include <utility>

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/scene/keypoints.h"

namespace raylift {
namespace {

std::set<std::string> NamesOf(const JoiningQueries& joining) {
  std::set<std::string> names;
  for (const Query& query : joining.queries) names.insert(query.name);
  return names;
}

class FileMatches final : public MatchSource {
 public:
  FileMatches(std::unique_ptr<const MatchFiles> files, RetrievalPairs pairs,
              const ReferenceSet& references, int top_k, const JoiningQueries& joining)
      : files_(std::move(files)),
        pairs_(std::move(pairs)),
        top_k_(static_cast<size_t>(top_k)),
        max_joined_(static_cast<size_t>(joining.max_joined)),
        joining_(NamesOf(joining)) {
    for (const PosedImage& image : references.images) {
      references_.emplace(image.name, image);
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
      const auto matches = files_->ReadMatches(query.name, name);
      if (!matches) {
        Warn(fmt::format("{}: no matches of {} with {}", files_->matches_file().string(),
                         query.name, name));
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
    std::vector<std::string> warnings = files_->Warnings();
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
    Features features = files_->ReadFeatures(name);
    if (features.image_width_px > 0 && (features.image_width_px != camera.width_px() ||
                                        features.image_height_px != camera.height_px())) {
      Warn(fmt::format("{}: {} was {} x {} when its features were made, its camera is {} x {}",
                       files_->features_file().string(), name, features.image_width_px,
                       features.image_height_px, camera.width_px(), camera.height_px()));
    }
    std::vector<int> canonical = CanonicalKeypoints(features.keypoints_px);
    return {std::move(features.keypoints_px), std::move(canonical)};
  }

  void CheckIndex(int index, const Keypoints& keypoints, const std::string& image,
                  const std::string& query, const std::string& reference) const {
    if (index < 0 || static_cast<size_t>(index) >= keypoints.pixels.size()) {
      throw InputError(files_->matches_file(), fmt::format("pair {} {}", query, reference),
                       fmt::format("keypoint {} of {} is out of range, there are {}", index, image,
                                   keypoints.pixels.size()));
    }
  }

  // Kept in order, so that the thread that met one first does not show.
  void Warn(std::string warning) const {
    const std::lock_guard<std::mutex> lock(mutex_);
    warnings_.insert(std::move(warning));
  }

  std::unique_ptr<const MatchFiles> files_;
  RetrievalPairs pairs_;
  size_t top_k_;
  size_t max_joined_;
  std::set<std::string> joining_;
  std::unordered_map<std::string, PosedImage> references_;
  mutable std::mutex mutex_;
  mutable std::set<std::string> warnings_;
};

}  // namespace

std::unique_ptr<MatchSource> MakeFileMatches(std::unique_ptr<const MatchFiles> files,
                                             RetrievalPairs pairs, const ReferenceSet& references,
                                             int top_k, const JoiningQueries& joining) {
  return std::make_unique<FileMatches>(std::move(files), std::move(pairs), references, top_k,
                                       joining);
}

RetrievalPairs ReadPairsInUse(const std::filesystem::path& file, const ReferenceSet& references,
                              const JoiningQueries& joining) {
  RetrievalPairs pairs = ReadPairs(file);
  std::set<std::string> in_use;
  for (const PosedImage& image : references.images) in_use.insert(image.name);
  const std::set<std::string> joining_names = NamesOf(joining);
  const std::set<std::string> thinned_out(references.thinned_out.begin(),
                                          references.thinned_out.end());
  for (auto& [query, retrieved] : pairs) {
    for (const std::string& name : retrieved) {
      if (!in_use.contains(name) && !thinned_out.contains(name) && !joining_names.contains(name)) {
        throw InputError(file, fmt::format("query {}", query),
                         fmt::format("the retrieved reference \"{}\" has no pose in the model {}",
                                     name, references.model.string()));
      }
    }
    std::erase_if(retrieved, [&](const std::string& name) {
      return thinned_out.contains(name) && !joining_names.contains(name);
    });
  }
  return pairs;
}

}  // namespace raylift
