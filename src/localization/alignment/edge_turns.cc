#include "localization/alignment/edge_turns.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "localization/alignment/edge_score.h"
#include <Eigen/Geometry>
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/geometry/camera.h"

namespace raylift {
namespace {

// Scores are integers in units of 1 / kUnit: at the most 15 for a piece, so that EdgeTurns::kMost
// of them do not overflow.
constexpr double kUnit = 6;
// The assumed share of the scene's edges that a photograph shows; the finer sizes estimate it.
constexpr double kShown = 0.3;

// The most turns: with more of them the search would take minutes, and chance alone would find a
// pose.
constexpr double kMostTurns = 5e4;

Eigen::Quaterniond Turn(double x_rad, double y_rad, double roll_rad) {
  return RotationFromVector(Eigen::Vector3d(x_rad, y_rad, 0)) *
         RotationFromVector(Eigen::Vector3d(0, 0, roll_rad));
}

Rigid3 TurnedInPlace(const Rigid3& cam_from_world, const Eigen::Quaterniond& turn) {
  const Eigen::Quaterniond rotation = (turn * cam_from_world.rotation).normalized();
  return {rotation, -(rotation * cam_from_world.OriginInSource())};
}

}  // namespace

std::vector<Eigen::Vector2d> BorderAngles(const Camera& camera) {
  std::vector<Eigen::Vector2d> places;
  for (const double x : {0.0, 0.5, 1.0}) {
    for (const double y : {0.0, 0.5, 1.0}) {
      const auto ray = camera.RayInCam({x * camera.width_px(), y * camera.height_px()});
      if (!ray) continue;
      places.emplace_back(std::acos(std::clamp(ray->z(), -1.0, 1.0)) * ray->head<2>().normalized());
    }
  }
  return places;
}

EdgeTurns::EdgeTurns(const EdgeImage& image, int cell_px, double most_rad)
    : image_(image),
      cell_px_(cell_px),
      most_rad_(most_rad),
      camera_(image.camera().Scaled(image.camera().width_px() / cell_px,
                                    image.camera().height_px() / cell_px)),
      stride_(camera_.width_px() + 2 * kWindow),
      rows_(camera_.height_px() + 2 * kWindow) {
  MakeScores();
  double widest = kWindow / camera_.MeanFocalPx();
  for (const Eigen::Vector2d& place : BorderAngles(camera_)) {
    widest = std::max(widest, place.norm() + kWindow / camera_.MeanFocalPx());
  }
  least_cosine_ = std::cos(std::min(widest, std::numbers::pi));
  // A roll moves what is halfway to a corner by as much as edges are wide.
  const double roll_step = 8.0 / std::hypot(camera_.width_px(), camera_.height_px());
  const double step = kWindow / camera_.MeanFocalPx();
  const double wanted_rolls = std::ceil(most_rad / roll_step);
  const double wanted_steps = std::ceil(most_rad / step - 0.5);
  const double count = std::pow(2 * wanted_steps + 1, 2) * (2 * wanted_rolls + 1);
  if (!(count <= kMostTurns)) {
    throw InputError(
        fmt::format("its orientation is known too roughly to be found by edges: there "
                    "are {:.2g} turns of the camera to try, more than {:.2g}",
                    count, kMostTurns));
  }
  const int rolls = static_cast<int>(wanted_rolls);
  const int steps = static_cast<int>(wanted_steps);
  for (int x = -steps; x <= steps; ++x) {
    for (int y = -steps; y <= steps; ++y) {
      for (int roll = -rolls; roll <= rolls; ++roll) {
        const Eigen::Vector3d angles(x * step, y * step, roll * roll_step);
        if (angles.norm() <= most_rad + step) {
          turns_.push_back(Turn(angles.x(), angles.y(), angles.z()));
        }
      }
    }
  }
}

void EdgeTurns::MakeScores() {
  for (size_t direction = 0; direction < EdgeImage::kDirections; ++direction) {
    std::vector<int16_t>& scores = scores_[direction];
    scores.assign(static_cast<size_t>(stride_) * static_cast<size_t>(rows_), 0);
    for (int y = 0; y < camera_.height_px(); ++y) {
      for (int x = 0; x < camera_.width_px(); ++x) {
        const double evidence =
            image_.EvidenceAt(cell_px_ * x + cell_px_ / 2, cell_px_ * y + cell_px_ / 2, direction);
        scores[static_cast<size_t>((y + kWindow) * stride_ + x + kWindow)] =
            static_cast<int16_t>(std::lround(kUnit * std::log(1 + kShown * evidence)));
      }
    }
  }
}

EdgeTurns::Sums EdgeTurns::SumsOf(std::span<const SceneEdge> edges,
                                  const Rigid3& cam_from_world) const {
  RAYLIFT_CHECK(edges.size() <= kMost);
  Sums sums{};
  const EdgeViewer viewer(camera_, cam_from_world);
  const Eigen::RowVector3d axis = cam_from_world.rotation.toRotationMatrix().row(2);
  const Eigen::Vector3d center = cam_from_world.OriginInSource();
  for (const SceneEdge& edge : edges) {
    const Eigen::Vector3d ray = edge.point_in_world - center;
    if (axis.dot(ray) < least_cosine_ * ray.norm()) continue;
    const auto seen = viewer.See(edge);
    if (!seen) continue;
    if (!(seen->pixel.cwiseAbs().maxCoeff() < stride_ + rows_)) continue;
    // The window begins half its size before the piece.
    const int x = static_cast<int>(std::floor(seen->pixel.x())) + kWindow / 2;
    const int y = static_cast<int>(std::floor(seen->pixel.y())) + kWindow / 2;
    if (x < 0 || y < 0 || x + kWindow > stride_ || y + kWindow > rows_) continue;
    const int16_t* from = scores_[EdgeImage::Direction(seen->normal)].data() + y * stride_ + x;
    int16_t* to = sums.data();
    for (int row = 0; row < kWindow; ++row, from += stride_, to += kWindow) {
      for (int i = 0; i < kWindow; ++i) to[i] = static_cast<int16_t>(to[i] + from[i]);
    }
  }
  return sums;
}

EdgeTurns::Scored EdgeTurns::BestOfWindow(std::span<const SceneEdge> edges,
                                          const Rigid3& cam_from_world) const {
  const Sums sums = SumsOf(edges, cam_from_world);
  const auto most = std::max_element(sums.begin(), sums.end());
  const auto at = static_cast<int>(most - sums.begin());
  const double right = at % kWindow - kWindow / 2;
  const double down = at / kWindow - kWindow / 2;
  const double focal_px = camera_.MeanFocalPx();
  double length_px = 0;
  for (const SceneEdge& edge : edges) length_px += edge.length_px;
  const double unit = edges.empty() ? 0 : length_px / static_cast<double>(edges.size()) / kUnit;
  return {TurnedInPlace(cam_from_world, Turn(-down / focal_px, right / focal_px, 0)), unit * *most};
}

std::vector<EdgeTurns::Scored> EdgeTurns::BestOfWindows(std::span<const SceneEdge> edges,
                                                        const Rigid3& cam_from_world) const {
  std::vector<Scored> best;
  for (const Eigen::Quaterniond& turn : turns_) {
    best.push_back(BestOfWindow(edges, TurnedInPlace(cam_from_world, turn)));
  }
  return best;
}

size_t EdgeTurns::NumTried() const {
  constexpr size_t kWidth = 3;  // of the evidence for an edge
  return turns_.size() * (kWindow / kWidth) * (kWindow / kWidth);
}

}  // namespace raylift
