#include "localization/matching/file_matches.h"

#include <algorithm>
#include <set>
#include <utility>

#include "io/colmap/colmap_database.h"
#include "localization/fields.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/io/hloc_files.h"
#include "raylift/scene/keypoints.h"

namespace raylift {

namespace {

// Reads what the files hold of images and of pairs of them. Thread safe.
class MatchFiles {
 public:
  virtual ~MatchFiles() = default;

  // Returns the features of an image. Throws InputError where the image is not there.
  virtual Features ReadFeatures(const std::string& image) const = 0;
  // Returns nullopt where the pair is not there.
  virtual std::optional<std::vector<FeatureMatch>> ReadMatches(
      const std::string& query, const std::string& reference) const = 0;
  virtual std::vector<std::string> Warnings() const = 0;
  // Return the paths of the files, for messages.
  virtual const std::filesystem::path& features_file() const = 0;
  virtual const std::filesystem::path& matches_file() const = 0;
};

std::set<std::string> NamesOf(const JoiningQueries& joining) {
  std::set<std::string> names;
  for (const Query& query : joining.queries) names.insert(query.name);
  return names;
}

class FileMatches final : public MatchSource {
 public:
  // `pairs` holds references that are in use or joining queries, best first; `top_k` of those in
  // use are taken.
  FileMatches(std::unique_ptr<const MatchFiles> files, RetrievalPairs pairs,
              const ReferenceSet& references, int top_k, const JoiningQueries& joining,
              const MatchReading& reading)
      : files_(std::move(files)),
        pairs_(std::move(pairs)),
        references_(references, top_k, joining),
        reading_(reading),
        lists_references_(!references.images.empty() &&
                          std::all_of(references.images.begin(), references.images.end(),
                                      [&](const PosedImage& reference) {
                                        return pairs_.contains(reference.name);
                                      })) {}

  QueryMatches Match(const Query& query) const override {
    QueryMatches result;
    const auto retrieved = pairs_.find(query.name);
    if (retrieved == pairs_.end()) {
      return result;
    }
    const Keypoints query_keypoints = ReadKeypoints(query.name, query.camera);
    result.references = references_.Take(query.name, retrieved->second);
    for (size_t r = 0; r < result.references.size(); ++r) {
      const std::string& name = result.references[r].name;
      const auto matches = files_->ReadMatches(query.name, name);
      if (!matches) {
        warnings_.Add(fmt::format("{}: no matches of {} with {}", files_->matches_file().string(),
                                  query.name, name));
        continue;
      }
      const Keypoints reference_keypoints = ReadKeypoints(name, result.references[r].camera);
      for (const FeatureMatch& match : *matches) {
        CheckIndex(match.query_index, query_keypoints, query.name, query.name, name);
        CheckIndex(match.reference_index, reference_keypoints, name, query.name, name);
        if (reading_.min_score && match.score < *reading_.min_score) continue;
        const auto query_index = static_cast<size_t>(match.query_index);
        const auto reference_index = static_cast<size_t>(match.reference_index);
        result.matches.push_back(
            {.reference = static_cast<int>(r),
             .query_px = query_keypoints.pixels[query_index],
             .reference_px = reference_keypoints.pixels[reference_index],
             .query_keypoint = query_keypoints.canonical[query_index],
             .reference_keypoint = reference_keypoints.canonical[reference_index]});
      }
    }
    return result;
  }

  bool MatchesReferences() const override { return lists_references_; }
  QueryMatches MatchReference(const Query& reference) const override { return Match(reference); }

  void Join(const PosedImage& localized_query) override { references_.Join(localized_query); }

  std::vector<std::string> Warnings() const override {
    std::vector<std::string> warnings = files_->Warnings();
    for (std::string& warning : warnings_.All()) warnings.push_back(std::move(warning));
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
      warnings_.Add(
          fmt::format("{}: {} was {} x {} when its features were made, its camera is {} x {}",
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

  std::unique_ptr<const MatchFiles> files_;
  RetrievalPairs pairs_;
  KnownReferences references_;
  MatchReading reading_;
  bool lists_references_;  // as queries, too
  WarningSet warnings_;
};

}  // namespace

std::vector<Field> FieldsOf(MatchReading& reading) {
  return {{"min_match_score", reading.min_score, "Leave out matches in files whose score is lower"},
          {"first_pixel",
           reading.first_pixel,
           "Of a folder of pairs: where its matcher puts the center of the first\n"
           "pixel, 0 (most) or 0.5 (COLMAP, RoMa)",
           {.says = "must lie between 0 and 1", .least = 0, .most = 1}},
          {"cell_px", reading.cell_px,
           "Of a folder of pairs: query pixels in one cell of so many pixels are\n"
           "one keypoint, as dense matchers find others in each pair; 0: equal\n"
           "pixels alone",
           kAtLeastZero}};
}

void Check(const MatchReading& reading) { CheckRanges(ConstFieldsOf(reading)); }

KnownReferences::KnownReferences(const ReferenceSet& references, int top_k,
                                 const JoiningQueries& joining)
    : top_k_(static_cast<size_t>(top_k)),
      max_joined_(static_cast<size_t>(joining.max_joined)),
      joining_(NamesOf(joining)) {
  for (const PosedImage& image : references.images) references_.emplace(image.name, image);
}

std::vector<PosedImage> KnownReferences::Take(const std::string& query,
                                              std::span<const std::string> names) const {
  std::vector<PosedImage> taken;
  size_t num_joined = 0;
  for (const std::string& name : names) {
    if (taken.size() == top_k_) break;
    if (joining_.contains(name)) {
      if (name == query || !references_.contains(name) || num_joined == max_joined_) continue;
      ++num_joined;
    }
    taken.push_back(references_.at(name));
  }
  return taken;
}

void KnownReferences::Join(const PosedImage& localized_query) {
  RAYLIFT_CHECK(joining_.contains(localized_query.name));
  references_.insert_or_assign(localized_query.name, localized_query);
}

void WarningSet::Add(std::string warning) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  warnings_.insert(std::move(warning));
}

std::vector<std::string> WarningSet::All() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return {warnings_.begin(), warnings_.end()};
}

RetrievalPairs ReadPairsInUse(const std::filesystem::path& file, const ReferenceSet& references,
                              const JoiningQueries& joining) {
  return PairsInUse(ReadPairs(file), file, references, joining);
}

RetrievalPairs PairsInUse(RetrievalPairs pairs, const std::filesystem::path& file,
                          const ReferenceSet& references, const JoiningQueries& joining) {
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

namespace {

class HlocMatchFiles final : public MatchFiles {
 public:
  explicit HlocMatchFiles(const HlocFiles& files)
      : files_(files), features_(files.features), matches_(files.matches) {}

  Features ReadFeatures(const std::string& image) const override { return features_.Read(image); }
  std::optional<std::vector<FeatureMatch>> ReadMatches(
      const std::string& query, const std::string& reference) const override {
    return matches_.Read(query, reference);
  }
  std::vector<std::string> Warnings() const override { return features_.Warnings(); }
  const std::filesystem::path& features_file() const override { return files_.features; }
  const std::filesystem::path& matches_file() const override { return files_.matches; }

 private:
  HlocFiles files_;
  FeatureFile features_;
  MatchFile matches_;
};

}  // namespace

std::unique_ptr<MatchSource> OpenHlocMatches(const HlocFiles& files, const ReferenceSet& references,
                                             int top_k, const JoiningQueries& joining,
                                             const MatchReading& reading) {
  auto opened = std::make_unique<const HlocMatchFiles>(files);
  return std::make_unique<FileMatches>(std::move(opened),
                                       ReadPairsInUse(files.pairs, references, joining), references,
                                       top_k, joining, reading);
}

namespace {

using std::filesystem::path;

class DatabaseFiles final : public MatchFiles {
 public:
  DatabaseFiles(path file, ColmapDatabase database)
      : file_(std::move(file)), database_(std::move(database)) {}

  Features ReadFeatures(const std::string& image) const override {
    return database_.ReadKeypoints(image);
  }
  std::optional<std::vector<FeatureMatch>> ReadMatches(
      const std::string& query, const std::string& reference) const override {
    return database_.ReadMatches(query, reference);
  }
  std::vector<std::string> Warnings() const override { return {}; }
  const path& features_file() const override { return file_; }
  const path& matches_file() const override { return file_; }

 private:
  path file_;
  ColmapDatabase database_;
};

// Returns for each image of the database the references in use that it is matched with.
RetrievalPairs PairsOf(const ColmapDatabase& database, const std::set<std::string>& in_use) {
  RetrievalPairs pairs;
  for (const std::string& image : database.ImageNames()) {
    std::vector<std::string> retrieved = database.MatchedWith(image);
    std::erase_if(retrieved, [&](const std::string& name) { return !in_use.contains(name); });
    if (!retrieved.empty()) pairs.emplace(image, std::move(retrieved));
  }
  return pairs;
}

}  // namespace

std::unique_ptr<MatchSource> OpenDatabaseMatches(const path& database, const path& pairs,
                                                 const ReferenceSet& references, int top_k,
                                                 const JoiningQueries& joining) {
  ColmapDatabase opened(database);
  std::set<std::string> in_use;
  for (const PosedImage& image : references.images) in_use.insert(image.name);
  size_t num_known = 0;
  for (const std::string& name : opened.ImageNames()) num_known += in_use.contains(name);
  if (num_known == 0) {
    throw InputError(database, fmt::format("holds none of the {} references, e.g. {}",
                                           in_use.size(), *in_use.begin()));
  }
  for (const Query& query : joining.queries) in_use.insert(query.name);
  RetrievalPairs retrieved =
      pairs.empty() ? PairsOf(opened, in_use) : ReadPairsInUse(pairs, references, joining);
  auto files = std::make_unique<const DatabaseFiles>(database, std::move(opened));
  return std::make_unique<FileMatches>(std::move(files), std::move(retrieved), references, top_k,
                                       joining, MatchReading());
}

}  // namespace raylift
