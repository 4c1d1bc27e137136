#include "apps/program_help.h"

#include <algorithm>
#include <array>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>
#include <fmt/format.h>

#include "raylift/base/file.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

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
constexpr std::array<std::pair<std::string_view, std::string_view>, 17> kGroupOfCommand = {
    {{"localize", kLocalize},
     {"prepare", kLocalize},
     {"estimate", kLocalize},
     {"evaluate", kLocalize},
     {"export", kLocalize},
     {"pairs", kLocalize},
     {"import", kLocalize},
     {"experiment", kLocalize},
     {"compare", kCompare},
     {"doctor", kCompare},
     {"perturb", kCompare},
     {"render", kRender},
     {"views", kRender},
     {"color", kRender},
     {"status", kJobs},
     {"merge", kJobs},
     {"verify", kJobs}}};

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

// So that troff takes the text as it stands.
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

// Lines as they are broken.
std::string AsTyped(std::string_view text) {
  return fmt::format(".nf\n{}\n.fi\n", Escaped(Trim(text)));
}

// What each option is called and says is CLI11's, as in --help.
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

}  // namespace

void AddProgramHelp(CLI::App& program) {
  program.description(std::string(kDescription));
  for (CLI::App* command : program.get_subcommands([](const CLI::App*) { return true; })) {
    const auto* known =
        std::find_if(kGroupOfCommand.begin(), kGroupOfCommand.end(),
                     [command](const auto& entry) { return entry.first == command->get_name(); });
    command->group(known == kGroupOfCommand.end() ? "More" : std::string(known->second));
  }
}

void WriteManPages(const CLI::App& program, const std::filesystem::path& folder) {
  WriteFile(folder / "raylift.1", ProgramPage(program));
  for (const CLI::App* command : program.get_subcommands({})) {
    WriteFile(folder / fmt::format("raylift-{}.1", command->get_name()), CommandPage(*command));
  }
}

}  // namespace raylift
