#include "raylift/localization/database_matches.h"

#include <set>
#include <utility>

#include "io/colmap/colmap_database.h"
#include "localization/file_matches.h"
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
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

// Of every image.
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
  return MakeFileMatches(std::move(files), std::move(retrieved), references, top_k, joining);
}

}  // namespace raylift
