// A file that was there when a scene was opened.

#pragma once

#include "raylift/base/error.h"

namespace raylift {

// A file of an open scene that cannot be read any more, or not as it was. What a photograph's
// sender gave is not to blame.
class LostFile : public InputError {
 public:
  using InputError::InputError;
};

// Returns what `read` does, by which files of an open scene are read.
template <typename Read>
auto ReadOpened(const Read& read) {
  try {
    return read();
  } catch (const OutputError&) {
    throw;
  } catch (const InputError& error) {
    throw LostFile(error.what());
  }
}

}  // namespace raylift
