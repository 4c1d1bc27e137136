// Converts a pose to JSON, as the project's own files hold it, and back: {"qvec": [w, x, y, z],
// "tvec": [x, y, z]}.

#pragma once

#include "base/json_members.h"

#include "raylift/geometry/rigid3.h"

namespace raylift {

inline void Members(JsonMembers& members, Rigid3& pose) {
  Eigen::Quaterniond& q = pose.rotation;
  members("qvec", std::tie(q.w(), q.x(), q.y(), q.z()));
  members("tvec", pose.translation);
}

}  // namespace raylift
