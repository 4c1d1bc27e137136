// raylift experiment: a file that describes a grid in, its tables out.

#include <cstdlib>
#include <memory>

#include "commands.h"
#include "options.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/progress.h"
#include "raylift/experiment/cell_store.h"
#include "raylift/experiment/cells.h"
#include "raylift/experiment/claims.h"
#include "raylift/experiment/experiment_file.h"
#include "raylift/experiment/experiment_report.h"
#include "raylift/experiment/grid.h"
#include "raylift/experiment/pivot.h"
#include "raylift/experiment/results.h"
#include "raylift/experiment/run_cells.h"

namespace raylift {
namespace {

using std::filesystem::path;

struct ExperimentFlags {
  path file, out;
  std::string datasets;
  std::vector<std::string> variables;  // NAME=VALUE
  bool own_features = false;
  bool dry_run = false;
  RunFlags run;
};

// --set first, then --datasets, then the environment.
VariableLookup Variables(const ExperimentFlags& flags) {
  std::map<std::string, std::string> known;
  if (!flags.datasets.empty()) known["DATASETS"] = std::filesystem::absolute(flags.datasets);
  for (const std::string& text : flags.variables) {
    const size_t equals = text.find('=');
    if (equals == 0 || equals == std::string::npos) {
      throw OptionError("--set", text, "expected NAME=VALUE");
    }
    known[text.substr(0, equals)] = text.substr(equals + 1);
  }
  return [known](const std::string& name) -> std::optional<std::string> {
    const auto found = known.find(name);
    if (found != known.end()) return found->second;
    const char* of_environment = std::getenv(name.c_str());
    return of_environment != nullptr ? std::optional<std::string>(of_environment) : std::nullopt;
  };
}

Experiment ReadWithOptions(const ExperimentFlags& flags) {
  Experiment experiment = ReadExperiment(flags.file, Variables(flags));
  if (!flags.own_features) return experiment;
  for (ExperimentScene& scene : experiment.scenes) {
    if (scene.images.empty() && !scene.file_is_missing) {
      throw InputError(experiment.file, "scenes." + scene.name + ".images",
                       "is missing: --own-features needs it");
    }
    for (path* file : {&scene.features, &scene.matches, &scene.pairs}) file->clear();
  }
  return experiment;
}

class ExperimentRun {
 public:
  explicit ExperimentRun(const ExperimentFlags& flags)
      : flags_(flags),
        experiment_(ReadWithOptions(flags)),
        settings_(ExpandGrid(experiment_)),
        estimated_(SettingsToEstimate(settings_, experiment_)),
        store_(flags.out / "cells") {}

  // What would be done, and what is missing for it.
  void List() const {
    const std::vector<path> missing = MissingInputs(experiment_, estimated_);
    for (const Setting& setting : settings_) fmt::print("{}\n", setting.Name());
    fmt::print("{} settings x {} seeds, {} of them to estimate\n", settings_.size(),
               experiment_.seeds.size(), estimated_.size());
    for (const path& file : missing) fmt::print("missing: {}\n", file.string());
    if (!missing.empty()) return;
    const std::vector<Cell> cells = ListCells(experiment_, estimated_);
    fmt::print("{} of {} cells are done\n", cells.size() - Undone(cells).size(), cells.size());
  }

  void Run(const std::string& options_json) {
    for (const path& file : MissingInputs(experiment_, estimated_)) {
      throw InputError(experiment_.file, fmt::format("{} does not exist", file.string()));
    }
    RequireWritable(flags_.out / "results.csv");
    const std::vector<Cell> cells = ListCells(experiment_, estimated_);
    const std::vector<Cell> undone = Undone(cells);
    Estimate(undone);
    WriteFile(flags_.out / "options.json", options_json);
    WriteResults(cells);
    if (!flags_.run.quiet) {
      fmt::print("{} cells estimated, {} were there: {}\n", undone.size(),
                 cells.size() - undone.size(), (flags_.out / "index.html").string());
    }
  }

 private:
  std::vector<Cell> Undone(const std::vector<Cell>& cells) const {
    std::vector<Cell> undone;
    for (const Cell& cell : cells) {
      if (!store_.Has(cell)) undone.push_back(cell);
    }
    return undone;
  }

  void Estimate(const std::vector<Cell>& cells) const {
    size_t estimates = 0;
    for (const Cell& cell : cells) estimates += cell.end - cell.begin;
    Progress progress("estimates", estimates,
                      flags_.run.quiet ? Progress::Show::kNever : Progress::Show::kAuto);
    const auto warnings = RunCells(experiment_, cells, store_,
                                   {.cache = flags_.out / "cache",
                                    .threads = flags_.run.threads,
                                    .on_estimate = [&progress] { progress.Advance(); }});
    for (const std::string& warning : warnings) PrintWarning(warning);
  }

  void WriteResults(const std::vector<Cell>& cells) const {
    const auto results = CollectResults(experiment_, settings_, cells, store_);
    WriteFile(flags_.out / "results.csv", FormatResultsCsv(results));
    std::vector<PivotTable> tables;
    for (const TableLayout& layout : experiment_.tables) {
      const PivotTable& table = tables.emplace_back(MakePivot(experiment_, layout, results));
      const path stem = flags_.out / "tables" / layout.name;
      WriteFile(stem.string() + ".md", FormatPivotMarkdown(table));
      WriteFile(stem.string() + ".csv", FormatPivotCsv(table));
      WriteFile(stem.string() + ".tex", FormatPivotLatex(table));
      if (!flags_.run.quiet) fmt::print("{}\n", FormatPivotText(table));
    }
    for (const FigureLayout& layout : experiment_.figures) {
      WriteFile(flags_.out / "figures" / (layout.name + ".csv"),
                FormatFigureCsv(experiment_, layout, results));
    }
    const std::vector<JudgedClaim> claims = JudgeClaims(experiment_, results);
    if (!claims.empty()) {
      WriteFile(flags_.out / "claims.md", FormatClaimsMarkdown(claims));
      WriteFile(flags_.out / "claims.csv", FormatClaimsCsv(claims));
      if (!flags_.run.quiet) fmt::print("{}\n", FormatClaimsText(claims));
    }
    WriteFile(flags_.out / "index.html",
              FormatExperimentPage(experiment_, tables, results, claims));
    const size_t submissions =
        WriteSubmissions(flags_.out / "submissions", experiment_, settings_, cells, store_);
    if (submissions > 0 && !flags_.run.quiet) {
      fmt::print(
          "{} files of poses of scenes without ground truth, for the benchmark's server: {}\n",
          submissions, (flags_.out / "submissions").string());
    }
  }

  const ExperimentFlags& flags_;
  Experiment experiment_;
  std::vector<Setting> settings_;
  std::vector<Setting> estimated_;
  CellStore store_;
};

}  // namespace

Command AddExperimentCommand(CLI::App& program) {
  auto flags = std::make_shared<ExperimentFlags>();
  CLI::App* command = program.add_subcommand(
      "experiment", "Many ways to localize, from one file: a grid, its tables and its claims");
  command->add_option("file", flags->file, "The experiment, TOML (see assets/experiments)")
      ->required();
  command
      ->add_option("--datasets", flags->datasets,
                   "Folder of the data sets: ${DATASETS} in the file (default: of the environment)")
      ->group("Input");
  command
      ->add_option("--set", flags->variables,
                   "NAME=VALUE, repeated: ${NAME} in the file (default: of the environment)")
      ->allow_extra_args(false)
      ->group("Input");
  command
      ->add_flag("--own-features", flags->own_features,
                 "RootSIFT and VLAD made here instead of the file's features, matches and pairs")
      ->group("Input");
  command
      ->add_option("--out", flags->out,
                   "Folder for tables, figures, claims.md, results.csv, index.html, and for\n"
                   "cells: what is there already is not estimated again")
      ->required()
      ->group("Output");
  command
      ->add_flag("--dry-run", flags->dry_run, "Only list the grid and the inputs that are missing")
      ->group("Running");
  AddRunOptions(*command, flags->run);
  command->footer(
      "Examples:\n"
      "  raylift experiment assets/experiments/demo.toml --out out/experiment\n"
      "  raylift experiment assets/experiments/table1_aachen_scores.toml --datasets /data \\\n"
      "      --out out/table1");
  return {command, [flags, command] {
            flags->run.Check();
            ExperimentRun run(*flags);
            if (flags->dry_run) {
              run.List();
            } else {
              run.Run(EffectiveOptionsJson(*command));
            }
          }};
}

}  // namespace raylift
