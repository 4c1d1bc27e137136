#include "estimation/hostile_problem.h"

#include <array>
#include <cmath>
#include <initializer_list>
#include <limits>
#include <utility>

#include "raylift/base/error.h"

namespace raylift {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using Real = std::numeric_limits<double>;
using Int = std::numeric_limits<int>;

class Maker {
 public:
  explicit Maker(Rng& rng) : rng_(rng) {}

  HostileProblem Make() {
    HostileProblem made;
    made.options = Options();
    MakeScene();
    PoseProblem& problem = made.problem;
    problem.name = "hostile";
    problem.query_camera = SomeCamera();
    const int num_references = Pick({0, 1, 2, 2, 3, 3, 5});
    for (int i = 0; i < num_references; ++i) {
      problem.references.push_back({"reference", SomeCamera(), SomePose()});
    }
    AddPairs(problem);
    AddPoints(problem);
    if (Chance(0.3)) AddPriors(problem);
    if (Chance(0.3)) AddClusters(problem);
    if (Chance(0.6)) Spoil(problem);
    return made;
  }

 private:
  bool Chance(double probability) { return rng_.Uniform() < probability; }
  template <typename T>
  T Pick(std::initializer_list<T> values) {
    return *(values.begin() + rng_.UniformIndex(static_cast<uint32_t>(values.size())));
  }
  template <typename T>
  T PickName() {
    const auto& names = kEnumNames<T>;
    return names[rng_.UniformIndex(static_cast<uint32_t>(names.size()))].value;
  }
  int UpTo(int most) {
    return static_cast<int>(rng_.UniformIndex(static_cast<uint32_t>(most + 1)));
  }
  Vector3d InBall() { return {rng_.Normal(), rng_.Normal(), rng_.Normal()}; }
  // Any order of magnitude that a unit can have.
  double Magnitude(double digits) { return std::pow(10, rng_.Uniform(-digits, digits)); }

  EstimatorOptions Options() {
    EstimatorOptions options;
    options.method = PickName<Method>();
    options.score = PickName<ScoreCombination>();
    options.local_optimization = PickName<LocalOptimization>();
    options.refinement = PickName<Refinement>();
    options.alpha = Pick({0.0, 0.8, 1e300});
    options.min_iterations = Pick({1, 2, 10});
    options.max_iterations = options.min_iterations + Pick({0, 1, 10, 30});
    options.confidence = Pick({0.5, 0.9999, 1e-300, std::nextafter(1.0, 0.0)});
    options.seed = rng_.NextBits();
    if (Chance(0.1)) {
      options.reprojection_threshold_px = Pick({1e-6, 0.1, 1e4, 1e300, Real::denorm_min()});
      options.sampson_threshold_px = Pick({1e-6, 0.1, 1e4, 1e300, Real::denorm_min()});
    }
    if (Chance(0.2)) options.point_sigma = Pick({0.01, 1.0, 1e-300, 1e300});
    if (Chance(0.1)) {
      options.refine_focal = true;
      options.focal_range = Pick({1.0, 1.3, kMaxFocalRange});
    }
    if (Chance(0.2)) {
      const auto noise = [this] {
        return KnownNoise{Pick({1e-300, 0.01, 1.0, 1e300}), Pick({0.0, 0.5, 10.0, 1e300})};
      };
      options.scene_noise =
          SceneNoise{noise(), noise(), noise(), Pick({0.0, 0.3, 1.0}), Pick({0.0, 0.1, 1e300})};
    }
    return options;
  }

  // What the scene's points have in common, and where it is in which unit.
  void MakeScene() {
    rank_ = Pick({0, 1, 2, 3, 3, 3, 3});
    for (Vector3d& axis : axes_) axis = InBall();
    unit_ = Chance(0.7) ? 1 : Magnitude(Chance(0.5) ? 6 : 150);
    middle_ = Vector3d::Zero();
    if (Chance(0.2)) middle_ = InBall() * Magnitude(Chance(0.5) ? 8 : 150);
    shared_centre_ = Chance(0.2);
    query_ = SomePose();
    num_distinct_ = Chance(0.2) ? Pick({1, 2, 3, 4}) : Int::max();
    outliers_ = Pick({0.0, 0.0, 0.3, 0.7, 1.0});
    noise_px_ = Pick({0.0, 0.1, 1.0, 30.0});
  }

  Camera SomeCamera() {
    if (Chance(0.5)) return Pinhole();
    const CameraModelInfo& info =
        AllCameraModels()[rng_.UniformIndex(static_cast<uint32_t>(AllCameraModels().size()))];
    std::array<double, kMaxCameraParams> params{};
    for (int i = 0; i < info.num_params; ++i) {
      const bool is_center = i == info.num_focal_lengths || i == info.num_focal_lengths + 1;
      if (i < info.num_focal_lengths || info.num_focal_lengths == 0) {
        params[static_cast<size_t>(i)] = 500;
      } else if (is_center) {
        params[static_cast<size_t>(i)] = 300;
      } else {
        params[static_cast<size_t>(i)] = Pick({0.0, 0.01, -0.1, 0.5, -3.0, 1e10});
      }
      if (Chance(0.02)) params[static_cast<size_t>(i)] = Number();
    }
    const auto num_params = static_cast<size_t>(info.num_params);
    try {
      return Camera(info.model, Chance(0.05) ? Int::max() : 640, Chance(0.05) ? 1 : 480,
                    std::span(params).first(num_params));
    } catch (const InputError&) {
      return Pinhole();
    }
  }

  Camera Pinhole() {
    const double focal_px = Chance(0.9) ? 500 : Pick({1e-300, 1e-6, 1.0, 1e7, 1e300});
    const double params[] = {focal_px, focal_px, 320, 240};
    return Camera(CameraModel::kPinhole, 640, 480, params);
  }

  // Looks at the scene from some five units.
  Rigid3 SomePose() {
    Rigid3 pose;
    pose.rotation = RotationFromVector(InBall() * Pick({0.0, 0.1, 1.0}));
    const Vector3d center = InBall() * (shared_centre_ ? 0 : 0.5);
    const Vector3d toward = pose.rotation.conjugate() * Vector3d(0, 0, -5);
    pose.translation = -(pose.rotation * (middle_ + unit_ * (center + toward)));
    return pose;
  }

  Vector3d PointInWorld() {
    Vector3d point = Vector3d::Zero();
    for (int i = 0; i < rank_; ++i) {
      point += axes_[static_cast<size_t>(i)] * rng_.Uniform(-1, 1);
    }
    return middle_ + unit_ * point;
  }

  Vector2d Pixel(const Camera& camera, const Rigid3& pose, const Vector3d& point) {
    const Vector2d anywhere(rng_.Uniform(0, 640), rng_.Uniform(0, 480));
    if (Chance(outliers_)) return anywhere;
    const auto pixel = camera.ImgFromCam(pose * point);
    return pixel.value_or(anywhere) + noise_px_ * Vector2d(rng_.Normal(), rng_.Normal());
  }

  // A keypoint seen by a few matches, or a point of its own.
  Vector3d NextPoint() {
    if (static_cast<int>(points_.size()) < num_distinct_ && (points_.empty() || Chance(0.7))) {
      points_.push_back(PointInWorld());
      return points_.back();
    }
    return points_[rng_.UniformIndex(static_cast<uint32_t>(points_.size()))];
  }

  void AddPairs(PoseProblem& problem) {
    if (problem.references.empty()) return;
    const int count = UpTo(Pick({2, 8, 12, 30}));
    for (int i = 0; i < count; ++i) {
      const Vector3d point = NextPoint();
      const int reference = UpTo(static_cast<int>(problem.references.size()) - 1);
      const PosedImage& image = problem.references[static_cast<size_t>(reference)];
      Match2D2D match{.reference = reference,
                      .query_px = Pixel(problem.query_camera, query_, point),
                      .reference_px = Pixel(image.camera, image.cam_from_world, point)};
      if (Chance(0.1)) match.reference_sigma_px = Pick({0.0, 0.5, 1e3});
      if (Chance(0.3)) match.query_keypoint = UpTo(10);
      if (Chance(0.3)) match.reference_keypoint = UpTo(10);
      problem.matches_2d2d.push_back(match);
      pair_points_.push_back(point);
    }
  }

  void AddPoints(PoseProblem& problem) {
    const bool are_lifted = Chance(0.5);
    const int count = UpTo(Pick({2, 8, 12, 30}));
    for (int i = 0; i < count; ++i) {
      Match2D3D match;
      if (are_lifted && static_cast<size_t>(i) < pair_points_.size()) {
        const Match2D2D& pair = problem.matches_2d2d[static_cast<size_t>(i)];
        match = {.query_px = pair.query_px,
                 .point_in_world = pair_points_[static_cast<size_t>(i)],
                 .reference = pair.reference,
                 .query_keypoint = pair.query_keypoint,
                 .match_2d2d = static_cast<size_t>(i)};
      } else {
        match.point_in_world = NextPoint();
        match.query_px = Pixel(problem.query_camera, query_, match.point_in_world);
        if (Chance(0.3)) match.query_keypoint = UpTo(10);
      }
      if (Chance(0.1)) match.point_sigma = unit_ * Pick({0.0, 0.01, 10.0});
      problem.matches_2d3d.push_back(match);
    }
  }

  void AddPriors(PoseProblem& problem) {
    if (Chance(0.5)) {
      const auto sigma = [this] { return unit_ * Pick({0.0, 1e-3, 1.0, 1e10}); };
      problem.priors.position =
          PositionPrior{query_.OriginInSource() + unit_ * InBall(), {sigma(), sigma(), sigma()}};
    }
    if (Chance(0.5)) {
      problem.priors.gravity = GravityPrior{query_.rotation * Vector3d(0, 0, -1) + 0.1 * InBall(),
                                            {0, 0, Pick({-1.0, 1e-200, 1e200})},
                                            Pick({0.0, 1.0, 1e10})};
    }
    if (Chance(0.2)) problem.reference_sigmas.factor = Pick({0.0, 1e-300, 0.1, 1e300});
    if (Chance(0.1)) problem.reference_sigmas.rotation_deg = Pick({0.0, 1e-300, 0.1, 1e300});
    if (Chance(0.1)) problem.reference_sigmas.position = Pick({0.0, 1e-300, 0.1, 1e300});
    if (Chance(0.3)) problem.priors.focal_sigma = Pick({0.0, 0.002, kMaxFocalSigma});
    if (Chance(0.3)) problem.priors.focal_range = Pick({1.0, 1.2, kMaxFocalRange});
  }

  void AddClusters(PoseProblem& problem) {
    for (size_t i = 0; i < problem.references.size(); ++i) {
      problem.reference_clusters.push_back(UpTo(2));
    }
  }

  double Number() {
    return Pick({Real::quiet_NaN(), Real::infinity(), -Real::infinity(), 0.0, -0.0, -1.0,
                 Real::denorm_min(), 1e-300, 1e-18, 1e18, -1e18, 1e300, -1e300, Real::max(),
                 Real::lowest(), 2147483648.0, 1e39});
  }
  int Index() { return Pick({-1, 0, 1, 7, 1 << 20, Int::max(), Int::min()}); }
  size_t Place() {
    return Pick({size_t{0}, size_t{7}, size_t{1} << 40, std::numeric_limits<size_t>::max()});
  }

  // Replaces what is there, here and there or all over.
  void Spoil(PoseProblem& problem) {
    const double share = Pick({0.003, 0.03, 0.3, 1.0});
    const bool indices_alone = Chance(0.2);
    const bool also_refused = Chance(0.1);  // what estimators blame the input for
    const auto numbers = [&](auto&& values) {
      for (double& value : values) {
        if (!indices_alone && Chance(share)) value = Number();
      }
    };
    const auto vector = [&](auto& values) {
      numbers(std::span(values.data(), static_cast<size_t>(values.size())));
    };
    const auto real = [&](std::optional<double>& value) {
      if (!indices_alone && Chance(share)) value = Number();
    };
    const auto index = [&](auto& value) {
      if (Chance(share)) value = Index();
    };
    for (PosedImage& reference : problem.references) {
      vector(reference.cam_from_world.rotation.coeffs());
      vector(reference.cam_from_world.translation);
    }
    for (Match2D2D& match : problem.matches_2d2d) {
      index(match.reference);
      vector(match.query_px);
      vector(match.reference_px);
      real(match.reference_sigma_px);
      if (also_refused) index(match.query_keypoint);
      index(match.reference_keypoint);
    }
    for (Match2D3D& match : problem.matches_2d3d) {
      vector(match.query_px);
      vector(match.point_in_world);
      index(match.reference);
      real(match.point_sigma);
      if (also_refused) index(match.query_keypoint);
      if (Chance(share)) match.match_2d2d = Place();
    }
    for (int& cluster : problem.reference_clusters) index(cluster);
    if (!also_refused) return;
    problem.reference_clusters.resize(static_cast<size_t>(UpTo(3)));
    if (problem.priors.position) {
      vector(problem.priors.position->position);
      vector(problem.priors.position->sigma);
    }
    if (problem.priors.gravity) {
      vector(problem.priors.gravity->down_in_cam);
      vector(problem.priors.gravity->down_in_world);
      numbers(std::span(&problem.priors.gravity->sigma_deg, 1));
    }
    numbers(std::span(&problem.priors.focal_range, 1));
  }

  Rng& rng_;
  int rank_ = 3;  // of the scene: a point, a line, a plane
  std::array<Vector3d, 3> axes_;
  double unit_ = 1;
  Vector3d middle_;
  bool shared_centre_ = false;
  Rigid3 query_;
  int num_distinct_ = 0;
  double outliers_ = 0;
  double noise_px_ = 0;
  std::vector<Vector3d> points_;
  std::vector<Vector3d> pair_points_;  // what each pair shows
};

}  // namespace

HostileProblem MakeHostileProblem(Rng& rng) { return Maker(rng).Make(); }

}  // namespace raylift
