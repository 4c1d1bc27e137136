// The options that say where matches come from: hloc's files, or the built-in front end with any
// kind of retrieval.

#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "front_end_options.h"
#include "options.h"
#include "retrieval_options.h"
#include "scene_options.h"
#include <CLI/App.hpp>

#include "raylift/localization/matching.h"

namespace raylift {

struct MatchingFlags {
  HlocFlags hloc;
  RetrievalFlags retrieval;
  FrontEndFlags front_end;

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
// `without_hloc` ends the help of --features, `default_cache` that of --cache.
void AddMatchingOptions(CLI::App& app, MatchingFlags& flags, const std::string& without_hloc,
                        const std::string& default_cache);

}  // namespace raylift
