// Walks: photographs one after the other, with odometry between them.

#include <memory>
#include <mutex>
#include <utility>

#include "apps/python/conversions.h"
#include "apps/python/estimate_state.h"

#include "raylift/base/error.h"
#include "raylift/localization/scene.h"
#include "raylift/sequences/tracker.h"

namespace raylift::python {
namespace {

// The state of the package's Tracker; the scene's distances are learned with the first photograph.
class SceneTracker {
 public:
  SceneTracker(std::shared_ptr<Scene> scene, OdometryScale scale, double min_confidence)
      : scene_(std::move(scene)), options_{.scale = scale, .min_confidence = min_confidence} {
    if (!(min_confidence >= 0 && min_confidence <= 1)) {
      throw OptionError("min_confidence", fmt::format("{}", min_confidence),
                        "must lie between 0 and 1");
    }
  }

  TrackedPose Add(const KnownResult& alone, const Rigid3& cam_from_odometry, double time_s) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!tracker_) tracker_.emplace(Localizer(scene_, nullptr, {}), options_);
    const PoseProblem& problem = alone.problem;
    return tracker_->Add({problem.name, problem.query_camera, problem.priors}, alone.localized,
                         cam_from_odometry, time_s);
  }

 private:
  std::shared_ptr<Scene> scene_;
  SmoothingOptions options_;
  std::mutex mutex_;
  std::optional<Tracker> tracker_;
};

// A photograph's place in the walk; its result has the problem that was estimated.
struct PythonTrackedPose {
  TrackedPose tracked;
  ResultPointer result;
};

PythonTrackedPose Add(SceneTracker& tracker, const ResultPointer& alone, const PoseLike& pose,
                      double time_s) {
  const Rigid3 cam_from_odometry = ToPose(pose);
  return WithoutLock([&] {
    PythonTrackedPose added{tracker.Add(*alone, cam_from_odometry, time_s),
                            std::make_shared<KnownResult>(*alone)};
    added.result->localized = added.tracked.query.localized;
    return added;
  });
}

// The result, its role, time, what odometry was before it, its own pose and confidence; and the
// odometry's frame.
using TrackedState = std::tuple<ResultPointer, std::string, std::optional<double>, bool,
                                std::optional<Rigid3>, double, std::optional<Rigid3>, double>;

TrackedState StateOf(const PythonTrackedPose& pose) {
  const WalkedQuery& query = pose.tracked.query;
  return {pose.result,
          std::string(ToString(query.role)),
          query.time_s,
          query.lost_before,
          query.single_cam_from_world,
          query.single_confidence,
          pose.tracked.world_from_odometry,
          pose.tracked.scale};
}

PythonTrackedPose TrackedOf(const TrackedState& state) {
  const auto& [result, role, time_s, lost, single, confidence, world_from_odometry, scale] = state;
  return {{.query = {.localized = result->localized,
                     .role = ToEnum<WalkRole>("role", role),
                     .time_s = time_s,
                     .lost_before = lost,
                     .single_cam_from_world = single,
                     .single_confidence = confidence},
           .world_from_odometry = world_from_odometry,
           .scale = scale},
          result};
}

}  // namespace

void BindTracking(py::module_& module) {
  py::class_<PythonTrackedPose> bound(module, "TrackedPose",
                                      "A photograph of a walk. True where it has a pose.");
  bound
      .def_property_readonly(
          "result", [](const PythonTrackedPose& pose) { return pose.result; },
          "The LocalizedQuery: pose, covariance and verdict by the walk up to here.")
      .def_property_readonly(
          "role",
          [](const PythonTrackedPose& pose) {
            return std::string(ToString(pose.tracked.query.role));
          },
          "\"alone\", \"smoothed\", \"replaced\", \"rescued\", \"disputed\" or \"dropped\": what "
          "the\n"
          "walk did with the photograph's own pose.")
      .def_property_readonly(
          "single_cam_from_world",
          [](const PythonTrackedPose& pose) { return pose.tracked.query.single_cam_from_world; },
          "The photograph's own pose where the walk has changed it, or None.")
      .def_property_readonly(
          "single_confidence",
          [](const PythonTrackedPose& pose) { return pose.tracked.query.single_confidence; },
          "The probability that the photograph's own pose is right, by itself.")
      .def_property_readonly(
          "lost_before",
          [](const PythonTrackedPose& pose) { return pose.tracked.query.lost_before; },
          "Whether odometry was lost since the photograph before.")
      .def_property_readonly(
          "world_from_odometry",
          [](const PythonTrackedPose& pose) { return pose.tracked.world_from_odometry; },
          "The odometry's frame in the world, its translations times `scale`; None while the walk\n"
          "is not found in the map, or lost.")
      .def_property_readonly(
          "scale", [](const PythonTrackedPose& pose) { return pose.tracked.scale; },
          "Scene units per unit of the odometry.")
      .def("__bool__",
           [](const PythonTrackedPose& pose) { return pose.result->localized.localized(); })
      .def("__repr__", [](const PythonTrackedPose& pose) {
        return fmt::format("<raylift.TrackedPose {}: {}, {}>", pose.result->localized.name,
                           ToString(pose.tracked.query.role),
                           ToString(pose.result->localized.verdict()));
      });
  BindState(bound, py::overload_cast<const PythonTrackedPose&>(&StateOf), &TrackedOf);
  py::class_<SceneTracker>(module, "SceneTracker", "What raylift.Tracker is made of.")
      .def(py::init([](std::shared_ptr<Scene> scene, const std::string& scale,
                       double min_confidence) {
             return std::make_unique<SceneTracker>(
                 std::move(scene), ToEnum<OdometryScale>("odometry_scale", scale), min_confidence);
           }),
           py::arg("scene").none(false), py::arg("odometry_scale"), py::arg("min_confidence"))
      .def("add", &Add, py::arg("alone").none(false), py::arg("cam_from_odometry"), py::arg("time"),
           "The next photograph, which was localized by itself.");
}

}  // namespace raylift::python
