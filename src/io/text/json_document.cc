#include "io/text/json_document.h"

#include <algorithm>
#include <climits>

#include "base/json_text.h"
#include "io/text/line_tokens.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace raylift {
namespace {

const nlohmann::json& Of(const void* value) { return *static_cast<const nlohmann::json*>(value); }

nlohmann::json Parse(std::string_view json, const std::filesystem::path& file) {
  try {
    return nlohmann::json::parse(json);
  } catch (const nlohmann::json::exception& error) {
    throw InputError(file, MessageOf(error));
  }
}

}  // namespace

struct JsonDocument::Impl {
  Impl(std::string_view json, const std::filesystem::path& path)
      : file(path.string()), root(Parse(json, path)) {}
  ~Impl() { Dismantle(root); }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

  const std::string file;  // before `root`, whose memory is let go of by the destructor alone
  nlohmann::json root;
};

JsonDocument::JsonDocument(std::string_view json, const std::filesystem::path& file)
    : impl_(std::make_unique<const Impl>(json, file)) {}

JsonDocument::~JsonDocument() = default;

JsonPlace JsonDocument::Root() const { return {&impl_->root, impl_->file}; }

Eigen::Quaterniond JsonPlace::Rotation() const {
  const auto qvec_wxyz = Vector<4>();
  const auto rotation = UnitQuaternion(qvec_wxyz);
  if (rotation) return *rotation;
  Fail(fmt::format("expected a quaternion of length 1, found one of length {:.6g}",
                   qvec_wxyz.norm()));
}

JsonPlace JsonPlace::Member(std::string_view name) const& {
  if (!Of(value_).is_object()) {
    FailToBe("an object");
  }
  const auto member = Of(value_).find(name);
  if (member == Of(value_).end()) {
    Fail(fmt::format("the member \"{}\" is missing", name));
  }
  return JsonPlace(&*member, *this, name, 0);
}

bool JsonPlace::IsNull() const { return Of(value_).is_null(); }

bool JsonPlace::IsArray() const { return Of(value_).is_array(); }

bool JsonPlace::IsNumber() const { return Of(value_).is_number(); }

bool JsonPlace::Has(std::string_view name) const {
  return Of(value_).is_object() && Of(value_).contains(name);
}

void JsonPlace::ExpectMembers(std::initializer_list<std::string_view> names) const {
  if (!Of(value_).is_object()) FailToBe("an object");
  for (const auto& member : Of(value_).items()) {
    if (std::find(names.begin(), names.end(), member.key()) != names.end()) continue;
    JsonPlace(&member.value(), *this, member.key(), 0)
        .Fail(fmt::format("is not known here; expected {}", fmt::join(names, ", ")));
  }
}

JsonPlace JsonPlace::At(size_t index) const& {
  return JsonPlace(&Of(value_)[index], *this, {}, index);
}

size_t JsonPlace::ArraySize() const {
  if (!Of(value_).is_array()) {
    FailToBe("an array");
  }
  return Of(value_).size();
}

void JsonPlace::ExpectArraySize(size_t size) const {
  if (ArraySize() != size) {
    Fail(fmt::format("expected {} elements, found {}", size, ArraySize()));
  }
}

std::string JsonPlace::String() const {
  if (!Of(value_).is_string()) {
    FailToBe("a string");
  }
  return Of(value_).get<std::string>();
}

double JsonPlace::Number() const {
  if (!Of(value_).is_number()) {
    FailToBe("a number");
  }
  return Of(value_).get<double>();
}

int JsonPlace::Int() const {
  if (!Of(value_).is_number_integer()) {
    FailToBe("an integer");
  }
  const bool fits = Of(value_).is_number_unsigned() ? Of(value_).get<uint64_t>() <= INT_MAX
                                                    : Of(value_).get<int64_t>() >= INT_MIN;
  if (!fits) {
    FailToBe("an integer of 32 bits");
  }
  return Of(value_).get<int>();
}

bool JsonPlace::Bool() const {
  if (!Of(value_).is_boolean()) {
    FailToBe("true or false");
  }
  return Of(value_).get<bool>();
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
  std::string found =
      Of(value_).is_structured()
          ? fmt::format("an {}", Of(value_).type_name())
          : Of(value_).dump(-1, ' ', true, nlohmann::json::error_handler_t::replace);
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

}  // namespace raylift
