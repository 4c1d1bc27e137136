// Files written and read by h5py, which hloc uses, too.

#pragma once

#include <string>

#include "support/test_data.h"

#include "raylift/base/file.h"

namespace raylift {

// Runs a script in which np is numpy and f is the file, opened by h5py as hloc does; returns what
// it prints. `mode` is "r" or "w".
inline std::string RunH5py(const std::filesystem::path& file, const std::string& mode,
                           const std::string& script) {
  const auto script_path = file.parent_path() / "script.py";
  WriteFile(script_path, "import h5py as h5, numpy as np\nf = h5.File('" + file.string() + "', '" +
                             mode + "', libver='latest')\n" + script + "\nf.close()\n");
  return RunProgram("/usr/bin/python3 " + script_path.string());
}

}  // namespace raylift
