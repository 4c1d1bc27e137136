#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <string>

#include "pictures/exif.h"
#include <pugixml.hpp>

#include "raylift/base/text.h"

namespace raylift {
namespace {

constexpr std::string_view kNames[] = {"GimbalYawDegree",   "GimbalPitchDegree", "GimbalRollDegree",
                                       "AbsoluteAltitude",  "RelativeAltitude",  "RtkFlag",
                                       "RtkStdLon",         "RtkStdLat",         "RtkStdHgt",
                                       "LRFTargetDistance", "DewarpFlag"};

constexpr std::string_view kCalibration = "DewarpData";

struct Values {
  std::map<std::string_view, double, std::less<>> numbers;
  std::optional<std::array<double, 9>> calibration;
};

std::optional<double> Number(std::string_view text) {
  text = Trim(text);
  if (text.starts_with('+')) text.remove_prefix(1);
  const auto value = ParseDouble(text);
  return value && std::isfinite(*value) ? value : std::nullopt;
}

// Returns the numbers of "2022-06-08;3713.29,3713.29,7.02,-8.72,-0.11,0.01,0,0,-0.02"; nullopt
// where they are others or of no lens, as where none was calibrated.
std::optional<std::array<double, 9>> Calibration(std::string_view text) {
  const auto parts = SplitBy(text.substr(text.find(';') + 1), ',');
  std::array<double, 9> numbers{};
  if (parts.size() != numbers.size()) return std::nullopt;
  for (size_t i = 0; i < numbers.size(); ++i) {
    const auto number = Number(parts[i]);
    if (!number) return std::nullopt;
    numbers[i] = *number;
  }
  return numbers[0] > 0 && numbers[1] > 0 ? std::optional(numbers) : std::nullopt;
}

// Takes a property that is a number: "drone-dji:GimbalYawDegree" is one of DJI's names, "+46.00" a
// number.
void Take(std::string_view name, std::string_view text, Values& values) {
  const size_t colon = name.find(':');
  if (colon == std::string_view::npos) return;
  name.remove_prefix(colon + 1);
  if (name == kCalibration) values.calibration = Calibration(text);
  for (const std::string_view known : kNames) {
    if (name != known) continue;
    if (const auto value = Number(text)) values.numbers.emplace(known, *value);
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
  if (values.numbers.empty() && !values.calibration) return std::nullopt;
  const auto value = [&](std::string_view name) {
    const auto known = values.numbers.find(name);
    return known == values.numbers.end() ? std::nullopt : std::optional(known->second);
  };
  DroneTags tags{.yaw_deg = value("GimbalYawDegree"),
                 .pitch_deg = value("GimbalPitchDegree"),
                 .roll_deg = value("GimbalRollDegree"),
                 .absolute_altitude_m = value("AbsoluteAltitude"),
                 .relative_altitude_m = value("RelativeAltitude"),
                 .rtk_sigma_m = std::nullopt,
                 .range_m = std::nullopt,
                 .calibration = values.calibration};
  const auto east = value("RtkStdLon"), north = value("RtkStdLat"), up = value("RtkStdHgt");
  // The flag is 0 without a fix, 16 for a single point, 34 for a float solution, 50 for a fixed
  // one.
  const bool is_rtk = value("RtkFlag").value_or(0) >= 34;
  if (is_rtk && east && north && up && *east > 0 && *north > 0 && *up > 0) {
    tags.rtk_sigma_m = Eigen::Vector3d(*east, *north, *up);
  }
  // The distance is 0 where the laser met nothing.
  if (const auto range = value("LRFTargetDistance"); range && *range > 0) tags.range_m = range;
  const bool is_undistorted = value("DewarpFlag").value_or(0) == 1;
  if (tags.calibration && is_undistorted) std::fill_n(tags.calibration->begin() + 4, 5, 0);
  return tags;
}

}  // namespace raylift
