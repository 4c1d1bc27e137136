// Writes and prints the results of `raylift localize`.

#pragma once

#include <atomic>
#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "apps/localize_flags.h"
#include "base/lap_clock.h"

#include "raylift/localization/localizer.h"
#include "raylift/localization/result_files.h"
#include "raylift/localization/scene.h"
#include "raylift/report/localization_report.h"

namespace raylift {

class LocalizeOutput {
 public:
  // Throws InputError where something cannot be written, before any work. `mesh` is for pictures,
  // and may be null.
  LocalizeOutput(const LocalizeFlags& flags, size_t num_queries,
                 std::shared_ptr<const RayCaster> mesh);

  // Writes what shows a query beside its pose: its problem, its picture, its part of the page.
  // Returns the files. May be called from any thread.
  std::vector<std::filesystem::path> Show(size_t index, const QueryResult& result);

  // Returns the time that Show() has taken, in seconds summed over all threads.
  double ShowSeconds() const { return show_seconds_; }

  struct Run {
    const Scene& scene;
    std::span<const Query> queries;
    std::span<const std::string> warnings = {};
    RunTimes times = {};
    size_t joined = 0;  // localized queries that became references
    const WalkedQueries* walked = nullptr;
  };
  // Writes all files but poses.txt, queries.jsonl and summary.json, and prints the summary on
  // stdout.
  void Finish(const std::vector<LocalizedQuery>& localized, const Run& run,
              const std::string& options_json) const;

 private:
  void Print(const std::vector<LocalizedQuery>& localized, const Run& run) const;

  const LocalizeFlags& flags_;
  std::filesystem::path query_images_;
  std::shared_ptr<const RayCaster> mesh_;
  std::atomic<double> show_seconds_ = 0;
  std::unique_ptr<LocalizationReport> report_;  // null where none is asked for
};

}  // namespace raylift
