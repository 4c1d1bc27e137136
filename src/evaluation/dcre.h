// The dense correspondence reprojection error (Wald et al., "Beyond Controlled Environments", 2020;
// Panek et al., "CadLoc", 2023): how far the surface that a photograph shows moves in the image
// when the estimated pose takes the place of the true one. It measures what an application sees
// rather than how far a camera center is off.

#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"

namespace raylift {

// The surface point that a pixel of the photograph shows.
struct DensePoint {
  Eigen::Vector2d pixel;
  Eigen::Vector3d point_in_true_cam;
};

// Errors as shares of the image's diagonal. A point that moves farther than the diagonal, or behind
// the camera, counts as one diagonal.
struct Dcre {
  double mean = 0;
  double max = 0;
  size_t count = 0;  // points
};

// Returns nullopt where there are no points. Only the motion between the two poses matters, so that
// moving the origin of the world changes nothing.
std::optional<Dcre> ComputeDcre(const Camera& camera, const Rigid3& true_cam_from_world,
                                const Rigid3& estimated_cam_from_world,
                                std::span<const DensePoint> points);

// The errors of one method. A query without a pose has infinite errors; one whose photograph shows
// no surface (there is no depth) has none and counts apart.
struct DcreQuery {
  std::string name;
  bool has_depth = false;
  std::optional<Dcre> dcre;
};
struct DcreSummary {
  std::string name;
  size_t num_queries = 0;  // with depth
  std::vector<std::string> without_depth;
  double median_of_mean = 0;  // share of the diagonal
  double median_of_max = 0;
  std::vector<double> mean_recalls_percent;  // one per threshold
  std::vector<double> max_recalls_percent;
};
inline constexpr double kDcreThresholds[] = {0.01, 0.05, 0.1, 0.2};  // shares of the diagonal
DcreSummary SummarizeDcre(std::string name, std::span<const DcreQuery> queries);

std::string FormatDcreText(std::span<const DcreSummary> results);

}  // namespace raylift
