#include <array>
#include <cmath>
#include <map>
#include <string>

#include "pictures/exif.h"
#include <pugixml.hpp>

#include "raylift/base/text.h"

namespace raylift {
namespace {

constexpr std::string_view kNames[] = {"GimbalYawDegree",  "GimbalPitchDegree", "GimbalRollDegree",
                                       "AbsoluteAltitude", "RelativeAltitude",  "RtkFlag",
                                       "RtkStdLon",        "RtkStdLat",         "RtkStdHgt"};

using Values = std::map<std::string_view, double, std::less<>>;

// "drone-dji:GimbalYawDegree" is one of DJI's names, "+46.00" a number.
void Take(std::string_view name, std::string_view text, Values& values) {
  const size_t colon = name.find(':');
  if (colon == std::string_view::npos) return;
  name.remove_prefix(colon + 1);
  text = Trim(text);
  if (text.starts_with('+')) text.remove_prefix(1);
  for (const std::string_view known : kNames) {
    if (name != known) continue;
    if (const auto value = ParseDouble(text); value && std::isfinite(*value)) {
      values.emplace(known, *value);
    }
  }
}

}  // namespace

std::optional<DroneTags> ParseDroneTags(std::string_view xmp) {
  pugi::xml_document document;
  if (!document.load_buffer(xmp.data(), xmp.size())) return std::nullopt;
  // Properties are attributes of a description, or elements in it.
  Values values;
  for (const auto& found : document.select_nodes("//*[local-name()='Description']")) {
    for (const pugi::xml_attribute& property : found.node().attributes()) {
      Take(property.name(), property.value(), values);
    }
    for (const pugi::xml_node& property : found.node().children()) {
      Take(property.name(), property.child_value(), values);
    }
  }
  if (values.empty()) return std::nullopt;
  const auto value = [&](std::string_view name) {
    const auto known = values.find(name);
    return known == values.end() ? std::nullopt : std::optional(known->second);
  };
  DroneTags tags{.yaw_deg = value("GimbalYawDegree"),
                 .pitch_deg = value("GimbalPitchDegree"),
                 .roll_deg = value("GimbalRollDegree"),
                 .absolute_altitude_m = value("AbsoluteAltitude"),
                 .relative_altitude_m = value("RelativeAltitude"),
                 .rtk_sigma_m = std::nullopt};
  const auto east = value("RtkStdLon"), north = value("RtkStdLat"), up = value("RtkStdHgt");
  // 0: no fix; 16: a single point; 34: a float solution; 50: a fixed one.
  const bool is_rtk = value("RtkFlag").value_or(0) >= 34;
  if (is_rtk && east && north && up && *east > 0 && *north > 0 && *up > 0) {
    tags.rtk_sigma_m = Eigen::Vector3d(*east, *north, *up);
  }
  return tags;
}

}  // namespace raylift
