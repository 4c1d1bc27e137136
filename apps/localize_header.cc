#include "apps/localize_header.h"

#include "apps/job_options.h"
#include <nlohmann/json.hpp>

namespace raylift {

std::string LocalizeHeader(const LocalizeFlags& flags, const std::string& options_json,
                           const Scene& scene, std::span<const Query> queries) {
  auto options = nlohmann::ordered_json::parse(options_json);
  // Where problems are written changes nothing, but that they are must hold for all queries.
  options["write-problems"] = !flags.write_problems.empty();
  return JobHeader(std::move(options), queries.size(),
                   {"scene", "model", "images", "queries", "priors", "rigs", "query-images",
                    "features", "matches", "pairs", "cache", "prior-poses", "global-features",
                    "report", "query-global-features", "write-model"},
                   InputsJson({.model = flags.references.model,
                               .images = flags.images,
                               .query_images = flags.QueryImages(),
                               .out = flags.out,
                               .matching = flags.matching,
                               .threads = flags.run.threads},
                              scene, queries));
}

}  // namespace raylift
