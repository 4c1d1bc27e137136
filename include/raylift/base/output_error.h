// An output that cannot be written: no space left, a folder that is read-only, a file in the way.
// The input is not to blame, and the same command may well succeed later. What base/file.h writes, and
// what manifests and HDF5 files are written by, throw it.

#pragma once

#include "raylift/base/error.h"

namespace raylift {

// An InputError too, for those who need not tell them apart.
class OutputError : public InputError {
 public:
  using InputError::InputError;
};

}  // namespace raylift
