// What a machine has too little of: threads that cannot be started (memory is std::bad_alloc's).
// Neither input nor options are to blame, and the same call may well succeed later.

#pragma once

#include <stdexcept>

namespace raylift {

class ResourceError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace raylift
