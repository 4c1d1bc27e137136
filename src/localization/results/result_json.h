// Converts the contents of a run's files to JSON and back (base/json_members.h): `queries.jsonl`,
// `summary.json`, `scene_calibration.json`, manifests, and the output of `raylift estimate`.

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

// Lists all members except the pose itself: confidence, inliers, covariance.
void Members(JsonMembers& members, PoseEstimate& estimate);
void Members(JsonMembers& members, LocalizedQuery& query);

// Writes or reads the member "diagnostics", a query's line of `queries.jsonl`, which may hold more
// than `query` does.
void MembersOfDiagnostics(JsonMembers& members, std::string& line, LocalizedQuery& query);

}  // namespace raylift
