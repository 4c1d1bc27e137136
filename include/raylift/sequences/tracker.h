// Tracks a walk while it is taken: the pose of the newest photograph follows from those before it
// and the odometry. Time and memory per photograph are bounded, however long the walk is.

#pragma once

#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "raylift/localization/localizer.h"
#include "raylift/scene/image.h"
#include "raylift/sequences/smooth_queries.h"
#include "raylift/sequences/smoothing.h"

namespace raylift {

// Estimates the newest frame of a walk by SmoothWalk() of the last frames: the most recent ones,
// and those before them that have a pose of their own, so that the way from there is known.
class WalkFilter {
 public:
  // Continues with `frames`, those of a filter of the walk so far.
  explicit WalkFilter(OdometryScale scale, std::vector<WalkEvidence> frames = {})
      : scale_(scale), frames_(std::move(frames)) {}

  // Returns the smoothed walk of the frames that are kept, the newest last; without frames where
  // SmoothWalk() gives none.
  SmoothedWalk Add(const WalkEvidence& frame);

  const std::vector<WalkEvidence>& frames() const { return frames_; }

 private:
  void Forget();

  OdometryScale scale_;
  std::vector<WalkEvidence> frames_;
};

struct TrackedPose {
  WalkedQuery query;  // with the photograph's own result
  // The odometry's frame in the world (its translations times the scale), by the walk; nullopt
  // where the photograph has no pose, as the walk is lost or has not been found in the map yet, and
  // while an unknown scale is not observable.
  std::optional<Rigid3> world_from_odometry = std::nullopt;
  double scale = 1;
};

// The state of a walk between two photographs, with which another process can continue it.
struct WalkState {
  std::vector<WalkEvidence> frames = {};  // WalkFilter's
  std::optional<double> last_time_s = std::nullopt;
};

// A photograph of a walk and its result by itself.
struct WalkedPhotograph {
  const Query& query;
  const LocalizedQuery& alone;
  Rigid3 cam_from_odometry;
  double time_s = 0;
};

// Returns the pose of the next photograph, and updates the state. Times must grow; throws
// InputError where one does not.
TrackedPose Track(const WalkedPhotograph& photograph, const SceneDistances& distances,
                  const SmoothingOptions& options, WalkState& state);

// Localizes photographs of a walk one after the other.
class Tracker {
 public:
  // Takes a localizer as for single photographs.
  Tracker(Localizer localizer, const SmoothingOptions& options);

  // Localizes the photograph and returns its pose as Track() does.
  TrackedPose Add(const Query& query, const Image& photograph, const Rigid3& cam_from_odometry,
                  double time_s);
  // Takes a photograph that was localized by itself.
  TrackedPose Add(const Query& query, const LocalizedQuery& alone, const Rigid3& cam_from_odometry,
                  double time_s);

 private:
  Localizer localizer_;
  SmoothingOptions options_;
  SceneDistances distances_;
  WalkState state_;
};

}  // namespace raylift
