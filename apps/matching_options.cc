#include "matching_options.h"

#include "raylift/base/error.h"

namespace raylift {

void MatchingFlags::Check(const std::vector<std::string>& geometry,
                          RetrievalFlags::Queries queries) const {
  hloc.Check();
  front_end.Check();
  if (hloc.Any() && retrieval.Any()) {
    throw OptionError("--pairs", hloc.files.pairs.string(),
                      "names the references: no options of retrieval go with it");
  }
  const RetrievalOptions resolved = retrieval.Resolve(geometry, queries);
  if (resolved.method == RetrievalMethod::kCovisibility &&
      queries == RetrievalFlags::Queries::kOwn) {
    throw OptionError("--retrieval", "covisibility", "queries observe no points of the model");
  }
}

MatchingOptions MatchingFlags::Resolve(const std::vector<std::string>& geometry,
                                       const std::filesystem::path& query_images,
                                       const std::filesystem::path& default_cache, uint64_t seed,
                                       const RunFlags& run, RetrievalFlags::Queries queries) const {
  MatchingOptions matching{.top_k = hloc.top_k};
  if (hloc.All()) {
    matching.hloc = hloc.files;
    matching.reading = hloc.reading;
    return matching;
  }
  matching.front_end = front_end.Resolve(default_cache);
  matching.front_end.query_images = query_images;
  matching.front_end.among_references = queries == RetrievalFlags::Queries::kReferences;
  matching.front_end.seed = seed;
  matching.front_end.threads = run.threads;
  matching.front_end.show_progress = !run.quiet;
  matching.retrieval = retrieval.Resolve(geometry, queries);
  matching.retrieval->threads = run.threads;
  matching.retrieval->show_progress = !run.quiet;
  retrieval.ReadPriorPoses(&*matching.retrieval);
  return matching;
}

void AddMatchingOptions(CLI::App& app, MatchingFlags& flags, const std::string& without_hloc,
                        const std::string& default_cache) {
  AddHlocOptions(app, flags.hloc, without_hloc);
  AddRetrievalOptions(app, flags.retrieval);
  AddFrontEndOptions(app, flags.front_end, default_cache);
}

}  // namespace raylift
