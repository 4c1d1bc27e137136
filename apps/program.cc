// The whole program: parses, runs one command, turns errors into exit codes.

#include "apps/program.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <memory>
#include <new>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

#include "apps/argument_files.h"
#include "apps/commands.h"
#include "apps/interrupt.h"
#include "apps/program_help.h"
#include <CLI/CLI.hpp>
#include <fmt/format.h>
#include <link.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/io/scene_file.h"

namespace raylift {
namespace {

constexpr std::array<std::string_view, 16> kLibraries = {
    "libassimp.", "libceres.",  "libembree", "libfmt.",    "libhdf5",   "libjpeg.",
    "libopencv_", "libOpenEXR", "libpng",    "libraylift", "libsqlite", "libstdc++.",
    "libtbb.",    "libtiff.",   "libwebp.",  "libzip."};

int Add(dl_phdr_info* library, size_t, void* names) {
  std::error_code failed;
  const std::string name =
      std::filesystem::canonical(library->dlpi_name, failed).filename().string();
  const bool known = std::any_of(kLibraries.begin(), kLibraries.end(),
                                 [&](std::string_view begin) { return name.starts_with(begin); });
  if (!failed && known) static_cast<std::vector<std::string>*>(names)->push_back(name);
  return 0;  // go on
}

// The files of the shared libraries that were loaded and do the work, with their versions as their
// names have them ("libembree3.so.3.13.5"), sorted; what they need in turn is left out.
std::vector<std::string> LoadedLibraries() {
  std::vector<std::string> names;
  dl_iterate_phdr(&Add, &names);
  std::sort(names.begin(), names.end());
  return names;
}

int Fail(ExitCode code, const char* message) {
  std::fprintf(stderr, "raylift: %s\n", message);
  return code;
}

struct Program {
  std::unique_ptr<CLI::App> app;
  std::vector<Command> commands;

  // The one that was parsed.
  const Command& Chosen() const {
    return *std::find_if(commands.begin(), commands.end(),
                         [](const Command& command) { return command.app->parsed(); });
  }
};

std::string Version(bool verbose) {
  std::string text = "raylift " RAYLIFT_VERSION;
  if (!verbose) return text;
  text += "\ncompiled by " RAYLIFT_COMPILER ", with Eigen " RAYLIFT_EIGEN_VERSION "\n";
  for (const std::string& library : LoadedLibraries()) text += library + '\n';
  text.pop_back();
  return text;
}

Program MakeProgram() {
  Program program{std::make_unique<CLI::App>("", "raylift"), {}};
  CLI::App& app = *program.app;
  const CLI::Option* verbose =
      app.add_flag("--verbose")
          ->description("With --version: what it was compiled by and runs with");
  app.set_version_flag("--version", [verbose] { return Version(verbose->count() > 0); });
  app.require_subcommand(1);
  app.footer(
      "All options of a command, with examples:\n"
      "  raylift COMMAND --help");
  program.commands = {AddLocalizeCommand(app),   AddEstimateCommand(app), AddEvaluateCommand(app),
                      AddPerturbCommand(app),    AddRenderCommand(app),   AddCompareCommand(app),
                      AddDoctorCommand(app),     AddViewsCommand(app),    AddPairsCommand(app),
                      AddExperimentCommand(app), AddImportCommand(app),   AddStatusCommand(app),
                      AddMergeCommand(app),      AddVerifyCommand(app),   AddExportCommand(app),
                      AddColorCommand(app),      AddPrepareCommand(app)};
  for (const Command& command : program.commands) {
    CheckNumbers(*command.app);
  }
  AddProgramHelp(app);
  app.add_option_function<std::string>(
         "--man-pages",
         [&app](const std::string& folder) {
           WriteManPages(app, folder);
           throw CLI::Success();
         },
         "Write a manual page of each command into this folder")
      ->group("");
  return program;
}  // NOLINT(clang-analyzer-cplusplus.NewDeleteLeaks): the app is moved out with the program

// The same program, but nothing is required: it tells what a command line gives, and finds unknown
// options and malformed values first.
Program MakeSurvey() {
  Program program = MakeProgram();
  program.app->require_subcommand(0, 1);
  for (const Command& command : program.commands) {
    for (CLI::Option* option : command.app->get_options()) {
      option->required(false);
    }
  }
  return program;
}

void Parse(const Program& program, std::vector<std::string> arguments) {
  std::reverse(arguments.begin(), arguments.end());  // as CLI11 wants them
  program.app->parse(std::move(arguments));
}

// Puts arguments before those that the command was given.
void Insert(const std::vector<std::string>& added, const std::string& command,
            std::vector<std::string>& arguments) {
  const auto name = std::find(arguments.begin(), arguments.end(), command);
  arguments.insert(name + 1, added.begin(), added.end());
}

// Adds what the --config file of the surveyed command holds.
std::vector<std::string> WithConfigFile(const Program& survey, std::vector<std::string> arguments) {
  if (survey.app->get_subcommands().empty()) {
    return arguments;
  }
  const CLI::App& command = *survey.Chosen().app;
  const CLI::Option& config = *command.get_option("--config");
  if (config.count() == 0) {
    return arguments;
  }
  const std::filesystem::path file = config.as<std::string>();
  std::vector<std::string> from_file = ConfigArguments(file, command);
  try {
    std::vector<std::string> alone = from_file;
    alone.insert(alone.begin(), command.get_name());
    Parse(MakeSurvey(), alone);
  } catch (const CLI::ParseError& error) {
    throw InputError(file, error.what());
  }
  Insert(from_file, command.get_name(), arguments);
  return arguments;
}

// Adds what the --scene file of the command says, and lets `program` know its names.
std::vector<std::string> WithSceneFile(const Program& program, std::vector<std::string> arguments) {
  const Program survey = MakeSurvey();
  Parse(survey, arguments);
  if (survey.app->get_subcommands().empty()) return arguments;
  const CLI::App& command = *survey.Chosen().app;
  const CLI::Option* option = command.get_option_no_throw("--scene");
  if (option == nullptr || option->count() == 0) return arguments;
  const SceneFile scene = ReadSceneFile(option->as<std::string>());
  TakeGeometryNames(scene, *program.app->get_subcommand(command.get_name()));
  Insert(SceneArguments(scene, command), command.get_name(), arguments);
  return arguments;
}

// The program that has parsed these arguments and those that their files hold. CLI::ParseError for
// what cannot be parsed, CLI::Success for --help and --version.
Program Parsed(const Program& survey, const std::vector<std::string>& arguments) {
  Program program = MakeProgram();
  Parse(survey, arguments);
  Parse(program, WithSceneFile(program, WithConfigFile(survey, arguments)));
  return program;
}

// "; did you mean NAME?" of the first argument that is no command or option but resembles one.
std::string Hint(const CLI::App& app, const std::vector<std::string>& arguments) {
  if (arguments.empty()) return {};
  std::vector<std::string> commands;
  const CLI::App* command = nullptr;
  for (const CLI::App* known : app.get_subcommands([](const CLI::App*) { return true; })) {
    commands.push_back(known->get_name());
    if (known->get_name() == arguments.front()) command = known;
  }
  if (command == nullptr) return DidYouMean(arguments.front(), commands);
  std::vector<std::string> options;
  for (const CLI::Option* option : command->get_options()) options.push_back(option->get_name());
  for (const std::string& argument : arguments) {
    const std::string name = argument.substr(0, argument.find('='));
    const bool is_known = std::find(options.begin(), options.end(), name) != options.end();
    if (!name.starts_with("--") || is_known) continue;
    const std::string hint = DidYouMean(name, options);
    if (!hint.empty()) return hint;
  }
  return {};
}

constexpr std::string_view kCharacters = "abcdefghijklmnopqrstuvwxyz0123456789_";

std::string OptionOfField(std::string_view field) {
  if (field == "dataset") return "DATASET";
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

int RunProgram(const std::vector<std::string>& arguments) {
  try {
    const Program survey = MakeSurvey();
    try {
      Parsed(survey, arguments).Chosen().run();
    } catch (const CLI::Success& success) {
      return survey.app->exit(success);
    } catch (const CLI::ParseError& error) {
      return Fail(kBadOption, (error.what() + Hint(*survey.app, arguments)).c_str());
    }
  } catch (const OptionError& error) {
    return Fail(kBadOption, MessageInOptions(error).c_str());
  } catch (const OutputError& error) {
    return Fail(kBadOutput, error.what());
  } catch (const InputError& error) {
    return Fail(kBadInput, error.what());
  } catch (const Interrupted& interrupted) {
    return Fail(kInterrupted, interrupted.what());
  } catch (const std::filesystem::filesystem_error& error) {
    return Fail(kBadInput, error.what());
  } catch (const ResourceError& error) {
    return Fail(kNoResources, error.what());
  } catch (const std::bad_alloc&) {
    return Fail(kNoResources, "out of memory");
  } catch (const std::exception& error) {
    std::fprintf(stderr, "raylift: this is a bug: %s\n", error.what());
    return kBug;
  }
  return kDone;
}

void RunCommand(const std::vector<std::string>& arguments) {
  try {
    Parsed(MakeSurvey(), arguments).Chosen().run();
  } catch (const CLI::ParseError& error) {
    throw OptionError(error.what());
  }
}

}  // namespace raylift
