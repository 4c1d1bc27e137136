// raylift prepare: what localize would make before its first query, made beforehand.

#include <memory>

#include "apps/commands.h"
#include "apps/interrupt.h"
#include "apps/localize_flags.h"
#include "apps/localize_inputs.h"
#include "apps/options.h"
#include <fmt/format.h>

namespace raylift {
namespace {

void Run(const LocalizeFlags& flags) {
  flags.Check();
  const SignalGuard signals;
  FeatureCount features;
  const auto prepare = [&] {
    const LocalizeInputs inputs = OpenLocalizeInputs(flags);
    PrintWarnings(inputs.scene.warnings);
    features = PrepareFeatures(flags, inputs, flags.estimator.seed);
  };
  UntilSignal(prepare, [] { return "stopped by a signal; the same command goes on"; });
  if (flags.run.quiet) return;
  if (flags.matching.hloc.Any()) {
    fmt::print("features and matches are given: nothing to extract\n");
    return;
  }
  fmt::print("features of {} images: {} extracted now, {} missing\n", features.images,
             features.extracted, features.missing);
}

}  // namespace

Command AddPrepareCommand(CLI::App& program) {
  auto flags = std::make_shared<LocalizeFlags>();
  CLI::App& command = AddCommand(program, "prepare",
                                 "Features and rendered references of localize, made beforehand");
  AddLocalizeOptions(command, *flags);
  SetFooter(
      command,
      R"(Takes the arguments of localize, which then finds what was made; what was there is kept. A
signal ends it in good order (exit code 4), and the same command goes on. Shards share the
photographs; references that are rendered from a mesh are made by one of them, and the others
wait. localize alone makes the same, and its shards wait for the first of them.
Example:
  raylift prepare --scene scene.toml --out result --shard 1/2
  raylift prepare --scene scene.toml --out result --shard 2/2
  raylift localize --scene scene.toml --out result)");
  return {&command, [flags] { Run(*flags); }};
}

}  // namespace raylift
