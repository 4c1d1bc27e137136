#include "io/text/json_place.h"

#include <climits>

#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {

JsonPlace JsonPlace::Member(std::string_view name) const& {
  if (!value_->is_object()) {
    FailToBe("an object");
  }
  const auto member = value_->find(name);
  if (member == value_->end()) {
    Fail(fmt::format("the member \"{}\" is missing", name));
  }
  return JsonPlace(*member, *this, name, 0);
}

bool JsonPlace::Has(std::string_view name) const {
  return value_->is_object() && value_->contains(name);
}

JsonPlace JsonPlace::At(size_t index) const& {
  return JsonPlace((*value_)[index], *this, {}, index);
}

size_t JsonPlace::ArraySize() const {
  if (!value_->is_array()) {
    FailToBe("an array");
  }
  return value_->size();
}

void JsonPlace::ExpectArraySize(size_t size) const {
  if (ArraySize() != size) {
    Fail(fmt::format("expected {} elements, found {}", size, ArraySize()));
  }
}

std::string JsonPlace::String() const {
  if (!value_->is_string()) {
    FailToBe("a string");
  }
  return value_->get<std::string>();
}

double JsonPlace::Number() const {
  if (!value_->is_number()) {
    FailToBe("a number");
  }
  return value_->get<double>();
}

int JsonPlace::Int() const {
  if (!value_->is_number_integer()) {
    FailToBe("an integer");
  }
  const bool fits = value_->is_number_unsigned() ? value_->get<uint64_t>() <= INT_MAX
                                                 : value_->get<int64_t>() >= INT_MIN;
  if (!fits) {
    FailToBe("an integer of 32 bits");
  }
  return value_->get<int>();
}

void JsonPlace::Fail(std::string_view message) const {
  const std::string path = Path();
  if (path.empty()) {
    throw InputError(std::filesystem::path(file_), message);
  }
  throw InputError(std::filesystem::path(file_), path, message);
}

void JsonPlace::FailToBe(std::string_view expected) const {
  constexpr size_t kMaxShown = 40;
  std::string found = value_->is_structured()
                          ? fmt::format("an {}", value_->type_name())
                          : value_->dump(-1, ' ', true, nlohmann::json::error_handler_t::replace);
  if (found.size() > kMaxShown) {
    found = found.substr(0, kMaxShown) + "...";
  }
  Fail(fmt::format("expected {}, found {}", expected, found));
}

std::string JsonPlace::Path() const {
  if (parent_ == nullptr) {
    return {};
  }
  const std::string parent = parent_->Path();
  if (name_.empty()) {
    return fmt::format("{}[{}]", parent, index_);
  }
  return parent.empty() ? std::string(name_) : fmt::format("{}.{}", parent, name_);
}

nlohmann::json ParseJson(std::string_view json, const std::filesystem::path& file) {
  try {
    return nlohmann::json::parse(json);
  } catch (const nlohmann::json::exception& error) {
    // "[json.exception.parse_error.101] parse error at line 1, column 2: ..."
    const std::string_view message = error.what();
    const size_t id_end = message.find("] ");
    throw InputError(file, message.substr(id_end == std::string_view::npos ? 0 : id_end + 2));
  }
}

}  // namespace raylift
