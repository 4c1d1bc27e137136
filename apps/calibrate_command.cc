// raylift calibrate: learns the calibration of a scene from its references and from queries.

#include <filesystem>
#include <memory>

#include "apps/commands.h"
#include "apps/interrupt.h"
#include "apps/localize_flags.h"
#include "apps/localize_inputs.h"
#include "apps/options.h"
#include "lifting/alignment_text.h"
#include "lifting/mesh_spec.h"
#include <fmt/format.h>

#include "raylift/base/file.h"
#include "raylift/localization/scene_calibration.h"

namespace raylift {
namespace {

void Run(LocalizeFlags flags) {
  flags.geometry.specs = InWorld(flags.geometry.specs, flags.world);
  const std::filesystem::path file = flags.out;
  flags.out = file.parent_path();  // for the caches
  flags.Check();
  flags.min_confidence = 0;  // noise is that of all poses
  RequireWritable(file);
  Scene scene;
  UntilSignal([&] {
    const LocalizeInputs inputs = OpenLocalizeInputs(flags);
    PrintWarnings(inputs.scene.warnings);
    scene = Calibrate(inputs.scene,
                      OpenMatchesOf(flags, inputs.scene, inputs.queries, flags.estimator.seed),
                      inputs.queries,
                      {.localizer = flags.Localizer(),
                       .align = flags.geometry.align,
                       .noise_by = CalibratedBy::kQueries,
                       .any_filter = true,
                       .threads = flags.run.threads});
  });
  WriteSceneCalibration(file, *scene.calibration);
  if (flags.run.quiet) return;
  for (size_t i = 0; i < scene.sources.size(); ++i) {
    const SceneSource& source = scene.sources[i];
    if (source.alignment && source.alignment->mode != AlignMode::kOff) {
      fmt::print("{}: depth is corrected by {}\n", source.spec, ToString(source.alignment->mode));
    }
    if (const auto worth = ConfidencesOf(scene, i)) {
      fmt::print("{}: {}\n", source.spec, Describe(*worth));
    }
  }
  const auto& noise = scene.calibration->match_noise;
  fmt::print("noise of matches, by {}: {}\n", ToString(scene.calibration->by),
             noise ? fmt::format("{:.2f} px, {:.2g} of the depth", noise->keypoint_px.sigma,
                                 noise->depth.sigma)
                   : "not known");
}

}  // namespace

Command AddCalibrateCommand(CLI::App& program) {
  auto flags = std::make_shared<LocalizeFlags>();
  CLI::App& command = AddCommand(program, "calibrate",
                                 "What is known of a scene, for localize --scene-calibration");
  AddLocalizeOptions(command, *flags, "File of the calibration (JSON)");
  SetFooter(
      command,
      R"(Takes the arguments of localize, which learns from the references alone what it can: how
the depth of geometry is to be corrected, and how noisy geometry and matches are. Queries
add what their own photographs tell (30 of them are enough; their poses need not be
known), which matters most where the references are rendered.
Example:
  raylift calibrate --scene scene.toml --queries some.txt --out calibration.json
  raylift localize --scene scene.toml --scene-calibration calibration.json --out result)");
  return {&command, [flags] { Run(*flags); }};
}

}  // namespace raylift
