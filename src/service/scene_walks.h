// Walks of clients in one scene.

#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "service/localize_request.h"
#include "service/walk_tokens.h"

#include "raylift/sequences/tracker.h"
#include "raylift/service/server.h"

namespace raylift {

// Thread safe.
class SceneWalks {
 public:
  SceneWalks(const WalkTokens& tokens, const ServedScene& scene);

  // Returns the walk so far. Throws Problem where the step cannot follow it.
  ServedWalk Before(const WalkStep& step) const;

  struct Walked {
    WalkedQuery query;
    std::string session;  // of the answer, JSON
  };
  Walked GoOn(ServedWalk walk, const WalkedPhotograph& photograph) const;

 private:
  const SceneDistances& Distances() const;

  const WalkTokens& tokens_;
  std::shared_ptr<const Localizer> localizer_;
  uint64_t world_;  // tells apart what poses are in
  // Made for the first walk.
  mutable std::once_flag measured_;
  mutable std::optional<SceneDistances> distances_;
};

}  // namespace raylift
