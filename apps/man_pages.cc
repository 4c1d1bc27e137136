#include "man_pages.h"

#include <map>
#include <string>
#include <string_view>
#include <vector>

#include <CLI/CLI.hpp>
#include <fmt/format.h>

#include "raylift/base/file.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

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

void WriteManPages(const CLI::App& program, const std::filesystem::path& folder) {
  WriteFile(folder / "raylift.1", ProgramPage(program));
  for (const CLI::App* command : program.get_subcommands({})) {
    WriteFile(folder / fmt::format("raylift-{}.1", command->get_name()), CommandPage(*command));
  }
}

}  // namespace raylift
