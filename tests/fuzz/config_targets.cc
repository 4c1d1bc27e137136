// Options from TOML files, as the program reads them but for running the command.

#include <algorithm>
#include <utility>

#include "apps/argument_files.h"
#include "apps/commands.h"
#include "apps/options.h"
#include "fuzz/fuzz_targets.h"
#include <CLI/CLI.hpp>

#include "raylift/base/error.h"

namespace raylift {
namespace {

// A program of one command, of which nothing is required, and of another, whose tables are not its.
struct SmallProgram {
  SmallProgram() : command(AddLocalizeCommand(app)), other(AddRenderCommand(app)) {
    CheckNumbers(*command.app);
    for (CLI::Option* option : command.app->get_options()) option->required(false);
  }

  void Parse(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), command.app->get_name());
    std::reverse(arguments.begin(), arguments.end());
    app.parse(std::move(arguments));
  }

  CLI::App app;
  Command command, other;
};

void ReadConfigFile(std::string_view bytes) {
  static SmallProgram asked, filled;
  const auto file = PutFile("config.toml", bytes);
  asked.Parse({"--config", file, "--top-k", "3"});
  try {
    filled.Parse(ConfigArguments(file, *asked.command.app));
  } catch (const CLI::ParseError& error) {
    throw InputError(file, error.what());
  }
}

constexpr std::string_view kConfig = R"(# options of localize
threads = 4
top-k = 5
[localize]
model = "sfm"
geometry = ["mesh:scene.ply", "depth:maps,kind=ray"]
alpha = 0.75
quiet = true
[render]
products = "depth"
)";

}  // namespace

std::vector<FuzzTarget> ConfigFuzzTargets() {
  return {
      {"config_toml", &ReadConfigFile, [] { return std::vector{std::string(kConfig)}; },
       "[localize] [estimate] geometry model method top-k alpha threads quiet seed every "
       "continuous "
       "help config version scene false nan inf -1 1e308 18446744073709551616 ''' \"\"\" \\u [[[["},
  };
}

}  // namespace raylift
