// A source of the 2D-2D matches of queries: files of hloc, COLMAP or other matchers, the built-in
// front end, or anything else that implements MatchSource.

#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "raylift/base/enum_names.h"
#include "raylift/features/local_features.h"
#include "raylift/scene/features.h"
#include "raylift/scene/image.h"
#include "raylift/scene/photographs.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

class Covisibility;
class RayCaster;
struct ReferenceSet;
struct Scene;
struct Shard;

struct QueryMatches {
  std::vector<PosedImage> references;  // the retrieved ones, best first
  std::vector<Match2D2D> matches;      // `reference` counts in `references`
  // PoseProblem::search_area_px2.
  std::optional<double> search_area_px2 = std::nullopt;
};

// Returns where in a query the keypoints of a reference are to be looked for; nullopt where nothing
// tells.
using SearchRegions = std::function<std::vector<std::optional<SearchRegion>>(
    const PosedImage& reference, std::span<const Eigen::Vector2d> keypoints_px)>;

class MatchSource {
 public:
  virtual ~MatchSource() = default;

  // Returns the matches of a query that the source knows by its name. Thread safe.
  virtual QueryMatches Match(const Query& query) const = 0;

  // Returns the matches of a photograph in memory, or of features that were extracted from it.
  // Thread safe. Throws InputError where the source cannot match them: only the front end can.
  virtual QueryMatches MatchPhotograph(const Query& query, const Image& photograph) const;
  virtual QueryMatches MatchFeatures(const Query& query, const Features& features) const;

  // Returns the matches of such a query with these references of the scene, best first, where they
  // are to be expected; by default those of Match(), which has retrieved others. Thread safe.
  virtual QueryMatches MatchWithin(const SearchRegions& regions, const Query& query,
                                   std::span<const PosedImage> references) const;

  // Return whether the references can be matched with each other, and the matches of one of them,
  // as a query, with the others. Thread safe.
  virtual bool MatchesReferences() const { return false; }
  virtual QueryMatches MatchReference(const Query& reference) const;

  // Makes this localized query a reference, too. Must not be called while matches are made, and
  // only for sources that were opened for it.
  virtual void Join(const PosedImage& localized_query);

  // Returns warnings for the user, collected so far.
  virtual std::vector<std::string> Warnings() const = 0;
};

// Options for matches that are pixels or stand in files.
struct MatchReading {
  // Matches of a lower score are left out; matches without scores count as 1, as in hloc.
  std::optional<double> min_score = std::nullopt;
  // For pixels that are no features' (a folder of pairs, a custom matcher): where the matcher puts
  // the center of the first pixel, between 0 and 1, and the side of the cells in which query pixels
  // are one keypoint; 0: only equal pixels are.
  double first_pixel = 0;
  double cell_px = 0;
};
// Throws OptionError for a value out of its range.
void Check(const MatchReading& reading);

// A photograph as it is given to a custom matcher.
struct Photograph {
  std::string name;
  std::filesystem::path file;
  const Image* pixels = nullptr;  // null: they are in the file
};

// Matched pixels of a query and a reference, row by row.
struct PixelMatches {
  std::vector<Eigen::Vector2d> query_px, reference_px;
  std::vector<double> scores;  // empty: each counts as 1
};

// Matches a query with each of the references and returns as many PixelMatches, in their order. It
// is called from several threads, and its result must depend on the photographs alone.
using PhotographMatcher = std::function<std::vector<PixelMatches>(
    const Photograph& query, std::span<const Photograph> references)>;

// Extracts features from a photograph, gray or RGB; it is called from several threads. The caller
// sets the image's size.
using FeatureExtractor = std::function<Features(const Image& photograph)>;

// Describes a photograph (RGB) by a vector of unit length, by which photographs of one place are
// found; it is called from several threads.
using GlobalDescriptor = std::function<Eigen::VectorXf(const Image& photograph)>;

// The built-in front end: RootSIFT features, retrieval by VLAD unless it is given, and mutual
// nearest neighbors, all from the photographs alone.

struct FrontEndOptions {
  std::filesystem::path reference_images = {};
  std::filesystem::path query_images = {};
  // This is the folder in which features and retrieval are kept in hloc's layout and reused where
  // nothing changed; features are then read when they are matched. Where it is empty, nothing is
  // kept, and all are in memory.
  std::filesystem::path cache = {};
  // Features that are known already, by image name. These photographs are not read.
  std::map<std::string, Features> features = {};
  int top_k = 10;
  int max_features = 4096;
  double max_ratio = 0.8;
  // Replaces RootSIFT, for retrieval and matching; `extractor_name` tells its features in the cache
  // from those of others.
  FeatureExtractor extractor = nullptr;
  std::string extractor_name = {};
  // Replaces mutual nearest neighbors: it matches the retrieved references, and `reading` says how
  // its pixels are taken. A matcher that keeps its matches in the cache does so by `matcher_name`.
  PhotographMatcher matcher = nullptr;
  std::string matcher_name = {};
  MatchReading reading = {};
  // Replaces VLAD, unless the references are given below; its vectors are not kept.
  GlobalDescriptor descriptor = nullptr;
  uint64_t seed = 0;
  int threads = 0;
  bool show_progress = false;
  // The references of each query where VLAD is not to retrieve them, and the warnings of that
  // retrieval.
  std::optional<RetrievedLists> retrieved = std::nullopt;
  std::vector<std::string> retrieval_warnings = {};
  // Queries may be references, which are matched with the others.
  bool among_references = false;
  // Up to so many queries that became references may be among the top_k; Match() itself then uses
  // `threads`. With nullopt no query becomes a reference.
  std::optional<int> max_joined = std::nullopt;
};

// Extracts the features of all images and retrieves references; Match() matches. Queries may also
// come one by one from memory, by MatchPhotograph() and MatchFeatures(), which retrieve references
// by VLAD. Throws InputError where an image is missing or does not have its camera's size.
std::unique_ptr<MatchSource> MakeFrontEndMatches(const FrontEndOptions& options,
                                                 const ReferenceSet& references,
                                                 const std::vector<Query>& queries);

// Counts of the images of a scene and its queries.
struct FeatureCount {
  size_t images = 0;
  size_t extracted = 0;  // now
  size_t missing = 0;    // not in the cache yet, as other shards have not ended
};

// Extracts the features of this shard's images to options.cache, where MakeFrontEndMatches() finds
// them. Features that were there stay. The shard that completes the features also computes,
// `for_vlad`, the vectors for retrieval.
FeatureCount PrepareFrontEnd(const FrontEndOptions& options, const ReferenceSet& references,
                             const std::vector<Query>& queries, const Shard& shard, bool for_vlad);

// Extracts the features of a photograph (gray or RGB) as MatchPhotograph() does, rounded as a cache
// would store them: a query gives the same bytes from memory as from disk.
Features ExtractFrontEndFeatures(const Image& photograph, int max_features);

// The ways to retrieve the references of a query before any matching.
enum class RetrievalMethod { kVlad, kGlobal, kPose, kOverlap, kCovisibility };
template <>
inline constexpr auto kEnumNames<RetrievalMethod> = std::to_array<EnumName<RetrievalMethod>>({
    {RetrievalMethod::kVlad, "vlad", "", "RootSIFT features are alike"},
    {RetrievalMethod::kGlobal, "global", "", "global descriptors of the images are alike"},
    {RetrievalMethod::kPose, "pose", "", "cameras look at the same part of space"},
    {RetrievalMethod::kOverlap, "overlap", "", "cameras see the same part of the mesh (by rays)"},
    {RetrievalMethod::kCovisibility, "covisibility", "",
     "images observe the same points of the model"},
});

struct GlobalFeatureFiles {
  std::filesystem::path references;
  std::filesystem::path queries;  // empty: in the same file
};

// Distances from the camera, scene units.
struct ViewRange {
  double near;
  double far;
};

struct RetrievalOptions {
  RetrievalMethod method = RetrievalMethod::kGlobal;
  int top_k = 10;
  // For kGlobal.
  GlobalFeatureFiles global_features = {};
  // kPose and kOverlap take the queries' cam_from_world from here; a query without one has no
  // references.
  std::map<std::string, Rigid3> prior_poses = {};
  // kPose without a range takes the nearest references whose optical axes differ by at most this.
  double max_angle_deg = 30;
  // kPose with a range takes the references that see most of what the query sees at these
  // distances.
  std::optional<ViewRange> view_range = std::nullopt;
  // For kOverlap.
  std::shared_ptr<const RayCaster> mesh = nullptr;
  // For kCovisibility.
  std::shared_ptr<const Covisibility> covisibility = nullptr;  // null: nothing is known of it
  int threads = 0;
  bool show_progress = false;  // on stderr
};

struct HlocFiles {
  std::filesystem::path features;
  std::filesystem::path matches;
  std::filesystem::path pairs;
};

// Queries that may become references by Join(), and how many of them may be among a query's
// references; none by default.
struct JoiningQueries {
  std::span<const Query> queries = {};
  int max_joined = 0;
};

// Opens the matches of a scene's queries from any source: hloc's files, COLMAP's database, a folder
// of pairs, or the built-in front end with any kind of retrieval.

struct MatchingOptions {
  // With nullopt the front end makes the matches. Where `matches` stand alone, no other files are
  // needed.
  std::optional<HlocFiles> hloc = std::nullopt;
  MatchReading reading = {};  // of matches in files
  int top_k = 10;             // references per query
  // Up to so many localized queries may be among the top_k references; with nullopt none joins
  // them.
  std::optional<int> max_joined = std::nullopt;

  // Options of the front end. Its top_k, max_joined and reference images are set from here and the
  // scene.
  FrontEndOptions front_end = {};
  // With nullopt references are retrieved by VLAD. top_k is set from here, the covisibility from
  // the scene, and so is the mesh of `overlap` unless one is given.
  std::optional<RetrievalOptions> retrieval = std::nullopt;
};

// Returns whether these matches need no features and no pairs: COLMAP's database, a folder of
// pairs.
bool StandAlone(const std::filesystem::path& matches);

// Opens the matches. Warnings of the retrieval are among those of the source.
std::unique_ptr<MatchSource> OpenMatches(const Scene& scene, std::span<const Query> queries,
                                         const MatchingOptions& options);

// Does in advance what OpenMatches() would: extracts the features of a shard's images and, after
// the last of them, computes the vectors for retrieval; does nothing where the matches are in
// files.
FeatureCount PrepareMatches(const Scene& scene, std::span<const Query> queries,
                            const MatchingOptions& options, const Shard& shard);

}  // namespace raylift
