// Errors of estimated poses, query by query and along trajectories; recalls and medians, whether
// these differ by more than luck, and the calibration of covariances.

#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "raylift/geometry/rigid3.h"

namespace raylift {

struct PoseError {
  double position;      // distance of the camera centers, in scene units
  double rotation_deg;  // angle of the rotation between the orientations
};

PoseError ComparePoses(const Rigid3& estimated_cam_from_world, const Rigid3& true_cam_from_world);

// cam_from_world by image name.
using PosesByName = std::map<std::string, Rigid3>;

struct QueryError {
  std::string name;                // the ground truth's
  std::optional<PoseError> error;  // nullopt: not localized
};

// The poses of one method compared with the ground truth.
struct Comparison {
  std::vector<QueryError> queries;         // every query of the ground truth, by name
  std::vector<std::string> unknown_names;  // estimated, but not in the ground truth
  bool uses_ground_truth = false;          // an oracle's: not a method one could run
};

// Compares poses of equal names. Names match exactly; else an estimate's name may be the end of one
// true name, from a `/` on (hloc's result files hold `image.png` or `seq/image.png` for
// `dir/seq/image.png`), where it is the only such estimate, fits no other true name and that one
// has no exact estimate. A non-finite pose counts as not localized.
Comparison CompareWithGroundTruth(const PosesByName& ground_truth, const PosesByName& estimated);

// Returns the estimated poses under the names of the ground truth, by the same rule; unknown ones
// are left out.
PosesByName MatchNames(const PosesByName& ground_truth, const PosesByName& estimated);

// Returns the comparison of each group of queries (such as day and night), by the group's name.
// Queries that `group_of_query` does not know are in none, unknown names neither.
std::map<std::string, Comparison> SplitByGroup(
    const Comparison& comparison, const std::map<std::string, std::string>& group_of_query);

// Returns the paper's Oracle: of two methods' poses of a query, the one with the smaller
// max(position error in cm, rotation error in deg). An upper bound for choosing between them, made
// with the ground truth. Both comparisons must be with the same ground truth.
Comparison ChooseByOracle(const Comparison& a, const Comparison& b, double cm_per_scene_unit = 100);

// Calibration of the covariances of poses: whether they tell how wrong the poses are.

struct UncertainPose {
  Rigid3 estimated_cam_from_world;
  Rigid3 true_cam_from_world;
  // The covariance of the step (w, v) in the camera's tangent frame, as PoseEstimate::covariance.
  Eigen::Matrix<double, 6, 6> covariance;
};

// With right covariances the mean is 1 and the coverage 0.9; where they are too small, the mean is
// larger and the coverage smaller. A few poses that are far off dominate the mean, not the
// coverage.
struct Calibration {
  size_t poses = 0;
  double mean_normalized_square = 0;  // e' covariance^-1 e / 6
  double median_normalized_square = 0;
  double coverage_90 = 0;          // share of the poses within the ellipsoid of 90 %
  double median_sigmas = 0;        // of the position error over position_sigma
  double share_below_3_sigma = 0;  // of the same
};

// Returns the calibration. Singular covariances are left out.
Calibration Calibrate(std::span<const UncertainPose> poses);

// The field's figures of merit: the share of queries localized within error thresholds, and median
// errors. Both count every query of the ground truth: one without a pose has infinite errors.

struct Threshold {
  double position;  // scene units
  double rotation_deg;

  // Returns whether both errors are at most the thresholds.
  bool Accepts(const PoseError& error) const {
    return error.position <= position && error.rotation_deg <= rotation_deg;
  }
  bool operator==(const Threshold&) const = default;
};

// Parses "0.05,5:0.1,1:0.25,2" (position,degrees between colons), or the name of a data set with
// customary thresholds in meters. Throws OptionError, of the name "thresholds", on anything but
// pairs of positive finite numbers.
std::vector<Threshold> ParseThresholds(std::string_view text);
std::string ThresholdPresetNames();  // "aachen|robotcar|..."

struct ResultSummary {
  std::string name;
  bool uses_ground_truth = false;
  size_t num_queries = 0;  // in the ground truth
  size_t num_localized = 0;
  std::vector<double> recalls_percent;  // of all queries, one per threshold
  // The medians are over all queries, as 7-Scenes reports them: infinite where half of the queries
  // or more have no pose, and the mean of the middle two for an even count.
  double median_position = 0;
  double median_rotation_deg = 0;
  std::vector<std::string> missing_names;                 // queries without a pose
  std::vector<std::string> unknown_names;                 // poses without a query
  std::optional<Calibration> calibration = std::nullopt;  // where covariances are known
};

// Summarizes a comparison. Throws InputError where the ground truth holds no queries.
ResultSummary Summarize(std::string name, const Comparison& comparison,
                        std::span<const Threshold> thresholds);

// Returns one line that counts and names the images of the ground truth without a pose; empty where
// all have one.
std::string DescribeMissing(const ResultSummary& summary);

// Returns one line for the user where poses were left out as they are not in the ground truth; else
// an empty text.
std::string UnknownNamesWarning(const ResultSummary& summary);

// One table of results, which can be written in three forms. A number is rounded once, so that all
// forms hold the same.

// The summaries must be of the same thresholds.
struct ResultTable {
  std::span<const Threshold> thresholds;
  std::span<const ResultSummary> results;
};

// Returns aligned columns for reading. Results that use the ground truth are marked by a star. The
// calibrations of the results that have one follow.
std::string FormatTableText(const ResultTable& table);

// Returns CSV (RFC 4180) with one header line. An infinite median is `inf`.
std::string FormatTableCsv(const ResultTable& table);

// Returns {"thresholds": [{position, rotation_deg}], "results": [{name, uses_ground_truth, queries,
// localized, unknown, recalls_percent: [...], median_position, median_rotation_deg, missing_names,
// unknown_names, calibration: {poses, mean_normalized_square, median_normalized_square,
// coverage_90_percent, median_sigmas, below_3_sigma_percent}}]}. The calibration is there where it
// is known. An infinite median is null, as JSON has no such number.
std::string FormatTableJson(const ResultTable& table);

struct Interval {
  double low = 0;
  double high = 0;
  bool Contains(double value) const { return low <= value && value <= high; }
};

// Tells by the bootstrap (Efron 1979) whether a difference between two methods is more than chance.
// Queries are drawn with replacement, all methods are rated on the same draws, and the middle 95 %
// of the results is the interval.
class QueryBootstrap {
 public:
  // Draws depend on the seed and the numbers alone. num_queries > 0.
  QueryBootstrap(size_t num_queries, uint64_t seed, int num_draws = 2000);

  // Returns the interval of the recall in percent. The comparison must have `num_queries` queries.
  Interval RecallPercent(const Comparison& comparison, const Threshold& threshold) const;

  // Returns the interval of recall(a) - recall(b) in percent. Where it contains 0, the difference
  // may be chance.
  Interval RecallDifferencePercent(const Comparison& a, const Comparison& b,
                                   const Threshold& threshold) const;

  // Returns the interval of the mean of one value per query.
  Interval Mean(std::span<const double> per_query) const;

  // The mean of `first` minus the largest mean of `others`, which is looked for anew in each
  // draw: the one that is best on all queries is partly so by luck. `others` is not empty.
  struct Difference {
    Interval interval;
    // Probabilities that `first` is not better than one of them, or not worse than any, one-sided,
    // by the normal approximation of each difference; not below what that many queries can show.
    double p_better = 1, p_worse = 1;
  };
  Difference ToBest(std::span<const double> first,
                    std::span<const std::vector<double>> others) const;

  // Returns the interval of the median position error; infinite where half of a draw has no pose.
  Interval MedianPosition(const Comparison& comparison) const;

 private:
  size_t num_queries_;
  std::vector<uint32_t> draws_;  // num_queries_ indices per draw
};

// Errors of a trajectory as evo (Grupp 2017) defines them, without alignment: APE, of each pose,
// and RPE, of each step from one pose to the next.

struct ErrorStatistics {
  double rmse = 0, mean = 0, median = 0, std = 0, min = 0, max = 0, sse = 0;
};
// Returns the statistics; zeros for no errors.
ErrorStatistics StatisticsOf(std::vector<double> errors);

struct TrajectoryErrors {
  std::string name;
  size_t poses = 0;
  ErrorStatistics ape_position, ape_rotation_deg;
  ErrorStatistics rpe_position, rpe_rotation_deg;
};

struct TrajectoryPose {
  Rigid3 estimated_cam_from_world;
  Rigid3 true_cam_from_world;
};

// Computes, with the true world_from_cam Q and the estimated P, the errors of Q_i^-1 P_i (APE) and
// of (Q_i^-1 Q_i+1)^-1 (P_i^-1 P_i+1) (RPE).
TrajectoryErrors CompareTrajectories(std::string name, std::span<const TrajectoryPose> poses);

// Returns aligned columns, four rows for each trajectory.
std::string FormatTrajectoryText(std::span<const TrajectoryErrors> trajectories);

// Returns [{name, poses, ape_position: {rmse, mean, median, std, min, max, sse}, ape_rotation_deg,
// rpe_position, rpe_rotation_deg}].
std::string FormatTrajectoryJson(std::span<const TrajectoryErrors> trajectories);

}  // namespace raylift
