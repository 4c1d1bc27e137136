#include "option_names.h"

#include <algorithm>
#include <array>
#include <string_view>
#include <utility>

#include <fmt/format.h>

namespace raylift {
namespace {

constexpr std::string_view kCharacters = "abcdefghijklmnopqrstuvwxyz0123456789_";

// Fields whose options are called otherwise; all others are called as they are, with dashes.
constexpr std::array<std::pair<std::string_view, std::string_view>, 20> kOptionOfField = {{
    // ImportDataset
    {"dataset", "DATASET"},
    // ConsistencyThresholds
    {"reprojection_px", "--filter-reprojection-px"},
    {"min_views", "--filter-min-views"},
    {"min_ratio", "--filter-min-ratio"},
    // CandidateOptions
    {"max_error_px", "--candidates-error-px"},
    {"min_angle_deg", "--candidates-min-angle-deg"},
    // JoinGateOptions
    {"min_inliers_2d2d", "--join-min-inliers-2d2d"},
    {"min_inliers_2d3d", "--join-min-inliers-2d3d"},
    {"max_rotation_sigma_deg", "--join-max-rotation-sigma-deg"},
    {"max_position_sigma", "--join-max-position-sigma"},
    {"max_difference_deg", "--join-max-difference-deg"},
    {"max_difference_position", "--join-max-difference-position"},
    // DepthPerturbation
    {"warp_sigma", "--warp"},
    {"flying_share", "--flying"},
    {"smoothing_px", "--smooth"},
    {"noise_sigma", "--noise"},
    {"relative_noise_sigma", "--relative-noise"},
    {"quantization_step", "--quantize"},
    {"quantization_bits", "--quantize-bits"},
    {"hole_share", "--holes"},
}};

std::string OptionOfField(std::string_view field) {
  const auto* known = std::find_if(kOptionOfField.begin(), kOptionOfField.end(),
                                   [field](const auto& entry) { return entry.first == field; });
  if (known != kOptionOfField.end()) return std::string(known->second);
  std::string option = fmt::format("--{}", field);
  std::replace(option.begin(), option.end(), '_', '-');
  return option;
}

}  // namespace

std::string MessageInOptions(const OptionError& error) {
  const std::string& name = error.name();
  const bool is_field = !name.empty() && name.find_first_not_of(kCharacters) == std::string::npos;
  if (!is_field) return error.what();
  // The constraint may speak of another field, as "name = value".
  std::string constraint = error.constraint();
  if (const size_t equals = constraint.find(" = "); equals != std::string::npos) {
    const size_t begin = constraint.find_last_not_of(kCharacters, equals - 1) + 1;
    if (begin < equals) {
      constexpr std::string_view kOn = " = true";
      const bool is_flag = constraint.compare(equals, kOn.size(), kOn) == 0;
      constraint.replace(begin, equals - begin + (is_flag ? kOn.size() : 0),
                         OptionOfField(constraint.substr(begin, equals - begin)));
    }
  }
  if (error.value() == "false")
    return fmt::format("without {}: {}", OptionOfField(name), constraint);
  return fmt::format("{} = {}: {}", OptionOfField(name), error.value(), constraint);
}

}  // namespace raylift
