// JSON as text. File names need not be UTF-8, as JSON must be; what is not is replaced.

#pragma once

#include <string>

namespace raylift {

// Of nlohmann's json or ordered_json. An indent of -1 makes one line.
template <typename Json>
std::string JsonText(const Json& json, int indent = -1) {
  return json.dump(indent, ' ', /*ensure_ascii=*/false, Json::error_handler_t::replace);
}

}  // namespace raylift
