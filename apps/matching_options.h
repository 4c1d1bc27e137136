// The options that say where matches come from: hloc's files, or the built-in front end with any
// kind of retrieval.

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

  // Any of the three files is named; all that are needed.
  bool Any() const;
  bool All() const;
  // The three files go together, but a database or a folder of pairs stands alone. Throws
  // OptionError.
  void Check() const;
};
// What must be given where hloc's files are not: `options_are` says so ("--images is"). Throws
// OptionError.
void RequireWithoutHloc(const HlocFlags& flags, std::string_view options_are, bool are_given);

struct RetrievalFlags {
  std::optional<RetrievalMethod> method;
  GlobalFeatureFiles global_features;
  std::filesystem::path prior_poses;
  double max_angle_deg = 30;
  std::vector<double> view_range;

  // Any of the options is given, but for the angle, which has a default.
  bool Any() const;
  // Throws OptionError.
  void CheckAngle() const;
  // Whose poses queries have.
  enum class Queries { kOwn, kReferences };
  // What can be told without reading anything: all but poses, mesh and model. `geometry` are the
  // specifications of --geometry. Throws OptionError.
  RetrievalOptions Resolve(const std::vector<std::string>& geometry, Queries queries) const;
  // Reads the queries' prior poses where the method wants them.
  void ReadPriorPoses(RetrievalOptions* options) const;
};
void AddRetrievalOptions(CLI::App& command, RetrievalFlags& flags);

struct MatchingFlags {
  HlocFlags hloc;
  RetrievalFlags retrieval;
  FrontEndOptions front_end;  // features, ratio test, cache

  // What the options alone can tell, before any work; `geometry` are specifications. Throws
  // OptionError.
  void Check(const std::vector<std::string>& geometry,
             RetrievalFlags::Queries queries = RetrievalFlags::Queries::kOwn) const;
  // Reads prior poses where the retrieval wants them.
  MatchingOptions Resolve(const std::vector<std::string>& geometry,
                          const std::filesystem::path& query_images,
                          const std::filesystem::path& default_cache, uint64_t seed,
                          const RunFlags& run,
                          RetrievalFlags::Queries queries = RetrievalFlags::Queries::kOwn) const;
};
// Opens the matches of a scene's queries, or of its references with each other, keeping nothing.
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
