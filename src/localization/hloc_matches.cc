#include "raylift/localization/hloc_matches.h"

#include "localization/file_matches.h"

#include "raylift/io/hloc_files.h"

namespace raylift {
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
  return MakeFileMatches(std::move(opened), ReadPairsInUse(files.pairs, references, joining),
                         references, top_k, joining, reading);
}

}  // namespace raylift
