// The options that say what a scene is seen from: its references, and hloc's matches with them.

#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include <CLI/App.hpp>

#include "raylift/localization/hloc_matches.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// `--every` and what goes with it. `of_what` ends the help of --every.
void AddThinningOptions(CLI::App& app, Thinning& thinning, const std::string& of_what,
                        const std::string& group);
// Throws OptionError.
void CheckThinning(const Thinning& thinning);

struct ReferenceFlags {
  std::filesystem::path model;
  Thinning thinning;

  // Throws OptionError.
  void Check() const;
};
void AddReferenceOptions(CLI::App& app, ReferenceFlags& flags);

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
// `without` ends the help of --features: what a command does where it is not given.
void AddHlocOptions(CLI::App& app, HlocFlags& flags, const std::string& without = "");

}  // namespace raylift
