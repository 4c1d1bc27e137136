#include "raylift/sequences/tracker.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "sequences/anchors.h"
#include "sequences/walked_query.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

// The number of newest frames that are all kept, and the largest number in all: of those before the
// newest, only frames with a pose are kept.
constexpr size_t kNewest = 30;
constexpr size_t kMost = 60;

// Returns how far the camera went and turned over both steps.
StepLength Sum(const StepLength& a, const StepLength& b) {
  return {a.way + b.way, a.turn_deg + b.turn_deg};
}

}  // namespace

SmoothedWalk WalkFilter::Add(const WalkEvidence& frame) {
  frames_.push_back(frame);
  Forget();
  if (frames_.size() > 1) return SmoothWalk(frames_, scale_);
  SmoothedWalk walk{.scale_is_observable = scale_ == OdometryScale::kKnown};
  if (frame.singles.empty() || !walk.scale_is_observable) return walk;
  const SinglePose& single = frame.singles.front();
  walk.frames.push_back({.cam_from_world = single.cam_from_world,
                         .covariance = single.covariance,
                         .confidence = single.confidence,
                         .single_agrees = 1});
  return walk;
}

void WalkFilter::Forget() {
  if (frames_.size() <= kNewest) return;
  const auto leaves_newest = frames_.end() - static_cast<std::ptrdiff_t>(kNewest) - 1;
  if (leaves_newest->singles.empty()) {
    const auto next = leaves_newest + 1;
    if (leaves_newest != frames_.begin()) {
      next->since_before = Sum(LengthOfStep(*(leaves_newest - 1), *leaves_newest),
                               LengthOfStep(*leaves_newest, *next));
    }
    frames_.erase(leaves_newest);
  }
  if (frames_.size() > kMost) frames_.erase(frames_.begin());
}

Tracker::Tracker(Localizer localizer, const SmoothingOptions& options)
    : localizer_(std::move(localizer)), options_(options), distances_(localizer_.scene()) {}

TrackedPose Tracker::Add(const Query& query, const Image& photograph,
                         const Rigid3& cam_from_odometry, double time_s) {
  return Add(query, localizer_.Localize(query, photograph).localized, cam_from_odometry, time_s);
}

TrackedPose Tracker::Add(const Query& query, const LocalizedQuery& alone,
                         const Rigid3& cam_from_odometry, double time_s) {
  return Track({query, alone, cam_from_odometry, time_s}, distances_, options_, state_);
}

TrackedPose Track(const WalkedPhotograph& photograph, const SceneDistances& distances,
                  const SmoothingOptions& options, WalkState& state) {
  const auto& [query, alone, cam_from_odometry, time_s] = photograph;
  if (!std::isfinite(time_s)) {
    throw InputError(fmt::format("{}: expected a finite time, found {}", query.name, time_s));
  }
  if (state.last_time_s && !(time_s > *state.last_time_s)) {
    throw InputError(fmt::format("{}: expected a time after {} s, found {} s", query.name,
                                 FormatDouble(*state.last_time_s), FormatDouble(time_s)));
  }
  TrackedPose tracked{{.localized = alone, .time_s = time_s}};
  WalkFilter filter(options.scale, state.frames);
  const SmoothedWalk walk = filter.Add({cam_from_odometry, SinglePosesOf(alone)});
  state = {filter.frames(), time_s};
  if (!walk.frames.empty()) {
    TakeFromWalk(walk.frames.back(), query, distances, options.min_confidence, tracked.query);
  }
  tracked.scale = walk.scale;
  if (!tracked.query.localized.localized() || !walk.scale_is_observable) return tracked;
  Rigid3 scaled = cam_from_odometry;
  scaled.translation *= walk.scale;
  const Rigid3& pose = tracked.query.role == WalkRole::kDisputed
                           ? walk.frames.back().cam_from_world
                           : *tracked.query.localized.estimate.cam_from_world;
  tracked.world_from_odometry = pose.Inverse() * scaled;
  return tracked;
}

}  // namespace raylift
