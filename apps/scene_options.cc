#include "scene_options.h"

#include "options.h"

#include "raylift/base/error.h"

namespace raylift {

void ReferenceFlags::Check() const { RequireAtLeast(1, "--every", every); }

void AddReferenceOptions(CLI::App& app, ReferenceFlags& flags) {
  app.add_option("--model", flags.model, "References: COLMAP model folder, text or binary")
      ->required()
      ->group("References");
  app.add_option("--every", flags.every, "Use every N-th reference (by name)")
      ->capture_default_str()
      ->group("References");
}

bool HlocFlags::Any() const {
  return !files.features.empty() || !files.matches.empty() || !files.pairs.empty();
}

bool HlocFlags::All() const {
  return !files.features.empty() && !files.matches.empty() && !files.pairs.empty();
}

void HlocFlags::Check() const {
  RequireAtLeast(1, "--top-k", top_k);
  if (Any() && !All()) {
    throw OptionError("--features, --matches and --pairs go together: give all three or none");
  }
}

void AddHlocOptions(CLI::App& app, HlocFlags& flags, const std::string& without) {
  const std::string group = "Matches";
  app.add_option("--features", flags.files.features, "hloc's features.h5" + without)->group(group);
  app.add_option("--matches", flags.files.matches, "hloc's matches.h5")->group(group);
  app.add_option("--pairs", flags.files.pairs, "hloc's pairs list: query reference")->group(group);
  app.add_option("--top-k", flags.top_k, "Retrieved references per query")
      ->capture_default_str()
      ->group(group);
}

}  // namespace raylift
