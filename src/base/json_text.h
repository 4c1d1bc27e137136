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

// Returns the text of an object with another member at its end, whose value is a text, too.
inline std::string WithMember(std::string object, const std::string& name,
                              const std::string& value) {
  object.pop_back();  // the brace
  return object + ",\"" + name + "\":" + value + '}';
}

// Returns what the library says of a text or a value, without the number of its exception:
// "[json.exception.type_error.302] type must be number, but is string".
template <typename Exception>
std::string MessageOf(const Exception& error) {
  const std::string message = error.what();
  const size_t id_end = message.find("] ");
  return message.substr(id_end == std::string::npos ? 0 : id_end + 2);
}

// Sets a member of an object; null becomes one. The library's own [] ends the process where one
// allocation fails: it makes null an object before it has one, and an ordered object that grows
// copies its members and takes memory again to destroy them. Where it throws, the object may have
// lost members.
template <typename Json>
void SetMember(Json& object, const std::string& name, std::type_identity_t<Json> value) {
  if (object.is_null()) object = Json::object();
  using Members = typename Json::object_t;
  auto& members = object.template get_ref<Members&>();
  if constexpr (requires { members.reserve(0); }) {
    if (members.size() == members.capacity()) {
      Members grown;
      grown.reserve(2 * members.size() + 1);
      for (auto& [key, member] : members) grown.emplace_back(key, std::move(member));
      members.swap(grown);
    }
  }
  object[name] = std::move(value);
}

// Appends to an object's list, which is made where there is none yet.
template <typename Json>
void AppendTo(Json& object, const char* key, std::type_identity_t<Json> entry) {
  if (!object.contains(key)) SetMember(object, key, Json::array());
  object[key].push_back(std::move(entry));
}

// Sets a member of an object's object, likewise.
template <typename Json>
void SetIn(Json& object, const char* key, const std::string& name,
           std::type_identity_t<Json> value) {
  if (!object.contains(key)) SetMember(object, key, Json::object());
  SetMember(object[key], name, std::move(value));
}

}  // namespace raylift
