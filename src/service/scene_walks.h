// Walks of clients in one scene.

#pragma once

#include <cstdint>
#include <string>

#include "service/localize_request.h"
#include "service/walk_tokens.h"

#include "raylift/sequences/tracker.h"
#include "raylift/service/server.h"

namespace raylift {

// Thread safe.
class SceneWalks {
 public:
  // Measures the scene's distances, by so many threads (0: one for each core): a walk's first
  // photograph shall not wait for that.
  SceneWalks(const WalkTokens& tokens, const ServedScene& scene, int threads);

  // Returns the walk so far. Throws Problem where the step cannot follow it.
  ServedWalk Before(const WalkStep& step) const;

  struct Walked {
    WalkedQuery query;
    std::string session;  // of the answer, JSON
  };
  Walked GoOn(ServedWalk walk, const WalkedPhotograph& photograph) const;

 private:
  const WalkTokens& tokens_;
  uint64_t world_;  // tells apart what poses are in
  SceneDistances distances_;
};

}  // namespace raylift
