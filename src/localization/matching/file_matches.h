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
#include "raylift/localization/match_source.h"
#include "raylift/localization/scene.h"
#include "raylift/scene/features.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// The references that a query may be matched with, and the queries among them that have joined.
class KnownReferences {
 public:
  KnownReferences(const ReferenceSet& references, int top_k, const JoiningQueries& joining);

  // Returns the first `top_k` of the names, best first, that are references of this query by now.
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

// Reads a list of pairs without those that are thinned out. Throws InputError where it names a
// reference that the model does not hold.
RetrievalPairs ReadPairsInUse(const std::filesystem::path& file, const ReferenceSet& references,
                              const JoiningQueries& joining);
// Returns the same of a list that was read from there.
RetrievalPairs PairsInUse(RetrievalPairs pairs, const std::filesystem::path& file,
                          const ReferenceSet& references, const JoiningQueries& joining);

// Reads hloc's files. The pairs file ranks the references of each query; `top_k` of those in use
// are taken. Throws InputError where it names a reference that the model does not hold. References
// that are joining queries stand in the files like others, and are passed over until they join.
std::unique_ptr<MatchSource> OpenHlocMatches(const HlocFiles& files, const ReferenceSet& references,
                                             int top_k, const JoiningQueries& joining = {},
                                             const MatchReading& reading = {});

// Matches that stand in COLMAP's database.

// Opens the matches of a database. Queries and references are images of the database by the names
// that they have elsewhere. Without a list of pairs, a query's references are those that it is
// matched with, most inliers first. Throws InputError where the database holds none of the
// references.
std::unique_ptr<MatchSource> OpenDatabaseMatches(const std::filesystem::path& database,
                                                 const std::filesystem::path& pairs,
                                                 const ReferenceSet& references, int top_k,
                                                 const JoiningQueries& joining = {});

// Matches that stand as pixels in a folder, a file of each pair (io/pair_pixels.h): of dense and
// learned matchers, whose pixels are no features of an image.
//
// Which pair a file is of: `pairs.txt` in the folder says so in lines `query reference FILE`, or
// the name does: QUERY__REFERENCE.npz, QUERY_REFERENCE_matches.npz (SuperGlue) or
// QUERY/REFERENCE.npz, where "/" within names may stand as "-" or "_" and extensions may be left
// out, or all folders of one of them. A file may be of the reference first.

// Opens the matches of a folder. `pairs` ranks the references of each query; without it `pairs.txt`
// in the folder does, or else the number of matches with each. Equal pixels of a query are one
// keypoint, in whatever pair they stand, or those in one cell (MatchReading). Warns of pixels
// outside of their image, as of resized images. Throws InputError where the folder holds no file of
// a pair with one of the references.
std::unique_ptr<MatchSource> OpenPairMatches(const std::filesystem::path& folder,
                                             const std::filesystem::path& pairs,
                                             const ReferenceSet& references, int top_k,
                                             const JoiningQueries& joining = {},
                                             const MatchReading& reading = {});

}  // namespace raylift
