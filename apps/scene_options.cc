#include "scene_options.h"

#include "options.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/localization/matching.h"

namespace raylift {

void AddThinningOptions(CLI::App& app, Thinning& thinning, const std::string& of_what,
                        const std::string& group) {
  app.add_option("--every", thinning.every, "Use every N-th " + of_what)
      ->capture_default_str()
      ->group(group);
  app.add_option("--every-offset", thinning.offset, "The first of them, from 0 to N - 1")
      ->capture_default_str()
      ->group(group);
  app.add_flag("--every-per-camera", thinning.per_camera,
               "Every N-th of each camera, where cameras take turns")
      ->group(group);
}

void CheckThinning(const Thinning& thinning) {
  RequireAtLeast("--every", thinning.every, 1);
  RequireAtLeast("--every-offset", thinning.offset, 0);
  if (thinning.offset >= thinning.every) {
    throw OptionError("--every-offset", std::to_string(thinning.offset),
                      fmt::format("must be below --every, {}", thinning.every));
  }
}

void ReferenceFlags::Check() const { CheckThinning(thinning); }

void AddReferenceOptions(CLI::App& app, ReferenceFlags& flags) {
  app.add_option("--model", flags.model, "References: COLMAP model folder, text or binary")
      ->required()
      ->group("References");
  AddThinningOptions(app, flags.thinning, "reference (by name)", "References");
}

bool HlocFlags::Any() const {
  return !files.features.empty() || !files.matches.empty() || !files.pairs.empty();
}

bool HlocFlags::All() const {
  if (StandAlone(files.matches)) return files.features.empty();
  return !files.features.empty() && !files.matches.empty() && !files.pairs.empty();
}

void HlocFlags::Check() const {
  RequireAtLeast("--top-k", top_k, 1);
  if (Any() && !All()) {
    throw OptionError(
        "--features, --matches and --pairs go together: give all three or none (or COLMAP's "
        "database, or a folder of pairs, as --matches, with or without --pairs)");
  }
  if (reading.min_score && !Any()) {
    throw OptionError("--min-match-score", fmt::format("{}", *reading.min_score),
                      "needs --matches");
  }
  raylift::Check(reading);
  std::error_code ignored;
  if ((reading.first_pixel != 0 || reading.cell_px != 0) &&
      !std::filesystem::is_directory(files.matches, ignored)) {
    throw OptionError("--first-pixel and --cell-px go with a folder of pairs as --matches");
  }
}

void RequireWithoutHloc(const HlocFlags& flags, std::string_view options_are, bool are_given) {
  if (flags.Any() || are_given) return;
  throw OptionError(
      fmt::format("{} required where no --features, --matches and --pairs are given", options_are));
}

void AddHlocOptions(CLI::App& app, HlocFlags& flags, const std::string& without) {
  const std::string group = "Matches";
  app.add_option("--features", flags.files.features, "hloc's features.h5" + without)->group(group);
  app.add_option("--matches", flags.files.matches,
                 "hloc's matches.h5; or COLMAP's database.db, or a folder of a file\n"
                 "of each pair, QUERY__REFERENCE.npz or .npy (N x 4 pixels, or\n"
                 "mkpts0, mkpts1; also scores), which need no --features and no --pairs")
      ->group(group);
  app.add_option("--pairs", flags.files.pairs, "hloc's pairs list: query reference")->group(group);
  app.add_option("--min-match-score", flags.reading.min_score,
                 "Leave out matches in files whose score is lower")
      ->group(group);
  app.add_option("--first-pixel", flags.reading.first_pixel,
                 "Of a folder of pairs: where its matcher puts the center of the first\n"
                 "pixel, 0 (most) or 0.5 (COLMAP, RoMa)")
      ->capture_default_str()
      ->group(group);
  app.add_option("--cell-px", flags.reading.cell_px,
                 "Of a folder of pairs: query pixels in one cell of so many pixels are\n"
                 "one keypoint, as dense matchers find others in each pair; 0: equal\n"
                 "pixels alone")
      ->capture_default_str()
      ->group(group);
  app.add_option("--top-k", flags.top_k, "Retrieved references per query")
      ->capture_default_str()
      ->group(group);
}

}  // namespace raylift
