#include "front_end_options.h"

#include "options.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {

void FrontEndFlags::Check() const {
  RequireAtLeast("--max-features", max_features, 1);
  if (!(max_ratio > 0 && max_ratio <= 1)) {
    throw OptionError("--max-ratio", FormatDouble(max_ratio), "must be above 0 and at most 1");
  }
}

FrontEndOptions FrontEndFlags::Resolve(const std::filesystem::path& default_cache) const {
  FrontEndOptions options;
  options.cache = cache.empty() ? default_cache : cache;
  options.max_features = max_features;
  options.max_ratio = max_ratio;
  return options;
}

void AddFrontEndOptions(CLI::App& app, FrontEndFlags& flags, const std::string& default_cache) {
  const std::string group = "Matches";
  app.add_option("--max-features", flags.max_features, "RootSIFT features per image, the strongest")
      ->capture_default_str()
      ->group(group);
  app.add_option("--max-ratio", flags.max_ratio, "Ratio test of RootSIFT matches")
      ->capture_default_str()
      ->group(group);
  app.add_option("--cache", flags.cache,
                 fmt::format("Where RootSIFT features are kept (default: {})", default_cache))
      ->group(group);
}

}  // namespace raylift
