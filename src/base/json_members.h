// Records in JSON, both ways by one list of their members, beside the struct:
//
//   void Members(JsonMembers& members, KnownNoise& noise) {
//     members("sigma", noise.sigma);
//     members("errors", noise.errors);
//   }
//
// ToJson(noise) writes the members in this order, FromJson<KnownNoise>() takes them by their names.
// A value is a number, a boolean, a string, an enum with names, a matrix (a list of numbers or of
// rows), another record, a std::tie() of values (an array), an optional value (null) or a vector of
// values. What is missing or of another kind is an InputError with its path:
// "depth[0].maps[2].shift: ...".

#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>
#include <vector>

#include "base/fields.h"
#include "base/json_text.h"
#include <Eigen/Core>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/enum_names.h"
#include "raylift/base/error.h"

namespace raylift {

class JsonMembers {
 public:
  using Json = nlohmann::ordered_json;

  // Reads the members of `json`, or writes them.
  explicit JsonMembers(const Json& json) : from_(&json) {}
  explicit JsonMembers(Json& json) : to_(&json) {}

  bool reads() const { return from_ != nullptr; }

  // Writes or reads a member that must be there.
  template <typename Value>
  void operator()(const std::string& name, Value&& value) {
    if (to_ != nullptr) {
      SetMember(*to_, name, Written(value));
    } else {
      At(name, [&] { Read(from_->at(name), value); });
    }
  }

  // Writes or reads a member that is written where `is_there`, and read where the file has it.
  template <typename Value>
  void If(bool is_there, const std::string& name, Value&& value) {
    if (reads() ? from_->contains(name) : is_there) (*this)(name, value);
  }

  // Writes or reads the fields of a table (base/fields.h), by their names without the prefix.
  void Fields(std::span<const Field> fields, std::string_view prefix = {}) {
    for (const Field& field : fields) {
      const std::string name(field.name.substr(prefix.size()));
      std::visit([&](const auto& value) { TakeField(name, value); }, field.value);
    }
  }

  // Writes or reads the member "format", whose value must be this one.
  void Format(const std::string& expected) {
    std::string format = expected;
    (*this)("format", format);
    if (format != expected) Fail("format", fmt::format("expected \"{}\"", expected));
  }

  // Writes or reads the record as an array of these values.
  template <typename... Value>
  void Row(Value&... values) {
    auto row = std::tie(values...);
    if (to_ != nullptr) {
      *to_ = Written(row);
    } else {
      Read(*from_, row);
    }
  }

  // Refuses a member that was read.
  [[noreturn]] static void Fail(const std::string& name, const std::string& message) {
    throw Fault(name, message);
  }

 private:
  template <typename Value>
  void TakeField(const std::string& name, Value* value) {
    (*this)(name, *value);
  }
  void TakeField(const std::string& name, const NamedValue& value) {
    std::string text = value.name();
    (*this)(name, text);
    if (reads()) At(name, [&] { value.Set(text); });
  }

  struct Fault : InputError {
    Fault(std::string fault_path, std::string fault_message)
        : InputError(fault_path.empty() ? fault_message : fault_path + ": " + fault_message),
          path(std::move(fault_path)),
          message(std::move(fault_message)) {}
    std::string path;
    std::string message;
  };
  template <typename Value>
  friend nlohmann::ordered_json ToJson(Value value);
  template <typename Value>
  friend Value FromJson(const nlohmann::ordered_json& json);

  // Says where it is that `read` finds a fault.
  template <typename Function>
  static void At(const std::string& place, const Function& read) {
    try {
      read();
    } catch (const Fault& fault) {
      const bool is_member = !place.empty() && !fault.path.empty() && fault.path.front() != '[';
      throw Fault(place + (is_member ? "." : "") + fault.path, fault.message);
    } catch (const Json::exception& error) {
      throw Fault(place, MessageOf(error));
    } catch (const InputError& error) {
      throw Fault(place, error.what());
    }
  }

  template <typename Value>
  static Json Written(Value& value) {
    if constexpr (requires(JsonMembers & members) { Members(members, value); }) {
      Json json = Json::object();
      JsonMembers members(json);
      Members(members, value);
      return json;
    } else if constexpr (NamedEnum<std::remove_const_t<Value>>) {
      return ToString(value);
    } else if constexpr (requires { value.rowwise(); }) {
      Json rows = Json::array();
      for (const auto& row : value.rowwise()) {
        if (row.size() == 1) {
          rows.push_back(row[0]);
        } else {
          rows.push_back(std::vector<double>(row.begin(), row.end()));
        }
      }
      return rows;
    } else {
      return WrittenList(value);
    }
  }
  template <typename Value>
  static Json WrittenList(Value& value) {
    return value;
  }
  template <typename Value>
  static Json WrittenList(std::optional<Value>& value) {
    return value ? Written(*value) : Json(nullptr);
  }
  template <typename Value>
  static Json WrittenList(std::vector<Value>& values) {
    Json json = Json::array();
    for (auto&& value : values) json.push_back(Written(value));
    return json;
  }
  template <typename... Value>
  static Json WrittenList(std::tuple<Value&...>& values) {
    Json json = Json::array();
    std::apply([&](auto&... value) { (json.push_back(Written(value)), ...); }, values);
    return json;
  }

  template <typename Value>
  static void Read(const Json& json, Value& value) {
    if constexpr (requires(JsonMembers & members) { Members(members, value); }) {
      JsonMembers members(json);
      Members(members, value);
    } else if constexpr (NamedEnum<Value>) {
      const auto named = FromName<Value>(json.get<std::string>());
      if (!named) Fail("", fmt::format("expected {}, found {}", NameList<Value>(), JsonText(json)));
      value = *named;
    } else if constexpr (requires { value.rowwise(); }) {
      ReadMatrix(json, value);
    } else {
      ReadList(json, value);
    }
  }
  template <typename Value>
  static void ReadList(const Json& json, Value& value) {
    json.get_to(value);
  }
  template <typename Value>
  static void ReadList(const Json& json, std::optional<Value>& value) {
    if (json.is_null()) return value.reset();
    Read(json, value.emplace());
  }
  template <typename Value>
  static void ReadList(const Json& json, std::vector<Value>& values) {
    if (!json.is_array()) Fail("", "expected a list");
    values.clear();
    for (const Json& element : json) {
      At(fmt::format("[{}]", values.size()), [&] { Read(element, values.emplace_back()); });
    }
  }
  template <typename... Value>
  static void ReadList(const Json& json, std::tuple<Value&...>& values) {
    size_t next = 0;
    std::apply([&](auto&... value) { (Read(json.at(next++), value), ...); }, values);
  }

  template <typename Matrix>
  static void ReadMatrix(const Json& json, Matrix& matrix) {
    const auto check = [](const Json& list, Eigen::Index count) {
      if (list.size() == static_cast<size_t>(count)) return;
      Fail("", fmt::format("expected {} values", count));
    };
    check(json, matrix.rows());
    for (Eigen::Index r = 0; r < matrix.rows(); ++r) {
      const Json& row = json.at(static_cast<size_t>(r));
      check(row, matrix.cols());
      for (Eigen::Index c = 0; c < matrix.cols(); ++c) {
        const Json& number = matrix.cols() == 1 ? row : row.at(static_cast<size_t>(c));
        number.get_to(matrix(r, c));
      }
    }
  }

  const Json* from_ = nullptr;
  Json* to_ = nullptr;
};

// Returns the value as JSON. It is copied, as its list of members takes one that can be read into.
template <typename Value>
nlohmann::ordered_json ToJson(Value value) {
  return JsonMembers::Written(value);
}

// Returns an object of the fields, as JsonMembers::Fields() writes them.
inline nlohmann::ordered_json FieldsJson(std::span<const Field> fields,
                                         std::string_view prefix = {}) {
  auto json = nlohmann::ordered_json::object();
  JsonMembers members(json);
  members.Fields(fields, prefix);
  return json;
}

// Throws InputError where it is no such value.
template <typename Value>
Value FromJson(const nlohmann::ordered_json& json) {
  Value value;
  JsonMembers::At("", [&] { JsonMembers::Read(json, value); });
  return value;
}

// Throws InputError where the text is no JSON, too.
template <typename Value>
Value ParseJson(std::string_view text) {
  try {
    auto json = nlohmann::ordered_json::parse(text);
    Value value = FromJson<Value>(json);
    Dismantle(json);
    return value;
  } catch (const nlohmann::json::parse_error& error) {
    throw InputError(MessageOf(error));
  }
}

}  // namespace raylift
