#include "geometry_options.h"

#include "typed_options.h"

#include "raylift/base/error.h"
#include "raylift/lifting/geometry_spec.h"

namespace raylift {

GeometryOptions GeometryFlags::Resolve() const {
  const bool is_asked_for = values.align != AlignMode::kOff && values.align != AlignMode::kAuto;
  if (is_asked_for && specs.empty()) {
    throw OptionError("--align-depth", ToString(values.align), "needs --geometry");
  }
  values.candidates.Validate();
  return values;
}

void AddGeometryOptions(CLI::App& app, GeometryFlags& flags) {
  const std::string group = "Geometry";
  app.add_option("--geometry", flags.specs, GeometryHelp())->allow_extra_args(false)->group(group);
  AddEnumOption(app, "--geometry-mode", flags.values.mode,
                "Of several sources: {}. The point of the first that\n"
                "has one, or the points of all")
      ->group(group);
  AddEnumOption(app, "--align-depth", flags.values.align,
                "Correct each reference's depth by the matches between references:\n"
                "{}. auto: the first of these that\n"
                "predicts further matches as well as any; off with --refinement paper")
      ->group(group);
  AddCandidateOptions(app, flags.values.candidates, group);
}

void AddCandidateOptions(CLI::App& app, CandidateOptions& candidates, const std::string& group) {
  AddEnumOption(app, "--candidates", candidates.mode,
                "The 3D points of a query keypoint, one per matched reference:\n"
                "{}. Keep all, merge them to one by the\n"
                "references' matched keypoints, or triangulate these and use no\n"
                "--geometry")
      ->group(group);
  app.add_option("--candidates-error-px", candidates.max_error_px,
                 "A reference counts for a merged or triangulated point that\n"
                 "projects this close to its keypoint")
      ->capture_default_str()
      ->group(group);
  app.add_option("--candidates-min-angle-deg", candidates.min_angle_deg,
                 "Smallest angle between rays that a point is triangulated or\n"
                 "refined from")
      ->capture_default_str()
      ->group(group);
}

}  // namespace raylift
