// Walks over requests: what is known of one so far travels with its client as a signed token, so
// that any server with the same key goes on with it and none keeps anything.

#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

#include "raylift/sequences/smoothing.h"
#include "raylift/sequences/tracker.h"

namespace raylift {

// A client's walk in one scene.
struct ServedWalk {
  OdometryScale scale = OdometryScale::kKnown;
  WalkState state = {};
};

class WalkTokens {
 public:
  using Time = std::chrono::system_clock::time_point;

  // `key_file`: 32 bytes at least; empty: a random key, which no other process has. Throws
  // InputError where it has fewer.
  explicit WalkTokens(const std::filesystem::path& key_file);

  // Returns base64 of the walk and its HMAC-SHA-256, some 35 kB at most. `scene` tells apart what
  // the walk's poses are in.
  std::string Seal(ServedWalk walk, uint64_t scene, Time now) const;
  // Throws Problem for what this key has not signed (400), what is of another scene (409) and what
  // is more than an hour old or another version's (410).
  ServedWalk Open(std::string_view token, uint64_t scene, Time now) const;

 private:
  std::string Signature(std::string_view bytes) const;

  std::string key_;
};

}  // namespace raylift
