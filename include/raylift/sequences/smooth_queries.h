// Makes one trajectory of the results of single photographs and the odometry of their walk: poses
// are smoothed, photographs without a pose get one from the walk, and poses that contradict it are
// replaced.

#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "raylift/base/enum_names.h"
#include "raylift/localization/localizer.h"
#include "raylift/localization/scene.h"
#include "raylift/sequences/smoothing.h"
#include "raylift/sequences/walk.h"

namespace raylift {

// Tells from the scene's points at some pixels of the references what a camera sees.
class SceneDistances {
 public:
  explicit SceneDistances(const Scene& scene, int threads = 0);

  // Returns the median over the points of the nearest references in the camera's field of view;
  // nullopt where there is none.
  std::optional<double> At(const Camera& camera, const Rigid3& cam_from_world) const;

  // Returns at most `most` references that see the same as the camera from similar directions, the
  // best first, as indices into the scene's; nothing is known of occlusion.
  std::vector<size_t> SeeingAlike(const Camera& camera, const Rigid3& cam_from_world,
                                  size_t most) const;

 private:
  struct Seen {
    size_t reference;
    Eigen::Vector3d center;  // of the reference
    std::vector<Eigen::Vector3d> points;
  };
  std::vector<size_t> NearestTo(const Eigen::Vector3d& center, size_t most) const;

  std::vector<Seen> seen_;
};

// The walk's effect on a photograph's pose.
enum class WalkRole { kAlone, kSmoothed, kReplaced, kRescued, kDisputed, kDropped };
template <>
inline constexpr auto kEnumNames<WalkRole> = std::to_array<EnumName<WalkRole>>({
    {WalkRole::kAlone, "alone", "its result is as it was: it is not in the walk, or that has none"},
    {WalkRole::kSmoothed, "smoothed", "its pose agrees with the walk, which made it more exact"},
    {WalkRole::kReplaced, "replaced", "its pose contradicts the walk, whose pose it has now"},
    {WalkRole::kRescued, "rescued", "it had no pose and has the walk's"},
    {WalkRole::kDisputed, "disputed",
     "its pose contradicts the walk: one of the two is wrong, so it is not sure"},
    {WalkRole::kDropped, "dropped", "its pose contradicts the walk, which has no sure one either"},
});

struct WalkedQuery {
  LocalizedQuery localized;
  WalkRole role = WalkRole::kAlone;
  std::optional<double> time_s = std::nullopt;  // in the walk
  bool lost_before = false;                     // SmoothedFrame::lost_before
  // Whether it was localized again where the walk predicts it, and agrees.
  bool rematched = false;
  // The pose of the photograph by itself, where it had one.
  std::optional<Rigid3> single_cam_from_world = std::nullopt;
  double single_confidence = 0;
};

// The result of smoothing a walk.
struct ToldWalk {
  std::string folder = {};           // Walk::folder
  std::vector<size_t> queries = {};  // its photographs, in the order of their times
  // Holds what smoothing gave; nullopt where it gave nothing.
  std::optional<SmoothedWalk> odometry = std::nullopt;
};

struct WalkedQueries {
  std::vector<WalkedQuery> queries;  // in the given order
  std::vector<ToldWalk> walks;       // in the given order
  std::vector<std::string> warnings;

  size_t Count(WalkRole role) const;
};

// LocalizeAll::LocalizeAgain(); is called from several threads.
using LocalizeAgain = std::function<LocalizedQuery(
    const Query& photograph, std::span<const size_t> references, const Rigid3& cam_from_world,
    const Eigen::Matrix<double, 6, 6>& covariance)>;

struct SmoothingOptions {
  OdometryScale scale = OdometryScale::kKnown;
  double min_confidence = 0;  // LocalizerOptions::min_confidence
  bool online = false;        // each frame by those before it alone, as Tracker has it
  // Photographs that are not sure by themselves are localized again where the rest of the walk
  // predicts them, if this is given and `online` is not set; Tracker does not. It is called once
  // for each walk that has some.
  std::function<LocalizeAgain()> open_localizer = nullptr;
  int threads = 0;  // <= 0: all; never changes the result
};

// Smooths the results `queries` of the photographs, in the order of the names for which the walks
// were read; no two walks share a photograph.
WalkedQueries SmoothQueries(std::span<const LocalizedQuery> queries,
                            std::span<const Query> photographs, std::span<const Walk> walks,
                            const SceneDistances& distances, const SmoothingOptions& options);

// Returns the photograph's line of queries.jsonl, without the line's end: that of the single
// photograph, and the walk's effect.
std::string FormatQueryDiagnostics(const WalkedQuery& query);

// Writes `walk.json`, the results of the walks; `trajectory.txt`, TUM's, of the localized
// photographs of the walk in the order of their times; and `trajectory_covariance.txt`: lines
// `time` and the 21 numbers of the upper triangle, row by row, of the covariance that queries.jsonl
// holds. Walks of a list have trajectory_1.txt, trajectory_covariance_1.txt and so on, in the
// list's order. Such files of a former run that are not written anew are removed.
void WriteWalk(const std::filesystem::path& folder, const WalkedQueries& walked);

// Removes such files where the results are of no walk.
void RemoveWalk(const std::filesystem::path& folder);

}  // namespace raylift
