// The whole program: parses, runs one command, turns errors into exit codes.

#include "apps/program.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <map>
#include <memory>
#include <new>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "apps/argument_files.h"
#include "apps/commands.h"
#include "apps/interrupt.h"
#include "apps/mesh_trial.h"
#include <CLI/CLI.hpp>
#include <fmt/format.h>
#include <link.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/io/scene_file.h"
#include "raylift/lifting/geometry_spec.h"

namespace raylift {
namespace {

constexpr std::array<std::string_view, 19> kLibraries = {
    "libassimp.", "libceres.",  "libembree", "libfmt.",  "libhdf5",     "libjpeg.",   "libopencv_",
    "libOpenEXR", "libopenvdb", "libpng",    "libproj.", "libpugixml.", "libraylift", "libsqlite",
    "libstdc++.", "libtbb.",    "libtiff.",  "libwebp.", "libzip."};

int Add(dl_phdr_info* library, size_t, void* names) {
  std::error_code failed;
  const std::string name =
      std::filesystem::canonical(library->dlpi_name, failed).filename().string();
  const bool known = std::any_of(kLibraries.begin(), kLibraries.end(),
                                 [&](std::string_view begin) { return name.starts_with(begin); });
  if (!failed && known) static_cast<std::vector<std::string>*>(names)->push_back(name);
  return 0;  // go on
}

// Returns the names of the loaded shared libraries that do the work, which hold their versions
// ("libembree3.so.3.13.5"), sorted; the libraries that these need in turn are left out.
std::vector<std::string> LoadedLibraries() {
  std::vector<std::string> names;
  dl_iterate_phdr(&Add, &names);
  std::sort(names.begin(), names.end());
  return names;
}

constexpr std::string_view kDescription =
    R"(Raylift finds where photographs were taken in a known scene: a mesh, depth maps or an SfM model.

LOCALIZE PHOTOGRAPHS
  Against a mesh and reference photographs with poses (a COLMAP model):
    raylift localize --model sfm --images photos --geometry mesh:scene.ply \
        --queries queries.txt --query-images new --out result
  Against a mesh alone, which has a texture or vertex colors:
    raylift localize --geometry mesh:scene.ply --queries queries.txt --query-images new --out result
  How good are the poses?
    raylift evaluate --ground-truth truth --poses result/poses.txt --thresholds 0.05,5:0.25,2

COMPARE DEPTH
  Which of meshes, depth maps and networks is best, where, and what is wrong with the others?
    raylift compare --model sfm --geometry scan=mesh:scan.ply --geometry network=depth:maps \
        --truth scan --out comparison --report report
  Is the depth read as it was meant: unit, z or ray, axes, poses?
    raylift doctor --model sfm --images photos --geometry depth:maps

RENDER DEPTH
  Depth maps, normals, color of a mesh for all images of a data set:
    raylift render --model sfm --geometry mesh:scene.ply --out rendered --products depth,normals
  There are no cameras yet: choose some.
    raylift views --geometry mesh:scene.ply --out views

queries.txt holds a photograph per line: NAME MODEL WIDTH HEIGHT PARAMS..., as in COLMAP and hloc.
assets/demo/run.sh tries it on a small scene.
)";

constexpr std::string_view kLocalize = "Localize photographs";
constexpr std::string_view kCompare = "Compare depth";
constexpr std::string_view kRender = "Render depth";
constexpr std::string_view kJobs = "Long runs, in parts";
struct KnownCommand {
  Command (*add)(CLI::App& program);
  std::string_view group;
};
constexpr KnownCommand kCommands[] = {
    {AddLocalizeCommand, kLocalize}, {AddEstimateCommand, kLocalize},
    {AddEvaluateCommand, kLocalize}, {AddPerturbCommand, kCompare},
    {AddRenderCommand, kRender},     {AddCompareCommand, kCompare},
    {AddDoctorCommand, kCompare},    {AddViewsCommand, kRender},
    {AddPairsCommand, kLocalize},    {AddExperimentCommand, kLocalize},
    {AddImportCommand, kLocalize},   {AddStatusCommand, kJobs},
    {AddMergeCommand, kJobs},        {AddVerifyCommand, kJobs},
    {AddExportCommand, kLocalize},   {AddColorCommand, kRender},
    {AddPrepareCommand, kLocalize},  {AddCalibrateCommand, kLocalize},
    {AddFuseCommand, kRender},       {AddServeCommand, kLocalize},
    {AddQueriesCommand, kLocalize},  {AddLocateCommand, kLocalize},
    {AddMapCommand, kLocalize}};

constexpr std::string_view kExitStatus = R"(.SH EXIT STATUS
.TP
0
Done.
.TP
1
A bug.
.TP
2
Options that are wrong or do not go together.
.TP
3
Input that cannot be read or does not hold what is needed.
.TP
4
Work is left: stopped by a signal, or other shards are not done.
.TP
5
Output that cannot be written.
.TP
6
Out of memory, or of threads.
)";

// Escapes the text so that troff takes it as it stands.
std::string Escaped(std::string_view text) {
  std::string escaped;
  bool at_start = true;
  for (const char c : text) {
    if (at_start && (c == '.' || c == '\'')) escaped += "\\&";
    at_start = c == '\n';
    switch (c) {
      case '\\':
        escaped += "\\e";
        break;
      case '-':
        escaped += "\\-";
        break;
      default:
        escaped += c;
    }
  }
  return escaped;
}

std::string Capitals(std::string text) {
  for (char& c : text) c = c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c;
  return text;
}

// Returns the text with its line breaks kept.
std::string AsTyped(std::string_view text) {
  return fmt::format(".nf\n{}\n.fi\n", Escaped(Trim(text)));
}

// Formats manual pages; the names and texts of options are CLI11's, as in --help.
class ManFormatter : public CLI::Formatter {
 public:
  std::string Usage(const CLI::App& app) const { return make_usage(&app, app.get_name()); }

  std::string Option(const CLI::Option& option) const {
    const bool positional = option.get_positional();
    const std::string description = make_option_desc(&option);
    return fmt::format(".TP\n\\fB{}\\fR{}\n{}", Escaped(make_option_name(&option, positional)),
                       Escaped(make_option_opts(&option)), AsTyped(description));
  }
};

std::string Header(const std::string& name, const std::string& what) {
  return fmt::format(".TH {} 1 \"\" \"raylift {}\" \"Raylift\"\n.ad l\n.SH NAME\n{} \\- {}\n",
                     Capitals(name), RAYLIFT_VERSION, Escaped(name), Escaped(what));
}

std::string CommandPage(const CLI::App& command) {
  const ManFormatter formatter;
  std::string page = Header("raylift-" + command.get_name(), command.get_description());
  page += fmt::format(".SH SYNOPSIS\n\\fBraylift {}\\fR [OPTIONS]", command.get_name());
  std::vector<std::string> groups;
  std::map<std::string, std::string> options;
  for (const CLI::Option* option : command.get_options()) {
    if (option->get_group().empty()) continue;
    const std::string group = option->get_positional() ? "Arguments" : option->get_group();
    if (!options.contains(group)) groups.push_back(group);
    options[group] += formatter.Option(*option);
    if (option->get_positional()) page += ' ' + Escaped(option->get_name(true));
  }
  page += '\n';
  for (const std::string& group : groups) {
    page += fmt::format(".SH {}\n{}", Escaped(Capitals(group)), options[group]);
  }
  if (!command.get_footer().empty()) page += ".SH NOTES\n" + AsTyped(command.get_footer());
  return page + std::string(kExitStatus) + ".SH SEE ALSO\n.BR raylift (1)\n";
}

std::string ProgramPage(const CLI::App& program) {
  std::string page =
      Header("raylift", "visual localization against meshes, depth maps and SfM models");
  page += ".SH SYNOPSIS\n\\fBraylift\\fR COMMAND [OPTIONS]\n.SH DESCRIPTION\n" +
          AsTyped(program.get_description()) + ".SH COMMANDS\n";
  for (const CLI::App* command : program.get_subcommands({})) {
    page += fmt::format(".TP\n.BR raylift\\-{} (1)\n{}\n", Escaped(command->get_name()),
                        Escaped(command->get_description()));
  }
  return page + std::string(kExitStatus);
}

// Writes manual pages from the same source as --help: raylift.1 and raylift-COMMAND.1 of each
// command.
void WriteManPages(const CLI::App& program, const std::filesystem::path& folder) {
  WriteFile(folder / "raylift.1", ProgramPage(program));
  for (const CLI::App* command : program.get_subcommands({})) {
    WriteFile(folder / fmt::format("raylift-{}.1", command->get_name()), CommandPage(*command));
  }
}

int Fail(ExitCode code, const char* message) {
  std::fprintf(stderr, "raylift: %s\n", Printable(message).c_str());
  return code;
}

struct Program {
  std::unique_ptr<CLI::App> app;
  std::vector<Command> commands;

  // Returns the command that was parsed.
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
  app.description(std::string(kDescription));
  for (const auto& [add, group] : kCommands) {
    const Command& command = program.commands.emplace_back(add(app));
    command.app->group(std::string(group));
    CheckNumbers(*command.app);
    Translate(*command.app, "--geometry", &GeometrySpecOf);
  }
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

// Makes the program without required options: it tells what a command line gives, and finds unknown
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

// Inserts arguments before those that the command was given.
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
  const std::string crs = GivenText(command, "--crs");
  TakeGeometries(scene, crs.empty() ? scene.crs : crs,
                 *program.app->get_subcommand(command.get_name()));
  Insert(SceneArguments(scene, command), command.get_name(), arguments);
  return arguments;
}

// Returns the command that the first argument names; null where it names none.
const CLI::App* NamedCommand(const CLI::App& app, const std::vector<std::string>& arguments) {
  const auto commands = app.get_subcommands([&](const CLI::App* command) {
    return !arguments.empty() && command->check_name(arguments.front());
  });
  return commands.empty() ? nullptr : commands.front();
}

// Throws OptionError where an option that takes a value is followed by another option of the
// command, which would be its value.
void RequireValues(const CLI::App& app, const std::vector<std::string>& arguments) {
  const CLI::App* const command = NamedCommand(app, arguments);
  if (command == nullptr) return;
  for (size_t i = 1; i + 1 < arguments.size(); ++i) {
    if (!arguments[i].starts_with("--") || !arguments[i + 1].starts_with("--")) continue;
    const CLI::Option* const option = command->get_option_no_throw(arguments[i]);
    const CLI::Option* const next = command->get_option_no_throw(arguments[i + 1]);
    if (option == nullptr || next == nullptr || option->get_items_expected_min() == 0) continue;
    throw OptionError(fmt::format("{0} needs a value, found {1} ({0}={1} would be one)",
                                  arguments[i], arguments[i + 1]));
  }
}

// Returns the program that has parsed these arguments and those that their files hold. Throws
// CLI::ParseError for what cannot be parsed, CLI::Success for --help and --version.
Program Parsed(const Program& survey, const std::vector<std::string>& arguments) {
  Program program = MakeProgram();
  RequireValues(*survey.app, arguments);
  Parse(survey, arguments);
  Parse(program, WithSceneFile(program, WithConfigFile(survey, arguments)));
  return program;
}

// Returns "; did you mean NAME?" for the first argument that is no command or option but resembles
// one; kinds of geometry stand for that option.
std::string Hint(const CLI::App& app, const std::vector<std::string>& arguments) {
  if (arguments.empty()) return {};
  const CLI::App* const command = NamedCommand(app, arguments);
  if (command == nullptr) {
    std::vector<std::string> commands;
    for (const CLI::App* known : app.get_subcommands({})) commands.push_back(known->get_name());
    return DidYouMean(arguments.front(), commands);
  }
  std::vector<std::string> options;
  for (const CLI::Option* option : command->get_options()) options.push_back(option->get_name());
  for (const std::string& argument : arguments) {
    const std::string name = argument.substr(0, argument.find('='));
    const bool is_known = std::find(options.begin(), options.end(), name) != options.end();
    if (!name.starts_with("--") || is_known) continue;
    const std::string kind = name.substr(2);
    const bool takes_geometry =
        std::find(options.begin(), options.end(), "--geometry") != options.end();
    if (takes_geometry && (kind == "mesh" || kind == "dsm" || kind == "cloud" || kind == "splat" ||
                           kind == "depth")) {
      return fmt::format("; did you mean --geometry {}:PATH?", kind);
    }
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
  if (arguments.size() == 2 && arguments[0] == kTryMesh) return TryMesh(arguments[1]);
  try {
    const SignalGuard signals;
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

std::map<std::string, std::map<std::string, std::string>> KindsOfCommands() {
  const Program program = MakeProgram();
  std::map<std::string, std::map<std::string, std::string>> kinds;
  for (const Command& command : program.commands) {
    kinds[NameOf(*command.app)] = KindsOfOptions(*command.app);
  }
  return kinds;
}

void RunCommand(const std::vector<std::string>& all_arguments) {
  const Program survey = MakeSurvey();
  std::vector<std::string> arguments = all_arguments;
  // The options of a command that does not exist tell nothing.
  const bool is_known = arguments.empty() || arguments.front().starts_with('-') ||
                        NamedCommand(*survey.app, arguments) != nullptr;
  if (!is_known) arguments.resize(1);
  try {
    Parsed(survey, arguments).Chosen().run();
  } catch (const CLI::Success& success) {  // --help, --version
    survey.app->exit(success);
  } catch (const CLI::ParseError& error) {
    throw OptionError(error.what() + Hint(*survey.app, arguments));
  }
}

}  // namespace raylift
