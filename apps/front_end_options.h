// The options of the built-in front end: matches that are made here.

#pragma once

#include <filesystem>
#include <string>

#include <CLI/App.hpp>

#include "raylift/localization/front_end.h"

namespace raylift {

struct FrontEndFlags {
  int max_features = 4096;
  double max_ratio = 0.8;
  std::filesystem::path cache;

  // Throws OptionError.
  void Check() const;
  // The default is used where no --cache is given.
  FrontEndOptions Resolve(const std::filesystem::path& default_cache) const;
};
// `default_cache` ends the help of --cache.
void AddFrontEndOptions(CLI::App& app, FrontEndFlags& flags, const std::string& default_cache);

}  // namespace raylift
