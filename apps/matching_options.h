// Options that say where matches come from: hloc's files, or the built-in front end with any kind
// of retrieval.

#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "apps/options.h"
#include "localization/matching/file_matches.h"
#include "localization/retrieval/retrieval.h"

#include "raylift/localization/match_source.h"
#include "raylift/localization/scene.h"

namespace raylift {

struct HlocFlags {
  HlocFiles files;
  MatchReading reading;
  int top_k = 10;

  // Any() returns whether any of the three files is named, All() whether all that are needed are.
  bool Any() const;
  bool All() const;
  // Throws OptionError unless the three files are given together, or a database or a folder of
  // pairs stands alone.
  void Check() const;
};
// Throws OptionError where neither hloc's files nor the options that replace them are given;
// `options_are` names the latter in the message ("--images is").
void RequireWithoutHloc(const HlocFlags& flags, std::string_view options_are, bool are_given);

struct RetrievalFlags {
  std::optional<RetrievalMethod> method;
  GlobalFeatureFiles global_features;
  std::filesystem::path prior_poses;
  double max_angle_deg = 30;
  std::vector<double> view_range;

  // Returns whether any of the options is given, but for the angle, which has a default.
  bool Any() const;
  // Throws OptionError.
  void CheckAngle() const;
  // The queries are photographs of their own, or the references themselves, matched with each
  // other.
  enum class Queries { kOwn, kReferences };
  // Returns what the options tell without reading anything: all but poses, mesh and model.
  // `geometry` holds the specifications of --geometry. Throws OptionError.
  RetrievalOptions Resolve(const std::vector<std::string>& geometry, Queries queries) const;
  // Reads the queries' prior poses where the method wants them.
  void ReadPriorPoses(RetrievalOptions* options) const;
};
void AddRetrievalOptions(CLI::App& command, RetrievalFlags& flags);

struct MatchingFlags {
  HlocFlags hloc;
  RetrievalFlags retrieval;
  FrontEndOptions front_end;  // features, ratio test, cache

  // Throws OptionError for what the options alone can tell, before any work; `geometry` holds
  // specifications.
  void Check(const std::vector<std::string>& geometry,
             RetrievalFlags::Queries queries = RetrievalFlags::Queries::kOwn) const;
  // Returns the options of matching; reads prior poses where the retrieval needs them.
  MatchingOptions Resolve(const std::vector<std::string>& geometry,
                          const std::filesystem::path& query_images,
                          const std::filesystem::path& default_cache, uint64_t seed,
                          const RunFlags& run,
                          RetrievalFlags::Queries queries = RetrievalFlags::Queries::kOwn) const;
};
// Opens the matches of a scene's queries, or of its references with each other; keeps features only
// where --cache is given.
std::unique_ptr<MatchSource> OpenMatchesBetween(const MatchingFlags& flags,
                                                const std::vector<std::string>& geometry,
                                                const std::filesystem::path& query_images,
                                                const RunFlags& run, const Scene& scene,
                                                const std::vector<Query>& queries,
                                                RetrievalFlags::Queries queries_are);
// `without_hloc` ends the help of --features, `default_cache` that of --cache.
void AddMatchingOptions(CLI::App& command, MatchingFlags& flags, const std::string& without_hloc,
                        const std::string& default_cache);

}  // namespace raylift
