#include "apps/localize_continuous.h"

#include <filesystem>
#include <memory>
#include <system_error>
#include <utility>

#include "apps/interrupt.h"
#include "apps/job_options.h"
#include "apps/localize_inputs.h"
#include "base/progress.h"
#include "jobs/manifest_file.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/localization/continuous_localizer.h"
#include "raylift/localization/query_job.h"
#include "raylift/localization/result_files.h"

namespace raylift {
namespace {

// Also writes queries.jsonl, whose lines say which queries joined the references.
ContinuousRecords LocalizeInOrder(const LocalizeFlags& flags, BatchLocalizer& localizer,
                                  LocalizeOutput& output, const std::string& options_json) {
  const ReferenceSet& references = localizer.scene().references;
  const std::vector<size_t> order = flags.continuous.Order(localizer.queries(), references);
  const ContinuousCheckpoint checkpoint(
      flags.out / "continuous",
      ContinuousRunKey(options_json, references, localizer.queries(), order), flags.running.resume);
  Progress progress("queries", order.size(), flags.run.Show());
  ContinuousRecords records =
      localizer.LocalizeContinuously({.order = order,
                                      .checkpoint = checkpoint,
                                      .gate = flags.continuous.Gate(),
                                      .weigh = !flags.continuous.trust_joined,
                                      .stop = &SignalGuard::stop(),
                                      .on_done = [&](size_t i, const QueryResult* result) {
                                        if (result != nullptr) output.Show(i, *result);
                                        progress.Advance();
                                      }});
  if (const size_t left = CountMissing(records); left > 0) {
    throw Interrupted(
        fmt::format("stopped by a signal with {} queries left; --resume goes on", left));
  }
  WriteQueryDiagnostics(flags.out / "queries.jsonl", records);
  return records;
}

}  // namespace

void RefuseOtherMode(const LocalizeFlags& flags) {
  const std::filesystem::path checkpoint = flags.out / "continuous";
  const std::vector<std::filesystem::path> manifests = ListManifests(flags.out);
  const bool continuous = flags.continuous.enabled;
  std::error_code ignored;
  const bool other_is_there =
      continuous ? !manifests.empty() : std::filesystem::exists(checkpoint, ignored);
  if (!other_is_there) return;
  if (!flags.running.overwrite) {
    throw OptionError("--out", flags.out.string(),
                      fmt::format("holds a former run {} --continuous; --overwrite removes it",
                                  continuous ? "without" : "with"));
  }
  std::filesystem::remove_all(checkpoint, ignored);
  for (const auto& manifest : manifests) std::filesystem::remove(manifest, ignored);
}

void LocalizeContinuously(const LocalizeFlags& flags, const ContinuousInputs& inputs,
                          LocalizeOutput& output) {
  LapClock clock = inputs.clock;
  RunTimes times = inputs.times;
  std::unique_ptr<BatchLocalizer> localizer;
  UntilSignal(
      [&] { localizer = OpenLocalizer(flags, inputs.scene, inputs.queries, inputs.options); });
  times.matching = clock.Lap();
  std::vector<LocalizedQuery> localized;
  size_t joined = 0;
  for (auto& record : LocalizeInOrder(flags, *localizer, output, inputs.options_json)) {
    joined += record->joined ? 1 : 0;
    localized.push_back(std::move(record->localized));
  }
  std::vector<std::string> warnings = inputs.warnings;
  for (std::string& warning : localizer->ContinuousWarnings(localized)) {
    warnings.push_back(std::move(warning));
  }
  PrintWarnings(warnings);
  const Scene& scene = localizer->scene();
  times.queries = clock.Lap();
  times.writing = output.ShowSeconds();
  WritePoses(flags.out / "poses.txt", localized);
  WriteSummary(flags.out / "summary.json", localized,
               {.num_references = scene.references.images.size(),
                .geometry = SummaryOf(scene.sources),
                .warnings = warnings});
  WriteTiming(flags.out / "timing.jsonl", localized, times);
  output.Finish(localized, {scene, inputs.queries, warnings, times, joined},
                OptionsOfResults(inputs.options_json));
}

}  // namespace raylift
