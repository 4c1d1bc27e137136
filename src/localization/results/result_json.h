// What the files of a run hold, in JSON both ways (base/json_members.h): `queries.jsonl`,
// `summary.json`, `scene_calibration.json`, manifests, and what `raylift estimate` writes.

#pragma once

#include "base/json_members.h"

#include "raylift/localization/localizer.h"
#include "raylift/localization/result_files.h"
#include "raylift/localization/scene_calibration.h"

namespace raylift {

struct QueryStage {
  const char* name;
  double StageTimes::*milliseconds;
};
inline constexpr QueryStage kQueryStages[] = {{"match", &StageTimes::match_ms},
                                              {"lift", &StageTimes::lift_ms},
                                              {"filter", &StageTimes::filter_ms},
                                              {"estimate", &StageTimes::estimate_ms},
                                              {"rerender", &StageTimes::rerender_ms}};
void Members(JsonMembers& members, StageTimes& times);

void Members(JsonMembers& members, MapAlignment& map);
void Members(JsonMembers& members, SceneNoise& noise);
void Members(JsonMembers& members, SceneCalibration& calibration);
void Members(JsonMembers& members, GeometrySummary& used);

// But for the pose itself: how sure it is, what it rests on, its covariance.
void Members(JsonMembers& members, PoseEstimate& estimate);
void Members(JsonMembers& members, LocalizedQuery& query);

// The member "diagnostics" is a query's line of `queries.jsonl`, which may say more than `query`
// holds.
void MembersOfDiagnostics(JsonMembers& members, std::string& line, LocalizedQuery& query);

}  // namespace raylift
