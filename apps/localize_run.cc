#include "apps/localize_run.h"

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "apps/interrupt.h"
#include "apps/job_options.h"
#include "apps/lap_clock.h"
#include "apps/localize_continuous.h"
#include "apps/localize_header.h"
#include "apps/localize_inputs.h"
#include "apps/localize_output.h"
#include "base/progress.h"
#include <fmt/format.h>

#include "raylift/base/file.h"
#include "raylift/localization/query_job.h"
#include "raylift/localization/result_files.h"

namespace raylift {
namespace {

// One command's work. A signal ends what comes before the first query.
class LocalizeRun {
 public:
  LocalizeRun(const LocalizeFlags& flags, BatchOptions options, const std::string& options_json)
      : flags_(flags), options_(std::move(options)), options_json_(options_json) {
    RefuseOtherMode(flags);
    RefuseFormerRun(flags.running.In(flags.out), QueryJobForm());
    UntilSignal([this] {
      LocalizeInputs inputs = OpenLocalizeInputs(flags_);
      scene_ = std::move(inputs.scene);
      queries_ = std::move(inputs.queries);
    });
    times_.reading = clock_.Lap();
    warnings_ = scene_.warnings;
    const CandidateOptions& candidates = options_.localizer.candidates;
    if (candidates.mode == CandidateMode::kTriangulate && !scene_.sources.empty()) {
      warnings_.emplace_back(
          "--candidates triangulate lifts nothing: --geometry is not used for points");
    }
    output_ = std::make_unique<LocalizeOutput>(flags, queries_.size(), scene_.Surface());
  }

  void Run() {
    if (flags_.continuous.enabled) {
      LocalizeContinuously(
          flags_, {scene_, queries_, options_, warnings_, options_json_, clock_, times_}, *output_);
    } else {
      RunAsJob();
    }
  }

 private:
  void RunAsJob() {
    QueryJob job(queries_, LocalizeHeader(flags_, options_json_, scene_, queries_),
                 flags_.running.In(flags_.out));
    const std::vector<size_t> missing = job.Missing();
    if (!missing.empty() || !job.facts()) {
      std::unique_ptr<BatchLocalizer> localizer;
      UntilSignal([&] {
        if (job.facts()) options_.knowledge = job.facts()->knowledge;
        localizer = OpenLocalizer(flags_, scene_, queries_, options_);
        times_.matching = clock_.Lap();
        localizer->Learn();
        times_.learning = clock_.Lap();
      });
      job.Begin(FactsOf(*localizer));
      WriteFile(flags_.out / "options.json", OptionsOfResults(options_json_));
      Localize(*localizer, missing, job);
      times_.queries = clock_.Lap();
      times_.writing = output_->ShowSeconds();
      scene_ = localizer->scene();
    }
    Finish(job, missing.size());
  }

  RunFacts FactsOf(BatchLocalizer& localizer) const {
    const Scene& scene = localizer.scene();
    return {.num_references = scene.references.images.size(),
            .geometry = SummaryOf(scene.sources),
            .warnings = warnings_,
            .checks_geometry = localizer.ChecksGeometry(),
            .knowledge = localizer.Learn()};
  }

  void Localize(BatchLocalizer& localizer, const std::vector<size_t>& missing, QueryJob& job) {
    Progress progress("queries", missing.size(), flags_.run.Show());
    localizer.Localize(
        missing,
        [&](size_t i, const QueryResult& result) {
          output_->Show(i, result);
          job.Add(i, result.localized, localizer.MatchWarnings(), localizer.LogFocalFactor(i));
          progress.Advance();
        },
        &SignalGuard::stop());
    if (const size_t left = job.Missing().size(); left > 0) {
      throw Interrupted(
          fmt::format("stopped by a signal with {} queries left; --resume goes on", left));
    }
  }

  void Finish(QueryJob& job, size_t done) {
    const Shard shard = flags_.running.Resolve();
    const auto records = job.Finish();
    if (!shard.IsAll() && !flags_.run.quiet) {
      fmt::print("shard {}/{} of {} queries: {} localized now{}\n", shard.index, shard.count,
                 queries_.size(), done, records ? "; all shards are complete" : "");
    }
    if (!records) return;
    const std::vector<std::string> warnings = AllWarnings(*job.facts(), *records);
    PrintWarnings(warnings);
    WriteResults(flags_.out, *job.facts(), *records, times_);
    std::vector<LocalizedQuery> localized;
    for (const QueryRecord& record : *records) localized.push_back(record.localized);
    output_->Finish(localized, {scene_, queries_, warnings, times_},
                    OptionsOfResults(options_json_));
  }

  const SignalGuard signals_;
  const LocalizeFlags& flags_;
  BatchOptions options_;
  const std::string& options_json_;
  std::vector<Query> queries_;
  Scene scene_;
  std::vector<std::string> warnings_;
  std::unique_ptr<LocalizeOutput> output_;
  LapClock clock_;
  RunTimes times_;
};

}  // namespace

void RunLocalize(const LocalizeFlags& flags, const LocalizerOptions& options, AlignMode align,
                 const std::string& options_json) {
  LocalizeRun(flags,
              {.localizer = options,
               .align = align,
               .check_input = !flags.no_doctor,
               .threads = flags.run.threads},
              options_json)
      .Run();
}

}  // namespace raylift
