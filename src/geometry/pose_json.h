// A pose in JSON, as the project's own files hold it: {"qvec": [w, x, y, z], "tvec": [x, y, z]}.

#pragma once

#include "raylift/geometry/rigid3.h"

namespace raylift {

// Json is nlohmann's json or ordered_json.
template <typename Json>
Json PoseJson(const Rigid3& pose) {
  const Eigen::Quaterniond& q = pose.rotation;
  const Eigen::Vector3d& t = pose.translation;
  return {{"qvec", {q.w(), q.x(), q.y(), q.z()}}, {"tvec", {t.x(), t.y(), t.z()}}};
}

// The same numbers again; an exception of the library's where the value is no such pose.
template <typename Json>
Rigid3 PoseFromJson(const Json& json) {
  const auto number = [&json](const char* vector, size_t i) {
    return json.at(vector).at(i).template get<double>();
  };
  return {Eigen::Quaterniond(number("qvec", 0), number("qvec", 1), number("qvec", 2),
                             number("qvec", 3)),
          {number("tvec", 0), number("tvec", 1), number("tvec", 2)}};
}

}  // namespace raylift
