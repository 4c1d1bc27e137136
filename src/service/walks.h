// Walks over requests: the state of a walk travels with its client as a signed token, so that any
// server with the same key goes on with it and none keeps anything.

#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

#include "service/localize_request.h"

#include "raylift/sequences/smoothing.h"
#include "raylift/sequences/tracker.h"
#include "raylift/service/server.h"

namespace raylift {

// A client's walk in one scene.
struct ServedWalk {
  OdometryScale scale = OdometryScale::kKnown;
  WalkState state = {};
};

class WalkTokens {
 public:
  using Time = std::chrono::system_clock::time_point;

  // `key_file` holds 32 bytes at least; where it is empty, the key is random, and no other process
  // has it. Throws InputError where the file has fewer.
  explicit WalkTokens(const std::filesystem::path& key_file);

  // Returns base64 of the walk and its HMAC-SHA-256, some 35 kB at most. `scene` identifies the
  // world that the walk's poses are in.
  std::string Seal(ServedWalk walk, uint64_t scene, Time now) const;
  // Returns the walk of a token. Throws Problem for a token that this key has not signed (400), one
  // of another scene (409), and one that is more than an hour old or of another version (410).
  ServedWalk Open(std::string_view token, uint64_t scene, Time now) const;

 private:
  std::string Signature(std::string_view bytes) const;

  std::string key_;
};

// The walks of clients in one scene. Thread safe.
class SceneWalks {
 public:
  // Measures the scene's distances on `threads` (0: one for each core): a walk's first photograph
  // shall not wait for that.
  SceneWalks(const WalkTokens& tokens, const ServedScene& scene, int threads);

  // Returns the walk so far. Throws Problem where the step cannot follow it.
  ServedWalk Before(const WalkStep& step) const;

  struct Walked {
    WalkedQuery query;
    std::string session;  // member of the answer, JSON
  };
  Walked GoOn(ServedWalk walk, const WalkedPhotograph& photograph) const;

 private:
  const WalkTokens& tokens_;
  uint64_t world_;  // identifies the world that poses are in
  SceneDistances distances_;
};

}  // namespace raylift
