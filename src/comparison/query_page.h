// One query on the page of localize: the photograph, the mesh as seen from the pose, what was matched
// and how far it is off.

#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include <nlohmann/json.hpp>

#include "raylift/localization/localizer.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/scene/image.h"

namespace raylift {

// Pictures are at most this wide.
inline constexpr int kPagePictureWidthPx = 640;

// Counts, verdict, uncertainty and times.
nlohmann::ordered_json QueryFacts(const LocalizedQuery& query);

// Of some 2D-3D and some 2D-2D matches: [x, y, inlier, dx, dy], in pixels of the query. (dx, dy)
// leads to the projected 3D point, or to the nearest point of the epipolar line; it is left out
// where there is no pose or nothing to be seen.
nlohmann::ordered_json PointMarks(const QueryResult& result);
nlohmann::ordered_json PairMarks(const QueryResult& result);

// The reference that most inliers are of, or most matches where none is one: its place among the
// problem's references.
std::optional<size_t> BestReference(const QueryResult& result);
// [x, y, x in the reference, y, inlier].
nlohmann::ordered_json MatchLines(const QueryResult& result, size_t reference);

// What the mesh looks like from the pose, and its edges and creases on a transparent ground, as
// data URIs: {"rendering": ..., "edges": ...}.
nlohmann::ordered_json SeenFromPose(const QueryResult& result, const RayCaster& mesh);

}  // namespace raylift
