#include "localization/alignment/edge_search.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <optional>
#include <span>
#include <utility>

#include "base/constants.h"
#include "base/rng.h"
#include "base/statistics.h"
#include "estimation/confidence/confidence.h"
#include "features/cv_image.h"
#include "geometry/pose_step.h"
#include "localization/alignment/edge_turns.h"
#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "raylift/geometry/residuals.h"

namespace raylift {
namespace {

// The photograph's sizes by their longer sides.
constexpr int kCoarsePx = 320;
constexpr int kFinestPx = 640;
// The numbers of pieces of the scene's edges: with fewer of them the result depends on which are
// drawn.
constexpr size_t kCoarseEdges = 1500;
constexpr size_t kFinestEdges = 3000;
// While positions are explored the evidence is sampled in cells of so many pixels, and edges may be
// further from their place.
constexpr int kExploreCellPx = 2;
constexpr double kExploreSigmaPx = 1.5;
// A position serves those around it up to so many pixels of motion, most of which turns undo.
constexpr double kSpacingPx = 12;
constexpr size_t kFewestPositions = 40;
constexpr size_t kMostPositions = 250;
// The number of the best turns of each position that are moved, of the best poses that are scored
// again and fitted, and of modes that are left then.
constexpr size_t kTurnsEach = 2;
constexpr size_t kPromising = 40;
constexpr size_t kModesAround = 4;
constexpr size_t kAround = 24;
constexpr size_t kModes = 6;
// Pictures that no pose explains are looked for from so many positions each.
constexpr size_t kChancePositions = kFewestPositions / 2;
// The number of standard deviations of the prior that are searched.
constexpr double kFarthestTurn = 2.5;
// Edges of the photograph are looked for so far from those of the scene.
constexpr double kReachPx = 4;

// Modes as near as this in the finest picture see the same things.
constexpr double kModePx = 4 * kReachPx;
// A squared distance in standard deviations that two estimates of one pose seldom have: a
// chi-squared of 6 degrees of freedom exceeds it once in 10,000.
constexpr double kSameMode = 27.9;

struct Scored {
  Rigid3 cam_from_world;
  double score;
};

bool BetterThan(const Scored& a, const Scored& b) { return a.score > b.score; }

// Pictures that have edges like the photograph's but show no place from any pose nearby. The first
// keeps what is level or upright, and where the horizon is; the second keeps all directions,
// however the camera is rolled.
enum class NoPlace { kMirrored, kUpsideDown };

Image Flipped(const Image& gray, NoPlace kind) {
  Image flipped = gray;
  cv::Mat to(gray.height_px, gray.width_px, CV_8U, flipped.data.data());
  cv::flip(AsMat(gray), to, kind == NoPlace::kMirrored ? 1 : -1);
  return flipped;
}

// Returns the lens of such a picture, without its terms that are not symmetric.
Camera Flipped(const Camera& camera, NoPlace kind) {
  std::vector<double> params(camera.params().begin(), camera.params().end());
  const int center = GetCameraModelInfo(camera.model()).num_focal_lengths;
  if (center == 0) return camera;
  const auto x = static_cast<size_t>(center);
  params[x] = camera.width_px() - params[x];
  if (kind == NoPlace::kUpsideDown) params[x + 1] = camera.height_px() - params[x + 1];
  return {camera.model(), camera.width_px(), camera.height_px(), params};
}

// Returns the i-th of numbers in (0, 1) that fill the space of three axes evenly: multiples of the
// powers of 1 / g modulo 1, with g^4 = g + 1 (Roberts 2018).
double Spread(size_t i, int axis) {
  constexpr double kRatio = 1.2207440846057596;
  const double at = 0.5 + static_cast<double>(i) * std::pow(kRatio, -1 - axis);
  return at - std::floor(at);
}

// Finds the quantile by bisection.
double NormalQuantile(double share_below) {
  double low = -8;
  double high = 8;
  for (int i = 0; i < 40; ++i) {
    const double middle = 0.5 * (low + high);
    (0.5 * std::erfc(-middle / std::numbers::sqrt2) < share_below ? low : high) = middle;
  }
  return low;
}

Image Resized(const Image& gray, int width_px, int height_px) {
  Image small{width_px, height_px, 1, {}};
  small.data.resize(static_cast<size_t>(width_px) * static_cast<size_t>(height_px));
  cv::Mat to(height_px, width_px, CV_8U, small.data.data());
  cv::resize(AsMat(gray), to, {width_px, height_px}, 0, 0, cv::INTER_AREA);
  return small;
}

EdgeImage ImageAt(const Image& gray, const Camera& camera, int side_px, double sigma_px) {
  const double scale =
      std::min(1.0, static_cast<double>(side_px) / std::max(gray.width_px, gray.height_px));
  const int width = std::max(8, static_cast<int>(std::lround(scale * gray.width_px)));
  const int height = std::max(8, static_cast<int>(std::lround(scale * gray.height_px)));
  return EdgeImage(Resized(gray, width, height), camera.Scaled(width, height), sigma_px);
}

// Returns a lens that sees about all that the camera sees when it is turned by up to `turn_rad`, as
// sharply: places are angles from its axis.
Camera WideCamera(const Camera& camera, double turn_rad) {
  Eigen::Array2d half = Eigen::Array2d::Zero();
  for (const Eigen::Vector2d& place : BorderAngles(camera)) {
    for (const double roll : {-turn_rad, 0.0, turn_rad}) {
      half = half.max((Eigen::Rotation2Dd(roll) * place).array().abs());
    }
  }
  const double focal_px = camera.MeanFocalPx();
  const Eigen::Array2i size =
      (2 * focal_px * (half + turn_rad).min(0.95 * std::numbers::pi)).max(8).cast<int>();
  const double params[] = {focal_px, 0.5 * size.x(), 0.5 * size.y(), 0};
  return {CameraModel::kSimpleRadialFisheye, size.x(), size.y(), params};
}

// Returns a pose that is turned by a rotation vector and whose center is moved.
Rigid3 Moved(const Rigid3& pose, const Eigen::Vector3d& turn, const Eigen::Vector3d& shift) {
  const Eigen::Quaterniond rotation = (RotationFromVector(turn) * pose.rotation).normalized();
  return {rotation, -(rotation * (pose.OriginInSource() + shift))};
}

// Returns poses of one rotation whose positions have these deviations, the first none.
std::vector<Rigid3> SpreadAround(const Rigid3& pose, const Eigen::Vector3d& sigma, size_t count) {
  std::vector<Rigid3> poses = {pose};
  for (size_t i = 1; i < count; ++i) {
    Eigen::Vector3d shift;
    for (int axis = 0; axis < 3; ++axis)
      shift[axis] = sigma[axis] * NormalQuantile(Spread(i, axis));
    poses.push_back(Moved(pose, Eigen::Vector3d::Zero(), shift));
  }
  return poses;
}

double MedianDistance(const Frame& frame) {
  std::vector<float> distances;
  for (const float distance : frame.distance) {
    if (distance > 0) distances.push_back(distance);
  }
  return distances.empty() ? 0 : UpperMedianInPlace(std::span(distances));
}

// Returns whether the picture of what is `distance` away moves by less than `turn_rad`, about.
bool AreNear(const Rigid3& a, const Rigid3& b, double turn_rad, double distance) {
  return AngleBetweenDeg(a.rotation, b.rotation) * kRadPerDeg < turn_rad &&
         (a.OriginInSource() - b.OriginInSource()).norm() < turn_rad * distance;
}

// Returns the best ones that are not near any better one.
std::vector<Scored> Distinct(std::vector<Scored> all, size_t most, double turn_rad,
                             double distance) {
  std::stable_sort(all.begin(), all.end(), BetterThan);
  std::vector<Scored> kept;
  for (const Scored& scored : all) {
    if (kept.size() == most) break;
    const bool is_new = std::none_of(kept.begin(), kept.end(), [&](const Scored& better) {
      return AreNear(better.cam_from_world, scored.cam_from_world, turn_rad, distance);
    });
    if (is_new) kept.push_back(scored);
  }
  return kept;
}

// Adds the scatter of the modes near the best one, each by the odds that it is the better one:
// where the mesh errs by pixels, it is by chance which edge a piece is taken for.
void AddCovarianceOfModes(std::vector<EdgeMode>& modes, double turn_rad, double distance) {
  EdgeMode& best = modes.front();
  Matrix6d scatter = Matrix6d::Zero();
  for (size_t i = 1; i < modes.size(); ++i) {
    const Rigid3& other = modes[i].fit.cam_from_world;
    if (!AreNear(best.fit.cam_from_world, other, turn_rad, distance)) continue;
    const Vector6d step = StepBetween(best.fit.cam_from_world, other);
    scatter += ChanceOf(best.cells - modes[i].cells) * step * step.transpose();
  }
  best.fit.covariance += scatter;
}

class Search {
 public:
  Search(const std::shared_ptr<const RayCaster>& mesh, const Camera& camera, const PosePrior& prior,
         uint64_t seed)
      : renderer_(mesh, FrameOfEdges()), prior_(prior), rng_(seed) {
    const PixelRays rays(camera, 1);
    for (const Rigid3& pose : FromPositions(kFewestPositions)) {
      EdgesFrom(rays, pose, 0);
      distance_ = MedianDistance(frame_);
      if (SeesAnything()) break;
    }
  }

  bool SeesAnything() const { return distance_ > 0; }
  double distance() const { return distance_; }
  size_t num_tried() const { return num_tried_; }

  std::vector<SceneEdge> EdgesFrom(const PixelRays& rays, const Rigid3& pose, size_t most) {
    renderer_.Render(rays, pose, 1, frame_);
    return SceneEdges(frame_, rays, pose, most);
  }

  double Score(const EdgeImage& image, std::span<const SceneEdge> edges, const Rigid3& pose) const {
    return EdgeScore(image, edges, pose) + LogPrior(prior_, pose);
  }

  double LeastScoreAt(const EdgeImage& image, const Rigid3& pose) {
    const auto edges = EdgesFrom(PixelRays(image.camera(), 1), pose, kCoarseEdges);
    return LeastScore(EdgeScoreByCell(image, edges, pose));
  }

  Scored WithPrior(const EdgeTurns::Scored& turned) const {
    return {turned.cam_from_world, turned.score + LogPrior(prior_, turned.cam_from_world)};
  }

  // Moves along each axis as long as that is better. What is seen is taken for the same.
  void Climb(const EdgeTurns& turns, std::span<const SceneEdge> edges, double step, Scored& best) {
    for (const double length : {2 * step, step, step / 2}) {
      for (int axis = 0; axis < 3; ++axis) {
        for (const int sign : {1, -1}) {
          const Eigen::Vector3d shift = sign * length * Eigen::Vector3d::Unit(axis);
          const Rigid3 moved = Moved(best.cam_from_world, Eigen::Vector3d::Zero(), shift);
          const Scored scored = WithPrior(turns.BestOfWindow(edges, moved));
          if (!(scored.score > best.score)) continue;
          best = scored;
          break;
        }
      }
    }
  }

  // Turns the camera at each position, of which a wide view serves all turns, and moves it from
  // the best of them.
  std::vector<Scored> Explore(const EdgeTurns& turns, std::span<const Rigid3> from,
                              double spacing) {
    const PixelRays rays(WideCamera(turns.camera(), turns.most_rad()), 1);
    std::vector<Scored> all;
    for (const Rigid3& at : from) {
      const auto edges = EdgesFrom(rays, at, EdgeTurns::kMost);
      std::vector<Scored> turned;
      for (const auto& best : turns.BestOfWindows(edges, at)) turned.push_back(WithPrior(best));
      std::sort(turned.begin(), turned.end(), BetterThan);
      turned.resize(std::min(kTurnsEach, turned.size()));
      for (Scored& scored : turned) {
        Climb(turns, edges, spacing / 4, scored);
        all.push_back(scored);
      }
    }
    return all;
  }

  // Returns the distance over which a position serves.
  double Spacing(const Camera& camera) const {
    return kSpacingPx / camera.MeanFocalPx() * distance_;
  }

  // Returns poses with the prior's rotation at positions that are spread over it. The mean squared
  // distance to the next one is least if their density goes with the power 3 / 5 of the prior's
  // (Zador).
  std::vector<Rigid3> FromPositions(size_t count) const {
    return SpreadAround(prior_.cam_from_world, std::sqrt(5.0 / 3) * prior_.sigma_position, count);
  }

  // Returns the number of positions at this spacing that fill the volume of the prior's normal
  // distribution.
  size_t NumPositions(double spacing) const {
    const double volume =
        std::pow(2 * std::numbers::pi, 1.5) * prior_.sigma_position.prod() / std::pow(spacing, 3);
    return static_cast<size_t>(
        std::clamp(volume, double{kFewestPositions}, double{kMostPositions}));
  }

  // Moves each of the best poses by what is seen from it.
  void LookAgain(const EdgeTurns& turns, double step, size_t most, std::vector<Scored>& poses) {
    poses = Distinct(std::move(poses), most, 1 / turns.camera().MeanFocalPx(), distance_);
    const PixelRays rays(WideCamera(turns.camera(), turns.ReachRad()), 1);
    for (Scored& scored : poses) {
      const auto edges = EdgesFrom(rays, scored.cam_from_world, EdgeTurns::kMost);
      scored = WithPrior(turns.BestOfWindow(edges, scored.cam_from_world));
      Climb(turns, edges, step, scored);
    }
  }

  // Looks for poses within the prior and fits them, and then all around the best of these, which
  // may have been drawn to the next edges but one.
  std::vector<Scored> Modes(const EdgeImage& smooth, const EdgeImage& sharp, size_t positions) {
    const double spacing = Spacing(smooth.camera());
    const EdgeTurns widely(smooth, kExploreCellPx, kFarthestTurn * prior_.sigma_deg * kRadPerDeg);
    const EdgeTurns narrowly(smooth, kExploreCellPx, widely.ReachRad());
    const EdgeTurns coarse(smooth, kExploreCellPx, 0);
    const EdgeTurns fine(sharp, 1, 0);
    num_tried_ = positions * widely.NumTried();
    std::vector<Scored> poses = Explore(widely, FromPositions(positions), spacing);
    LookAgain(coarse, spacing / 2, 4 * kPromising, poses);
    LookAgain(coarse, spacing / 4, 2 * kPromising, poses);
    LookAgain(fine, spacing / 4, kPromising, poses);
    Improve(sharp, kPromising / 2, poses);
    std::vector<Scored> around;
    for (size_t i = 0; i < std::min(kModesAround, poses.size()); ++i) {
      const auto more = Explore(
          narrowly,
          SpreadAround(poses[i].cam_from_world, Eigen::Vector3d::Constant(spacing), kAround),
          spacing / 2);
      around.insert(around.end(), more.begin(), more.end());
    }
    LookAgain(fine, spacing / 8, kPromising / 2, around);
    poses.insert(poses.end(), around.begin(), around.end());
    Improve(sharp, kPromising, poses);
    return poses;
  }

  // Fits each pose to what is seen from it, and keeps the best.
  void Improve(const EdgeImage& image, size_t most, std::vector<Scored>& poses) {
    const PixelRays rays(image.camera(), 1);
    for (Scored& scored : poses) {
      for (const double reach_px : {2 * kReachPx, kReachPx}) {
        const auto edges = EdgesFrom(rays, scored.cam_from_world, kCoarseEdges);
        const auto fit = FitEdges(image, edges, prior_, scored.cam_from_world, reach_px);
        scored.score = Score(image, edges, scored.cam_from_world);
        if (!fit) continue;
        const double score = Score(image, edges, fit->cam_from_world);
        if (score > scored.score) scored = {fit->cam_from_world, score};
      }
    }
    poses = Distinct(std::move(poses), most, 1 / image.camera().MeanFocalPx(), distance_);
  }

  // Fits each pose at the finest size.
  FoundByEdges Finish(const EdgeImage& image, std::span<const Scored> poses) {
    FoundByEdges found;
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
      const auto edges = EdgesFrom(rays, best.fit.cam_from_world, kFinestEdges);
      AddCovarianceByResampling(image, edges, prior_, kReachPx, rng_, best.fit);
      AddCovarianceOfModes(found.modes, kModePx / image.camera().MeanFocalPx(), distance_);
    }
    return found;
  }

 private:
  std::optional<EdgeMode> ModeFrom(const EdgeImage& image, const PixelRays& rays, Rigid3 pose) {
    constexpr int kFits = 4;
    EdgeMode mode;
    for (int round = 0; round < kFits; ++round) {
      const auto fit = FitEdges(image, EdgesFrom(rays, pose, kFinestEdges), prior_, pose, kReachPx);
      if (!fit) return std::nullopt;
      mode.fit = *fit;
      pose = fit->cam_from_world;
    }
    mode.cells = EdgeScoreByCell(image, EdgesFrom(rays, pose, kFinestEdges), pose);
    mode.score = mode.cells.sum() + LogPrior(prior_, pose);
    return mode;
  }

  FrameRenderer renderer_;
  PosePrior prior_;
  Rng rng_;
  Frame frame_;
  double distance_ = 0;  // of what is seen from the prior, the median
  size_t num_tried_ = 0;
};

// Widens the prior of a search by chance so that there are several places to be.
PosePrior Widened(PosePrior prior, double turn_rad, double distance) {
  prior.sigma_deg = std::max(prior.sigma_deg, turn_rad / kRadPerDeg);
  prior.sigma_position = prior.sigma_position.cwiseMax(turn_rad * distance);
  return prior;
}

// Returns LeastScore() of the modes that pictures of no place have, best first.
std::vector<double> ScoresByChance(const std::shared_ptr<const RayCaster>& mesh, const Image& gray,
                                   const Camera& camera, const PosePrior& prior, double mode_rad,
                                   uint64_t seed) {
  std::vector<double> scores;
  for (const NoPlace kind : {NoPlace::kMirrored, NoPlace::kUpsideDown}) {
    const Image flipped = Flipped(gray, kind);
    const Camera lens = Flipped(camera, kind);
    const EdgeImage sharp = ImageAt(flipped, lens, kCoarsePx, 1);
    Search search(mesh, sharp.camera(), prior, seed);
    const auto modes =
        search.Modes(ImageAt(flipped, lens, kCoarsePx, kExploreSigmaPx), sharp, kChancePositions);
    for (const Scored& mode : Distinct(modes, kPromising, mode_rad, search.distance())) {
      scores.push_back(search.LeastScoreAt(sharp, mode.cam_from_world));
    }
  }
  std::sort(scores.rbegin(), scores.rend());
  return scores;
}

// Returns the probability that another mode is right, if that or the best one is; 0 where it is the
// same place.
double ChanceOfOther(std::span<const EdgeMode> modes, size_t other) {
  const EdgeMode& best = modes.front();
  const Vector6d step = StepBetween(best.fit.cam_from_world, modes[other].fit.cam_from_world);
  if (step.dot(best.fit.covariance.ldlt().solve(step)) < kSameMode) return 0;
  return ChanceOf(best.cells - modes[other].cells);
}

// Returns whether it hangs on the chance whether the best mode counts as localized.
bool IsOpen(FoundByEdges found) {
  if (ConfidenceOf(found) >= kLocalizedConfidence) return false;
  found.chance = 0;
  return ConfidenceOf(found) >= kLocalizedConfidence;
}

}  // namespace

FoundByEdges SearchByEdges(const std::shared_ptr<const RayCaster>& mesh, const Image& gray,
                           const Camera& camera, const PosePrior& prior, uint64_t seed) {
  const EdgeImage smooth = ImageAt(gray, camera, kCoarsePx, kExploreSigmaPx);
  const EdgeImage sharp = ImageAt(gray, camera, kCoarsePx, 1);
  const EdgeImage finest = ImageAt(gray, camera, kFinestPx, 1);
  Search search(mesh, sharp.camera(), prior, seed);
  if (!search.SeesAnything()) return {};
  const size_t positions = search.NumPositions(search.Spacing(sharp.camera()));
  const auto poses = search.Modes(smooth, sharp, positions);
  FoundByEdges found =
      search.Finish(finest, std::span(poses).first(std::min(kModes, poses.size())));
  if (found.modes.empty()) return found;
  const EdgeMode& best = found.modes.front();
  found.chance = std::min(1.0, static_cast<double>(search.num_tried()) * ChanceOf(best.cells));
  if (!IsOpen(found)) return found;
  const double mode_rad = kModePx / finest.camera().MeanFocalPx();
  const auto by_chance = ScoresByChance(
      mesh, gray, camera, Widened(prior, 2 * mode_rad, search.distance()), mode_rad, seed);
  const double as_pictures_say = LeastProbabilityOfChance(
      ChanceOfScore(search.LeastScoreAt(sharp, best.fit.cam_from_world), by_chance,
                    static_cast<double>(positions) / kChancePositions));
  found.chance = std::min(found.chance, as_pictures_say);
  return found;
}

double ConfidenceOf(const FoundByEdges& found) {
  double right = found.modes.empty() ? 0 : 1 - found.chance;
  for (size_t i = 1; i < found.modes.size(); ++i) right *= 1 - ChanceOfOther(found.modes, i);
  return right;
}

std::vector<AlternativePose> AlternativesOf(const FoundByEdges& found) {
  const double right = ConfidenceOf(found);
  std::vector<AlternativePose> alternatives;
  for (size_t i = 1; i < found.modes.size(); ++i) {
    // A mode that is less likely by the prior is not likelier than the best.
    const double chance = std::min(ChanceOfOther(found.modes, i), 0.5);
    if (!(chance > 1 - kLocalizedConfidence)) continue;
    alternatives.push_back({found.modes[i].fit.cam_from_world, right * chance / (1 - chance)});
  }
  SortByProbability(alternatives);
  return alternatives;
}

}  // namespace raylift
