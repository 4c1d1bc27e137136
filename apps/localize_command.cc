// raylift localize: a scene and query photographs in, poses out.

#include <memory>

#include "apps/commands.h"
#include "apps/localize_flags.h"
#include "apps/localize_run.h"
#include "apps/options.h"

namespace raylift {

Command AddLocalizeCommand(CLI::App& program) {
  auto flags = std::make_shared<LocalizeFlags>();
  CLI::App& command =
      AddCommand(program, "localize", "Poses of query photographs in a known scene");
  AddLocalizeOptions(command, *flags);
  return {&command, [flags, &command] {
            flags->Check();
            RunLocalize(*flags,
                        {.estimator = flags->estimator,
                         .filter = flags->filter,
                         .geometry_mode = flags->geometry.mode,
                         .min_confidence = flags->min_confidence,
                         .candidates = flags->geometry.candidates},
                        flags->geometry.align, EffectiveOptionsJson(command));
          }};
}

}  // namespace raylift
