// Matches that stand in files, whosever they are: hloc's or COLMAP's. Private to localization.

#pragma once

#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include "raylift/io/hloc_files.h"
#include "raylift/localization/hloc_matches.h"
#include "raylift/localization/match_source.h"
#include "raylift/localization/references.h"
#include "raylift/scene/features.h"

namespace raylift {

// What the files hold of images and of pairs of them. Thread safe.
class MatchFiles {
 public:
  virtual ~MatchFiles() = default;

  // InputError where the image is not there.
  virtual Features ReadFeatures(const std::string& image) const = 0;
  // None where the pair is not there.
  virtual std::optional<std::vector<FeatureMatch>> ReadMatches(
      const std::string& query, const std::string& reference) const = 0;
  virtual std::vector<std::string> Warnings() const = 0;
  // For messages.
  virtual const std::filesystem::path& features_file() const = 0;
  virtual const std::filesystem::path& matches_file() const = 0;
};

// `pairs` holds references that are in use or joining queries, best first; `top_k` of those in use
// are taken.
std::unique_ptr<MatchSource> MakeFileMatches(std::unique_ptr<const MatchFiles> files,
                                             RetrievalPairs pairs, const ReferenceSet& references,
                                             int top_k, const JoiningQueries& joining,
                                             const MatchReading& reading = {});

// The references that a query may be matched with, and the queries among them that have joined.
class KnownReferences {
 public:
  KnownReferences(const ReferenceSet& references, int top_k, const JoiningQueries& joining);

  // The first `top_k` of the names, best first, that are references of this query by now.
  std::vector<PosedImage> Take(const std::string& query, std::span<const std::string> names) const;
  void Join(const PosedImage& localized_query);

 private:
  size_t top_k_, max_joined_;
  std::set<std::string> joining_;
  std::unordered_map<std::string, PosedImage> references_;
};

// Warnings of several threads, each once and in order, so that the thread that met one first does
// not show.
class WarningSet {
 public:
  void Add(std::string warning) const;
  std::vector<std::string> All() const;

 private:
  mutable std::mutex mutex_;
  mutable std::set<std::string> warnings_;
};

// A list of pairs without those that are thinned out. InputError where it names a reference that
// the model does not hold.
RetrievalPairs ReadPairsInUse(const std::filesystem::path& file, const ReferenceSet& references,
                              const JoiningQueries& joining);
// The same of a list that was read from there.
RetrievalPairs PairsInUse(RetrievalPairs pairs, const std::filesystem::path& file,
                          const ReferenceSet& references, const JoiningQueries& joining);

}  // namespace raylift
