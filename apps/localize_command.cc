// raylift localize: a scene and query photographs in, poses out.

#include <memory>

#include "commands.h"
#include "localize_flags.h"
#include "localize_run.h"
#include "options.h"

namespace raylift {

Command AddLocalizeCommand(CLI::App& program) {
  auto flags = std::make_shared<LocalizeFlags>();
  CLI::App* command =
      program.add_subcommand("localize", "Poses of query photographs in a known scene");
  AddLocalizeOptions(*command, *flags);
  return {command, [flags, command] {
            const EstimatorOptions estimator = flags->estimator.Resolve();
            const FilterOptions filter = flags->filter.Resolve();
            const GeometryOptions geometry = flags->geometry.Resolve();
            flags->Check(geometry, estimator);
            RunLocalize(*flags,
                        {.estimator = estimator,
                         .filter = filter,
                         .geometry_mode = geometry.mode,
                         .min_confidence = flags->min_confidence,
                         .candidates = geometry.candidates},
                        geometry.align, EffectiveOptionsJson(*command));
          }};
}

}  // namespace raylift
