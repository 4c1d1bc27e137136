#include "apps/localize_walk.h"

#include <cstdio>
#include <string>
#include <utility>

#include <fmt/format.h>

#include "raylift/base/file.h"

namespace raylift {

Walk OpenWalk(const LocalizeFlags& flags, std::span<const Query> queries) {
  std::vector<std::string> names;
  for (const Query& query : queries) names.push_back(query.name);
  return ReadWalk(flags.walk.odometry, flags.times, names, flags.walk.cam_from_body);
}

WalkedQueries SmoothRecords(const LocalizeFlags& flags, const Walk& walk, const Scene& scene,
                            std::span<const Query> queries, std::vector<QueryRecord>& records) {
  std::vector<LocalizedQuery> alone;
  for (QueryRecord& record : records) alone.push_back(std::move(record.localized));
  WalkedQueries walked =
      SmoothQueries(alone, queries, walk, SceneDistances(scene, flags.run.threads),
                    {.scale = flags.walk.scale,
                     .min_confidence = flags.min_confidence,
                     .online = flags.walk.online});
  for (size_t i = 0; i < records.size(); ++i) {
    records[i].localized = walked.queries[i].localized;
    records[i].diagnostics = FormatQueryDiagnostics(walked.queries[i]);
  }
  return walked;
}

void WriteWalk(const std::filesystem::path& folder, const std::optional<WalkedQueries>& walked) {
  if (!walked) {
    RemoveWalkFiles(folder);
    return;
  }
  WriteFile(folder / "walk.json", FormatWalk(*walked));
  WriteTrajectory(folder, *walked);
}

void PrintWalk(const WalkedQueries& walked) {
  fmt::print("walk: {} poses smoothed, {} rescued, {} replaced, {} dropped",
             walked.Count(WalkRole::kSmoothed), walked.Count(WalkRole::kRescued),
             walked.Count(WalkRole::kReplaced), walked.Count(WalkRole::kDropped));
  if (walked.walk) {
    const SmoothedWalk& walk = *walked.walk;
    fmt::print("; odometry's scale {:.4g}, noise of a step {:.2g} and {:.2g} degrees", walk.scale,
               walk.step_sigma, walk.step_rotation_sigma_deg);
  }
  fmt::print("\n");
}

}  // namespace raylift
