// The program: parses, runs one command, turns errors into exit codes.
//   0 done (queries that could not be localized are results)   1 a bug
//   2 a bad option                                             3 bad input

#include <cstdio>
#include <exception>

#include "commands.h"
#include <CLI/CLI.hpp>

#include "raylift/base/error.h"

namespace {

enum ExitCode { kDone = 0, kBug = 1, kBadOption = 2, kBadInput = 3 };

int Fail(ExitCode code, const char* message) {
  std::fprintf(stderr, "raylift: %s\n", message);
  return code;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    CLI::App program(
        "Raylift estimates where photographs were taken, against a mesh of the scene.");
    program.set_version_flag("--version", "raylift " RAYLIFT_VERSION);
    program.require_subcommand(1);
    program.footer(
        "Examples:\n"
        "  raylift localize --model sfm --images photos --geometry mesh:scene.ply \\\n"
        "      --queries queries.txt --out result\n"
        "  raylift evaluate --ground-truth truth --poses result/poses.txt --thresholds "
        "0.05,5:0.25,2\n"
        "  raylift COMMAND --help");
    raylift::AddLocalizeCommand(program);
    raylift::AddEstimateCommand(program);
    raylift::AddEvaluateCommand(program);
    try {
      program.parse(argc, argv);
    } catch (const CLI::FileError& error) {
      return Fail(kBadInput, error.what());
    } catch (const CLI::Success& success) {  // --help, --version
      return program.exit(success);
    } catch (const CLI::ParseError& error) {
      return Fail(kBadOption, error.what());
    }
  } catch (const raylift::OptionError& error) {
    return Fail(kBadOption, error.what());
  } catch (const raylift::InputError& error) {
    return Fail(kBadInput, error.what());
  } catch (const std::exception& error) {
    std::fprintf(stderr, "raylift: this is a bug: %s\n", error.what());
    return kBug;
  }
  return kDone;
}
