#include "lifting/spec_keys.h"

#include <cmath>

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {

SpecKeys::SpecKeys(std::string spec, std::string_view rest) : spec_(std::move(spec)) {
  const auto parts = SplitBy(rest, ',');
  path_ = parts.front();
  for (size_t i = 1; i < parts.size(); ++i) {
    const size_t equals = parts[i].find('=');
    if (equals == std::string_view::npos) {
      Fail(fmt::format("expected key=value, found \"{}\"", parts[i]));
    }
    const std::string key(parts[i].substr(0, equals));
    if (!values_.emplace(key, parts[i].substr(equals + 1)).second) {
      Fail(fmt::format("the key {} stands twice", key));
    }
  }
}

std::optional<std::string> SpecKeys::Take(const std::string& key) {
  const auto found = values_.find(key);
  if (found == values_.end()) return std::nullopt;
  std::string value = std::move(found->second);
  values_.erase(found);
  return value;
}

std::optional<double> SpecKeys::TakeNumber(const std::string& key, double minimum) {
  const auto text = Take(key);
  if (!text) return std::nullopt;
  const auto value = ParseDouble(*text);
  if (!value || std::isnan(*value) || *value < minimum) {
    Fail(fmt::format("expected {}=NUMBER of at least {}, found \"{}\"", key, minimum, *text));
  }
  return value;
}

std::vector<double> SpecKeys::TakeNumbers(const std::string& key) {
  std::vector<double> values;
  const auto text = Take(key);
  if (!text) return values;
  for (const std::string_view part : SplitBy(*text, '/')) {
    const auto value = ParseDouble(part);
    if (!value) Fail(fmt::format("expected {}=NUMBER[/NUMBER...], found \"{}\"", key, *text));
    values.push_back(*value);
  }
  return values;
}

void SpecKeys::TakeLimits(SurfaceLimits& limits) {
  limits.near_z = TakeNumber("near", 0).value_or(limits.near_z);
  limits.far_z = TakeNumber("far", 0).value_or(limits.far_z);
  limits.max_incidence_deg = TakeNumber("max_incidence_deg", 0).value_or(limits.max_incidence_deg);
  limits.max_depth_jump = TakeNumber("max_depth_jump", 0).value_or(limits.max_depth_jump);
}

void SpecKeys::ExpectAllTaken(std::string_view known) const {
  if (!values_.empty()) {
    Fail(fmt::format("unknown key \"{}\"; there are {}", values_.begin()->first, known));
  }
}

void SpecKeys::Fail(std::string_view constraint) const {
  throw OptionError("geometry", spec_, constraint);
}

}  // namespace raylift
