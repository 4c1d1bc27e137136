// Helpers for nlohmann's JSON. File names need not be UTF-8, as JSON must be; what is not is
// replaced.

#pragma once

#include <string>
#include <type_traits>
#include <utility>

namespace raylift {

// Returns JSON as text. Json is nlohmann's json or ordered_json. An indent of -1 makes one line.
template <typename Json>
std::string JsonText(const Json& json, int indent = -1) {
  return json.dump(indent, ' ', /*ensure_ascii=*/false, Json::error_handler_t::replace);
}

// Empties a value from its leaves on, as deep as records are nested. The library's destructor takes
// memory for what is not empty (for the pairs that an object is initialized with, too), and ends
// the process where there is none.
template <typename Json>
void Dismantle(Json& json, int most_levels = 32) {
  if (!json.is_structured() || most_levels == 0) return;
  for (Json& inner : json) Dismantle(inner, most_levels - 1);
  json.clear();
}

// Returns the text of a value that is not used afterwards, which is dismantled.
template <typename Json>
requires(!std::is_lvalue_reference_v<Json>) std::string JsonText(Json&& json, int indent = -1) {
  std::string text = JsonText(std::as_const(json), indent);
  Dismantle(json);
  return text;
}

// Returns what the library says of a text or a value, without the number of its exception:
// "[json.exception.type_error.302] type must be number, but is string".
template <typename Exception>
std::string MessageOf(const Exception& error) {
  const std::string message = error.what();
  const size_t id_end = message.find("] ");
  return message.substr(id_end == std::string::npos ? 0 : id_end + 2);
}

// Appends to an object's list, which is made where there is none yet. The library's own push_back()
// leaves what is no list and no null where there is no memory for one, and ends the process.
template <typename Json>
void AppendTo(Json& object, const char* key, std::type_identity_t<Json> entry) {
  if (!object.contains(key)) object[key] = Json::array();
  object[key].push_back(std::move(entry));
}

// Sets a member of an object's object, likewise.
template <typename Json>
void SetIn(Json& object, const char* key, const std::string& name,
           std::type_identity_t<Json> value) {
  if (!object.contains(key)) object[key] = Json::object();
  object[key][name] = std::move(value);
}

}  // namespace raylift
