#include "geometry_options.h"

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/lifting/geometry_spec.h"

namespace raylift {

GeometryOptions GeometryFlags::Resolve() const {
  const auto mode_value = FromName<GeometryMode>(mode);
  if (!mode_value) {
    throw OptionError("--geometry-mode", mode, "expected " + NameList<GeometryMode>());
  }
  const auto align_value = FromName<AlignMode>(align_depth);
  if (!align_value) {
    throw OptionError("--align-depth", align_depth, "expected " + NameList<AlignMode>());
  }
  if (*align_value != AlignMode::kOff && specs.empty()) {
    throw OptionError("--align-depth", align_depth, "needs --geometry");
  }
  const auto candidates_value = FromName<CandidateMode>(candidates);
  if (!candidates_value) {
    throw OptionError("--candidates", candidates, "expected " + NameList<CandidateMode>());
  }
  GeometryOptions options{
      .mode = *mode_value, .align = *align_value, .candidates = candidate_values};
  options.candidates.mode = *candidates_value;
  options.candidates.Validate();
  return options;
}

void AddGeometryOptions(CLI::App& app, GeometryFlags& flags) {
  const std::string group = "Geometry";
  app.add_option("--geometry", flags.specs, GeometryHelp())->allow_extra_args(false)->group(group);
  app.add_option("--geometry-mode", flags.mode,
                 fmt::format("Of several sources: {}. The point of the first that\n"
                             "has one, or the points of all",
                             NameList<GeometryMode>()))
      ->capture_default_str()
      ->group(group);
  app.add_option("--align-depth", flags.align_depth,
                 fmt::format("Correct each reference's depth by the matches between references:\n"
                             "{}. For depth maps that do not agree with each other",
                             NameList<AlignMode>()))
      ->capture_default_str()
      ->group(group);
  app.add_option("--candidates", flags.candidates,
                 fmt::format("The 3D points of a query keypoint, one per matched reference:\n"
                             "{}. Keep all, merge them to one by the\n"
                             "references' matched keypoints, or triangulate these and use no\n"
                             "--geometry",
                             NameList<CandidateMode>()))
      ->capture_default_str()
      ->group(group);
  app.add_option("--candidates-error-px", flags.candidate_values.max_error_px,
                 "A reference counts for a merged or triangulated point that\n"
                 "projects this close to its keypoint")
      ->capture_default_str()
      ->group(group);
  app.add_option("--candidates-min-angle-deg", flags.candidate_values.min_angle_deg,
                 "Smallest angle between rays that a point is triangulated or\n"
                 "refined from")
      ->capture_default_str()
      ->group(group);
}

}  // namespace raylift
