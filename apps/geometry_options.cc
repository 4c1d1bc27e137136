#include "geometry_options.h"

#include "raylift/base/error.h"
#include "raylift/lifting/geometry_spec.h"

namespace raylift {

GeometryOptions GeometryFlags::Resolve() const {
  const auto mode_value = GeometryModeFromName(mode);
  if (!mode_value) {
    throw OptionError("--geometry-mode", mode, "expected first|all");
  }
  const auto align_value = AlignModeFromName(align_depth);
  if (!align_value) {
    throw OptionError("--align-depth", align_depth, "expected off|scale|affine|grid");
  }
  if (*align_value != AlignMode::kOff && specs.empty()) {
    throw OptionError("--align-depth", align_depth, "needs --geometry");
  }
  return {.mode = *mode_value, .align = *align_value};
}

void AddGeometryOptions(CLI::App& app, GeometryFlags& flags) {
  const std::string group = "Geometry";
  app.add_option("--geometry", flags.specs, GeometryHelp())->allow_extra_args(false)->group(group);
  app.add_option("--geometry-mode", flags.mode,
                 "Of several sources: first|all. The point of the first that\n"
                 "has one, or the points of all")
      ->capture_default_str()
      ->group(group);
  app.add_option("--align-depth", flags.align_depth,
                 "Correct each reference's depth by the matches between references:\n"
                 "off|scale|affine|grid. For depth maps that do not agree with each other")
      ->capture_default_str()
      ->group(group);
}

}  // namespace raylift
