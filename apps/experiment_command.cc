// raylift experiment: runs a grid that a file describes, and writes its tables.

#include <cstdlib>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apps/commands.h"
#include "apps/interrupt.h"
#include "apps/job_options.h"
#include "apps/options.h"
#include "base/hash.h"
#include "base/json_text.h"
#include "base/progress.h"
#include "experiment/pivot.h"
#include "experiment/results.h"
#include "jobs/file_promises.h"
#include "jobs/manifest_file.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/experiment/experiment.h"
#include "raylift/experiment/run_cells.h"
#include "raylift/jobs/task_job.h"

namespace raylift {
namespace {

using std::filesystem::path;

struct ExperimentFlags {
  std::filesystem::path file, out;
  std::string datasets;
  std::vector<std::string> variables;  // NAME=VALUE
  bool own_features = false;
  bool dry_run = false;
  RunFlags run;
  JobFlags running;
};

// Returns a lookup of variables: --set first, then --datasets, then the environment.
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
    if (const char* of_environment = std::getenv(name.c_str())) return of_environment;
    throw InputError(fmt::format(
        "${{{}}} is not set (--datasets DIR, --set NAME=VALUE or the environment)", name));
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
        cells_folder_(flags.out / "cells"),
        store_(cells_folder_) {}

  // Prints what would be done, and what is missing for it.
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

  void Run(const std::string& options_json) const {
    for (const path& file : MissingInputs(experiment_, estimated_)) {
      throw InputError(experiment_.file, fmt::format("{} does not exist", file.string()));
    }
    RequireWritable(flags_.out / "results.csv");
    std::vector<Cell> cells;
    UntilSignal([&] { cells = ListCells(experiment_, estimated_); });
    const std::string header = Header(options_json, cells);
    // Cells are named by their contents: there is nothing that a former run could have otherwise.
    JobFolder folder = flags_.running.In(flags_.out);
    folder.overwrite = true;
    TaskJob job(NamesOf(cells), header, folder,
                {.results = {}, .is_readable = [](const std::string&) { return true; }});
    job.Begin(std::nullopt);
    WriteFile(flags_.out / "options.json", OptionsOfResults(options_json));
    const size_t estimated = Estimate(cells, folder.shard, job);
    job.Whole();  // throws where what was estimated is gone
    const bool complete = folder.shard.IsAll() || Undone(cells).empty();
    if (!folder.shard.IsAll() && !flags_.run.quiet) {
      fmt::print("shard {}/{} of {} cells: {} estimated now{}\n", folder.shard.index,
                 folder.shard.count, cells.size(), estimated,
                 complete ? "; all shards are complete" : "");
    }
    if (!complete) return;
    const CommittedFiles results;
    WriteResults(cells);
    job.Finish(WholeManifest(header, cells, job), results.paths());
    if (!flags_.run.quiet) {
      fmt::print("{} cells estimated, {} were there: {}\n", estimated, cells.size() - estimated,
                 (flags_.out / "index.html").string());
    }
  }

  // Writes the results from the cells of the parts, which must be all.
  void Merge(const std::string& options_json, const std::vector<path>& parts) const {
    const std::vector<Cell> cells = ListCells(experiment_, estimated_);
    const std::string header = Header(options_json, cells);
    for (const path& part : parts) {
      const std::string of_part = ReadManifestText(part).header;
      if (of_part != header) {
        throw InputError(part, fmt::format("the experiment or its inputs are others now ({})",
                                           HeaderDifference(of_part, header)));
      }
      for (const Cell& cell : Undone(cells)) {
        const auto outcomes = CellStore(part.parent_path() / cells_folder_.filename()).Read(cell);
        if (outcomes) store_.Write(cell, *outcomes);
      }
    }
    if (const size_t left = Undone(cells).size(); left > 0) {
      throw Interrupted(fmt::format("{} of {} cells are not done in these parts: nothing is merged",
                                    left, cells.size()));
    }
    Run(options_json);
  }

 private:
  static std::string Header(const std::string& options_json, const std::vector<Cell>& cells) {
    std::string keys;
    for (const Cell& cell : cells) keys += cell.Key() + '\n';
    return JobHeader(nlohmann::ordered_json::parse(options_json), cells.size(),
                     {"file", "datasets", "set", "dry-run"},
                     {{"cells", HexText(HashBytes64(keys))}});
  }

  static std::vector<std::string> NamesOf(const std::vector<Cell>& cells) {
    std::vector<std::string> names;
    names.reserve(cells.size());
    for (const Cell& cell : cells) {
      names.push_back(fmt::format("{} offset={} seed={} queries={}-{}", cell.setting.Name(),
                                  cell.offset, cell.seed, cell.begin, cell.end));
    }
    return names;
  }

  std::string LineOf(size_t place, const Cell& cell, const TaskJob& job) const {
    return JsonText(nlohmann::ordered_json{
        {"name", NamesOf({cell}).front()},
        {"place", place},
        {"key", job.key(place)},
        {"cell", cell.Key()},
        {"files", FilesJson(PromiseFiles(flags_.out, std::vector<path>{store_.FileOf(cell)}))}});
  }

  TaskManifest WholeManifest(const std::string& header, const std::vector<Cell>& cells,
                             const TaskJob& job) const {
    TaskManifest whole;
    whole.header = header;
    for (size_t i = 0; i < cells.size(); ++i) {
      whole.records.emplace(job.key(i), TaskRecord{i, LineOf(i, cells[i], job)});
    }
    return whole;
  }

  std::vector<Cell> Undone(const std::vector<Cell>& cells) const {
    std::vector<Cell> undone;
    for (const Cell& cell : cells) {
      if (!store_.Has(cell)) undone.push_back(cell);
    }
    return undone;
  }

  // Estimates the shard's cells that are not done; returns how many.
  size_t Estimate(const std::vector<Cell>& cells, const Shard& shard, TaskJob& job) const {
    std::map<std::string, size_t> place_of_key;
    std::vector<Cell> undone;
    size_t estimates = 0;
    for (size_t i = 0; i < cells.size(); ++i) {
      if (!shard.Contains(i)) continue;
      if (!flags_.running.overwrite && store_.Has(cells[i])) {
        job.Add(i, LineOf(i, cells[i], job));
        continue;
      }
      place_of_key.emplace(cells[i].Key(), i);
      undone.push_back(cells[i]);
      estimates += cells[i].end - cells[i].begin;
    }
    Progress progress("estimates", estimates, flags_.run.Show());
    const auto run = [&] {
      PrintWarnings(RunCells(experiment_, undone, store_,
                             {.cache = flags_.out / "cache",
                              .threads = flags_.run.threads,
                              .on_estimate = [&progress] { progress.Advance(); },
                              .on_cell =
                                  [&](const Cell& cell) {
                                    const size_t place = place_of_key.at(cell.Key());
                                    job.Add(place, LineOf(place, cell, job));
                                  }}));
    };
    UntilSignal(run, [&job] {
      return fmt::format("stopped by a signal with {} cells left; the same command goes on",
                         job.Missing().size());
    });
    return undone.size();
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
    for (const TableLayout& layout : experiment_.figures) {
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
  path cells_folder_;
  CellStore store_;
};

// Reads the flags of a run from its options.json, but for --out and how the work was shared. Throws
// InputError where it is no such file.
ExperimentFlags ReadExperimentFlags(const path& options_json) {
  try {
    const auto options = nlohmann::json::parse(ReadFile(options_json));
    ExperimentFlags flags;
    flags.file = options.at("file").get<std::string>();
    if (!options.at("datasets").is_null()) flags.datasets = options["datasets"];
    flags.variables = options.at("set").get<std::vector<std::string>>();
    flags.own_features = options.at("own-features");
    return flags;
  } catch (const nlohmann::json::exception& error) {
    throw InputError(options_json, "is not what experiment writes: " + std::string(error.what()));
  }
}

}  // namespace

void MergeExperiment(const path& out, const std::vector<path>& parts) {
  const path options = parts.front().parent_path() / "options.json";
  ExperimentFlags flags = ReadExperimentFlags(options);
  flags.out = out;
  ExperimentRun(flags).Merge(ReadFile(options), parts);
}

Command AddExperimentCommand(CLI::App& program) {
  auto flags = std::make_shared<ExperimentFlags>();
  CLI::App& command =
      AddCommand(program, "experiment",
                 "Many ways to localize, from one file: a grid, its tables and its claims");
  const OptionGroup options(command);
  options.Add("file", flags->file, "The experiment, TOML (see assets/experiments)").Required();
  const OptionGroup input(command, "Input");
  input.Add("--datasets", flags->datasets,
            "Folder of the data sets: ${DATASETS} in the file (default: of the environment)");
  input
      .Add("--set", flags->variables,
           "NAME=VALUE, repeated: ${NAME} in the file (default: of the environment)")
      .OnePerUse();
  input.Flag("--own-features", flags->own_features,
             "RootSIFT and VLAD made here instead of the file's features, matches and pairs");
  const OptionGroup output(command, "Output");
  output
      .Add("--out", flags->out,
           "Folder for tables, figures, claims.md, results.csv, index.html, and for\n"
           "cells: what is there already is not estimated again")
      .Required();
  const OptionGroup running(command, "Running");
  running.Flag("--dry-run", flags->dry_run, "Only list the grid and the inputs that are missing");
  AddJobOptions(command, flags->running,
                "What is there already is kept in any case; the option is for scripts",
                "Estimate all cells anew");
  AddRunOptions(command, flags->run);
  SetFooter(
      command,
      R"(A cell is one setting with one seed on up to 256 queries; each is kept the moment it is done.
A signal ends the run after the queries in hand (exit code 4); the same command goes on.
With --shard the cells are dealt in turn; the tables are written by the last shard of a
folder, or by `raylift merge` of folders of their own, where the experiment's file and data
must be there under the same paths.
Examples:
  raylift experiment assets/experiments/demo.toml --out out/experiment
  raylift experiment assets/experiments/table1_aachen_scores.toml --datasets /data \
      --out out/table1)");
  return {&command, [flags, &command] {
            flags->run.Check();
            flags->running.Check();
            if (flags->dry_run) {
              ExperimentRun(*flags).List();
            } else {
              ExperimentRun(*flags).Run(EffectiveOptionsJson(command));
            }
          }};
}

}  // namespace raylift
