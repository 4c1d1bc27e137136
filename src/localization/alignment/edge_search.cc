#include "localization/alignment/edge_search.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <span>
#include <utility>

#include "base/rng.h"
#include "base/statistics.h"
#include "geometry/pose_step.h"
#include <Eigen/Cholesky>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "raylift/geometry/residuals.h"

namespace raylift {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180;

// The photograph's sizes by their longer sides, coarse to fine, and how many modes are left after
// each.
struct Level {
  int side_px;
  size_t edges;  // pieces of the scene's edges
  size_t modes;
};
constexpr std::array<Level, 3> kLevels = {{{80, 250, 80}, {160, 400, 24}, {320, 800, 8}}};
constexpr Level kFinest = {640, 3000, 8};
// Of the coarsest size: positions, and directions from each.
constexpr int kPositions = 300;
constexpr int kTurns = 400;
// The best of these are looked around in turn, more narrowly.
constexpr size_t kPromising = 50;
constexpr int kPositionsAround = 6;
constexpr int kTurnsAround = 150;
constexpr double kNarrower = 0.3;
// Edges of the photograph are looked for so far from those of the scene.
constexpr double kReachPx = 4;

// A squared distance in standard deviations that two estimates of one pose seldom have: a
// chi-squared of 6 degrees of freedom exceeds it once in 10,000.
constexpr double kSameMode = 27.9;

struct Scored {
  Rigid3 cam_from_world;
  double score;
};

Image Resized(const Image& gray, int width_px, int height_px) {
  const cv::Mat from(gray.height_px, gray.width_px, CV_8U, const_cast<uint8_t*>(gray.data.data()));
  Image small{width_px, height_px, 1, {}};
  small.data.resize(static_cast<size_t>(width_px) * static_cast<size_t>(height_px));
  cv::Mat to(height_px, width_px, CV_8U, small.data.data());
  cv::resize(from, to, {width_px, height_px}, 0, 0, cv::INTER_AREA);
  return small;
}

EdgeImage ImageAt(const Image& gray, const Camera& camera, int side_px) {
  const double scale =
      std::min(1.0, static_cast<double>(side_px) / std::max(gray.width_px, gray.height_px));
  const int width = std::max(8, static_cast<int>(std::lround(scale * gray.width_px)));
  const int height = std::max(8, static_cast<int>(std::lround(scale * gray.height_px)));
  return EdgeImage(Resized(gray, width, height), camera.Scaled(width, height));
}

// A lens that sees all that the camera sees when it is turned by `turn_rad`, as sharply.
Camera WideCamera(const Camera& camera, double turn_rad) {
  double widest = 0;
  for (const double x : {0.0, 0.5, 1.0}) {
    for (const double y : {0.0, 0.5, 1.0}) {
      const auto ray = camera.RayInCam({x * camera.width_px(), y * camera.height_px()});
      if (ray) widest = std::max(widest, std::acos(std::clamp(ray->z(), -1.0, 1.0)));
    }
  }
  const double half = std::min(widest + turn_rad, 0.95 * std::numbers::pi);
  const double focal_px = camera.MeanFocalPx();
  const int side = std::max(8, static_cast<int>(2 * half * focal_px));
  const double params[] = {focal_px, 0.5 * side, 0.5 * side, 0};
  return {CameraModel::kSimpleRadialFisheye, side, side, params};
}

Eigen::Vector3d NormalVector(Rng& rng) {
  const double x = rng.Normal();
  const double y = rng.Normal();
  return {x, y, rng.Normal()};
}

// A pose turned by a rotation vector and with its center moved.
Rigid3 Moved(const Rigid3& pose, const Eigen::Vector3d& turn, const Eigen::Vector3d& shift) {
  const Eigen::Quaterniond rotation = (RotationFromVector(turn) * pose.rotation).normalized();
  return {rotation, -(rotation * (pose.OriginInSource() + shift))};
}

class Search {
 public:
  Search(const std::shared_ptr<const RayCaster>& mesh, const PosePrior& prior, uint64_t seed)
      : renderer_(mesh, FrameOfEdges()), prior_(prior), rng_(seed) {}

  std::vector<SceneEdge> EdgesFrom(const PixelRays& rays, const Rigid3& pose, size_t most) {
    renderer_.Render(rays, pose, 1, frame_);
    return SceneEdges(frame_, rays, pose, most);
  }

  double Score(const EdgeImage& image, std::span<const SceneEdge> edges, const Rigid3& pose) const {
    return EdgeScore(image, edges, pose) + LogPrior(prior_, pose);
  }

  // Random steps whose size follows their success.
  void Climb(const EdgeImage& image, std::span<const SceneEdge> edges, double turn_rad,
             double shift, int steps, Scored& best) {
    for (int i = 0; i < steps; ++i) {
      const Rigid3 pose =
          Moved(best.cam_from_world, turn_rad * NormalVector(rng_), shift * NormalVector(rng_));
      const double score = Score(image, edges, pose);
      const double factor = score > best.score ? 1.5 : 0.92;
      if (score > best.score) best = {pose, score};
      turn_rad *= factor;
      shift *= factor;
    }
  }

  // Looks around poses, one position each: a wide view from there serves all directions.
  std::vector<Scored> Explore(const EdgeImage& image, const Level& level,
                              std::span<const Rigid3> from, double turn_deg, int turns) {
    const double turn_rad = turn_deg * kRadPerDeg;
    const PixelRays rays(WideCamera(image.camera(), 2 * turn_rad), 1);
    std::vector<Scored> all;
    for (const Rigid3& at : from) {
      const std::vector<SceneEdge> edges = EdgesFrom(rays, at, level.edges);
      std::vector<Scored> turned;
      for (int k = 0; k < turns; ++k) {
        const Eigen::Vector3d turn = k == 0 ? Eigen::Vector3d(Eigen::Vector3d::Zero())
                                            : Eigen::Vector3d(turn_rad * NormalVector(rng_));
        const Rigid3 pose = Moved(at, turn, Eigen::Vector3d::Zero());
        turned.push_back({pose, Score(image, edges, pose)});
      }
      num_tried_ += static_cast<size_t>(turns);
      std::sort(turned.begin(), turned.end(),
                [](const Scored& a, const Scored& b) { return a.score > b.score; });
      const size_t kept = std::min<size_t>(2, turned.size());
      for (size_t k = 0; k < kept; ++k) {
        Climb(image, edges, 0.03, 0.1 * prior_.sigma_position.mean(), 60, turned[k]);
        all.push_back(turned[k]);
      }
    }
    return all;
  }

  // Poses with the prior's rotation at positions that are drawn from it, itself the first.
  std::vector<Rigid3> DrawFromPrior(int count) {
    std::vector<Rigid3> poses = {prior_.cam_from_world};
    while (poses.size() < static_cast<size_t>(count)) {
      poses.push_back(Moved(prior_.cam_from_world, Eigen::Vector3d::Zero(),
                            prior_.sigma_position.cwiseProduct(NormalVector(rng_))));
    }
    return poses;
  }

  std::vector<Rigid3> DrawAround(std::span<const Scored> poses) {
    std::vector<Rigid3> drawn;
    for (const Scored& scored : poses) {
      for (int i = 0; i < kPositionsAround; ++i) {
        drawn.push_back(Moved(scored.cam_from_world, Eigen::Vector3d::Zero(),
                              kNarrower * prior_.sigma_position.cwiseProduct(NormalVector(rng_))));
      }
    }
    return drawn;
  }

  // Looks around the prior and then around the best poses, at the coarsest size.
  std::vector<Scored> ExplorePrior(const EdgeImage& image, const Level& level) {
    std::vector<Scored> poses =
        Explore(image, level, DrawFromPrior(kPositions), prior_.sigma_deg, kTurns);
    const std::vector<Scored> best = Distinct(image, poses, kPromising, 2);
    const std::vector<Scored> more =
        Explore(image, level, DrawAround(best), kNarrower * prior_.sigma_deg, kTurnsAround);
    poses.insert(poses.end(), more.begin(), more.end());
    return Distinct(image, std::move(poses), 2 * level.modes, 1);
  }

  // Renders anew from where each pose is, takes it on, and keeps the level's best.
  void Improve(const EdgeImage& image, const Level& level, std::vector<Scored>& poses) {
    constexpr int kRounds = 2;
    constexpr int kSteps = 60;
    const PixelRays rays(image.camera(), 1);
    const double pixel_rad = 1 / image.camera().MeanFocalPx();
    for (Scored& scored : poses) {
      for (int round = 0; round < kRounds; ++round) {
        const std::vector<SceneEdge> edges = EdgesFrom(rays, scored.cam_from_world, level.edges);
        scored.score = Score(image, edges, scored.cam_from_world);
        Climb(image, edges, 2 * pixel_rad, pixel_rad * MedianDistance(), kSteps, scored);
        const auto fit = FitEdges(image, edges, prior_, scored.cam_from_world, kReachPx);
        if (!fit) continue;
        const double score = Score(image, edges, fit->cam_from_world);
        if (score > scored.score) scored = {fit->cam_from_world, score};
      }
    }
    poses = Distinct(image, std::move(poses), level.modes, 1);
  }

  // Fits each pose at the finest size.
  FoundByEdges Finish(const EdgeImage& image, std::span<const Scored> poses) {
    FoundByEdges found{.modes = {}, .num_tried = num_tried_};
    const PixelRays rays(image.camera(), 1);
    for (const Scored& scored : poses) {
      if (auto mode = ModeFrom(image, rays, scored.cam_from_world)) {
        found.modes.push_back(std::move(*mode));
      }
    }
    std::stable_sort(found.modes.begin(), found.modes.end(),
                     [](const EdgeMode& a, const EdgeMode& b) { return a.score > b.score; });
    if (!found.modes.empty()) {
      EdgeMode& best = found.modes.front();
      const auto edges = EdgesFrom(rays, best.fit.cam_from_world, kFinest.edges);
      AddCovarianceByResampling(image, edges, prior_, kReachPx, rng_, best.fit);
    }
    return found;
  }

 private:
  std::optional<EdgeMode> ModeFrom(const EdgeImage& image, const PixelRays& rays, Rigid3 pose) {
    constexpr int kRounds = 4;
    EdgeMode mode;
    for (int round = 0; round < kRounds; ++round) {
      const auto fit =
          FitEdges(image, EdgesFrom(rays, pose, kFinest.edges), prior_, pose, kReachPx);
      if (!fit) return std::nullopt;
      mode.fit = *fit;
      pose = fit->cam_from_world;
    }
    mode.cells = EdgeScoreByCell(image, EdgesFrom(rays, pose, kFinest.edges), pose);
    mode.score = mode.cells.sum() + LogPrior(prior_, pose);
    return mode;
  }

  // Of the last picture.
  double MedianDistance() const {
    std::vector<float> distances;
    for (const float distance : frame_.distance) {
      if (distance > 0) distances.push_back(distance);
    }
    return distances.empty() ? 0 : UpperMedianInPlace(std::span(distances));
  }

  // The best ones that are further than so many pixels from every better one.
  std::vector<Scored> Distinct(const EdgeImage& image, std::vector<Scored> all, size_t most,
                               double apart_px) const {
    const double turn_rad = apart_px / image.camera().MeanFocalPx();
    const double shift = turn_rad * MedianDistance();
    std::stable_sort(all.begin(), all.end(),
                     [](const Scored& a, const Scored& b) { return a.score > b.score; });
    std::vector<Scored> kept;
    for (const Scored& scored : all) {
      if (kept.size() == most) break;
      const bool is_new = std::none_of(kept.begin(), kept.end(), [&](const Scored& better) {
        const Rigid3& a = better.cam_from_world;
        const Rigid3& b = scored.cam_from_world;
        return AngleBetweenDeg(a.rotation, b.rotation) * kRadPerDeg < turn_rad &&
               (a.OriginInSource() - b.OriginInSource()).norm() < shift;
      });
      if (is_new) kept.push_back(scored);
    }
    return kept;
  }

  FrameRenderer renderer_;
  PosePrior prior_;
  Rng rng_;
  Frame frame_;
  size_t num_tried_ = 0;
};

}  // namespace

FoundByEdges SearchByEdges(const std::shared_ptr<const RayCaster>& mesh, const Image& gray,
                           const Camera& camera, const PosePrior& prior, uint64_t seed) {
  Search search(mesh, prior, seed);
  std::vector<Scored> poses;
  for (const Level& level : kLevels) {
    const EdgeImage image = ImageAt(gray, camera, level.side_px);
    if (poses.empty()) poses = search.ExplorePrior(image, level);
    search.Improve(image, level, poses);
  }
  const EdgeImage image = ImageAt(gray, camera, kFinest.side_px);
  return search.Finish(image, poses);
}

double ConfidenceOf(const FoundByEdges& found) {
  if (found.modes.empty()) return 0;
  const auto tail = [](const CellScores& scores) {
    const double squares = scores.square().sum();
    if (!(squares > 0)) return 0.5;
    return 0.5 * std::erfc(scores.sum() / std::sqrt(2 * squares));
  };
  const EdgeMode& best = found.modes.front();
  double right = std::max(0.0, 1 - static_cast<double>(found.num_tried) * tail(best.cells));
  for (size_t i = 1; i < found.modes.size(); ++i) {
    const EdgeMode& other = found.modes[i];
    const Vector6d step = StepBetween(best.fit.cam_from_world, other.fit.cam_from_world);
    if (step.dot(best.fit.covariance.ldlt().solve(step)) < kSameMode) continue;
    right *= 1 - tail(best.cells - other.cells);
  }
  return right;
}

}  // namespace raylift
