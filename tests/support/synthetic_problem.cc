#include "support/synthetic_problem.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kDegree = std::numbers::pi / 180;

Camera PinholeCamera() {
  const double params[] = {585, 585, 320, 240};
  return Camera(CameraModel::kPinhole, 640, 480, params);
}

Vector3d NormalVector(Rng& rng) { return Vector3d{rng.Normal(), rng.Normal(), rng.Normal()}; }

double Draw(Rng& rng, UniformRange interval) { return rng.Uniform(interval.low, interval.high); }

// The orientation of a camera at `center` that looks at `target`, with y down.
Eigen::Quaterniond Facing(const Vector3d& center, const Vector3d& target) {
  const Vector3d z = (target - center).normalized();
  const Vector3d x = Vector3d::UnitY().cross(z).normalized();
  Eigen::Matrix3d rotation;
  rotation << x.transpose(), z.cross(x).transpose(), z.transpose();
  return Eigen::Quaterniond(rotation);
}

// Draws one problem in the query's camera frame. Braces around several draws, as they are made from
// left to right only there.
class ProblemMaker {
 public:
  ProblemMaker(const SyntheticOptions& options, Rng& rng)
      : options_(options), rng_(rng), camera_(options.camera.value_or(PinholeCamera())) {
    plane_normal_ = Vector3d{0.5 * rng.Normal(), 0.5 * rng.Normal(), -1}.normalized();
  }

  SyntheticProblem Make(const std::string& name) {
    SyntheticProblem result;
    result.problem.name = name;
    result.problem.query_camera = camera_;
    const std::vector<Rigid3> references = MakeReferences();
    AddMatches2D3D(result);
    AddMatches2D2D(references, result);
    MoveToWorld(references, result);
    return result;
  }

 private:
  Vector2d RandomPixel() {
    return Vector2d{rng_.Uniform(0, camera_.width_px()), rng_.Uniform(0, camera_.height_px())};
  }
  Vector2d Noise() { return options_.sigma_px * Vector2d{rng_.Normal(), rng_.Normal()}; }
  Vector3d SceneMiddle() const { return {0, 0, 0.5 * (options_.depth.low + options_.depth.high)}; }

  // A point of the scene that the query sees.
  Vector3d ScenePoint() {
    while (true) {
      const auto ray = camera_.RayInCam(RandomPixel());
      if (!ray || !(ray->z() > 0)) continue;
      const Vector3d scaled = *ray / ray->z();
      const double z = options_.scene == SceneShape::kPlane
                           ? plane_normal_.dot(SceneMiddle()) / plane_normal_.dot(scaled)
                           : Draw(rng_, options_.depth);
      if (z > 0.5 * options_.depth.low && z < 2 * options_.depth.high) return z * scaled;
    }
  }

  Vector3d ReferenceCenter() {
    while (true) {
      const Vector3d center{rng_.Uniform(-1, 1), rng_.Uniform(-1, 1), rng_.Uniform(-1, 1)};
      const double length = center.norm();
      if (length > 0.3 && length <= 1) return options_.baseline * center;
    }
  }

  // reference_from_query.
  std::vector<Rigid3> MakeReferences() {
    std::vector<Rigid3> references;
    const Vector3d shared = ReferenceCenter();
    for (int i = 0; i < options_.num_references; ++i) {
      Vector3d center = ReferenceCenter();
      const Vector3d axis = NormalVector(rng_).normalized();
      const double tilt = options_.tilt_deg * kDegree * rng_.Uniform();
      if (options_.layout == ReferenceLayout::kShared) center = shared;
      if (options_.layout == ReferenceLayout::kCoincident && i == 0) center.setZero();
      Eigen::Quaterniond rotation = RotationFromVector(tilt * axis) * Facing(center, SceneMiddle());
      if (options_.layout == ReferenceLayout::kForward) {
        const double distance = options_.baseline * rng_.Uniform(0.3, 1);
        center = {0, 0, rng_.Uniform() < 0.5 ? distance : -distance};
        rotation.setIdentity();
      }
      references.push_back({rotation, -(rotation * center)});
    }
    return references;
  }

  // `ratio` of the flags are set, at random places.
  std::vector<bool> DrawOutliers(int count, UniformRange ratio) {
    std::vector<bool> flags(static_cast<size_t>(count), false);
    const auto outliers = static_cast<size_t>(std::lround(Draw(rng_, ratio) * count));
    std::fill_n(flags.begin(), outliers, true);
    for (size_t i = flags.size(); i > 1; --i) {
      const size_t j = rng_.UniformIndex(static_cast<uint32_t>(i));
      const bool flag = flags[i - 1];
      flags[i - 1] = flags[j];
      flags[j] = flag;
    }
    return flags;
  }

  void AddMatches2D3D(SyntheticProblem& result) {
    result.is_outlier_2d3d = DrawOutliers(options_.num_2d3d, options_.outlier_ratio_2d3d);
    for (const bool is_outlier : result.is_outlier_2d3d) {
      const Vector3d point = ScenePoint();
      Match2D3D match;
      match.query_px = is_outlier ? RandomPixel() : camera_.ImgFromCam(point).value() + Noise();
      match.point_in_world = point + options_.sigma_point * NormalVector(rng_);
      result.problem.matches_2d3d.push_back(match);
    }
  }

  void AddMatches2D2D(const std::vector<Rigid3>& references, SyntheticProblem& result) {
    result.is_outlier_2d2d = DrawOutliers(options_.num_2d2d, options_.outlier_ratio_2d2d);
    for (int i = 0; i < options_.num_2d2d; ++i) {
      int reference = static_cast<int>(rng_.UniformIndex(static_cast<uint32_t>(references.size())));
      if (options_.split_five_and_one && i < 6) reference = i < 5 ? 0 : 1;
      result.problem.matches_2d2d.push_back(MakeMatch2D2D(
          reference, references[static_cast<size_t>(reference)], result.is_outlier_2d2d[i]));
    }
  }

  Match2D2D MakeMatch2D2D(int reference, const Rigid3& reference_from_query, bool is_outlier) {
    for (int attempt = 0; attempt < 100000; ++attempt) {
      const Vector3d point = ScenePoint();
      const auto pixel = camera_.ImgFromCam(reference_from_query * point);
      if (!pixel || !camera_.Contains(*pixel)) continue;
      const Vector2d query_px = camera_.ImgFromCam(point).value() + Noise();
      return {reference, query_px, is_outlier ? RandomPixel() : *pixel + Noise()};
    }
    RAYLIFT_CHECK(false && "a reference sees too little of the scene");
    return {};
  }

  // Into a world frame in which no axis is special, in the wanted unit.
  void MoveToWorld(const std::vector<Rigid3>& references, SyntheticProblem& result) {
    Eigen::Quaterniond rotation{rng_.Normal(), rng_.Normal(), rng_.Normal(), rng_.Normal()};
    rotation.normalize();
    const Vector3d near{rng_.Uniform(-20, 20), rng_.Uniform(-20, 20), rng_.Uniform(-20, 20)};
    const Vector3d offset = options_.origin_distance * NormalVector(rng_).normalized();
    const Rigid3 world_from_query{rotation, near + offset};
    const auto in_unit = [this](Rigid3 pose) {
      pose.translation *= options_.unit;
      return pose;
    };
    result.query_from_world = in_unit(world_from_query.Inverse());
    for (size_t i = 0; i < references.size(); ++i) {
      result.problem.references.push_back({fmt::format("reference-{:02}", i), camera_,
                                           in_unit(references[i] * world_from_query.Inverse())});
    }
    for (Match2D3D& match : result.problem.matches_2d3d) {
      match.point_in_world = options_.unit * (world_from_query * match.point_in_world);
    }
  }

  const SyntheticOptions& options_;
  Rng& rng_;
  Camera camera_;
  Vector3d plane_normal_;
};

SyntheticOptions Degenerate() {
  SyntheticOptions options;
  options.num_2d3d = 200;
  options.num_2d2d = 600;
  options.outlier_ratio_2d3d = options.outlier_ratio_2d2d = {0.3, 0.3};
  return options;
}

SyntheticOptions DegenerateLayout(ReferenceLayout layout) {
  SyntheticOptions options = Degenerate();
  options.layout = layout;
  return options;
}

std::vector<SyntheticRegime> MakeRegimes() {
  SyntheticOptions many_outliers;
  many_outliers.outlier_ratio_2d3d = many_outliers.outlier_ratio_2d2d = {0.5, 0.7};
  SyntheticOptions noisy;
  noisy.sigma_point = 0.3;
  noisy.outlier_ratio_2d3d = {0.3, 0.3};
  noisy.outlier_ratio_2d2d = {0.5, 0.5};
  SyntheticOptions sparse;
  sparse.num_2d3d = 30;
  sparse.num_2d2d = 300;
  sparse.outlier_ratio_2d3d = sparse.outlier_ratio_2d2d = {0.3, 0.3};
  SyntheticOptions planar = Degenerate();
  planar.scene = SceneShape::kPlane;
  SyntheticOptions tiny;
  tiny.num_2d3d = 3;
  tiny.num_2d2d = 6;
  tiny.outlier_ratio_2d3d = tiny.outlier_ratio_2d2d = {0, 0};
  tiny.sigma_px = 0.5;
  tiny.split_five_and_one = true;
  return {
      {"accurate", "accurate, 10 % outliers", "A", 50, SyntheticOptions{}},
      {"many_outliers", "accurate, 50-70 % outliers", "B", 50, many_outliers},
      {"noisy_points", "0.3 m point noise", "C", 50, noisy},
      {"few_points", "30 2D-3D, 300 2D-2D", "D", 50, sparse},
      {"shared_centre", "references share one center", "E1", 20,
       DegenerateLayout(ReferenceLayout::kShared)},
      {"planar_scene", "planar scene", "E2", 20, planar},
      {"reference_at_query", "a reference at the query", "E3", 20,
       DegenerateLayout(ReferenceLayout::kCoincident)},
      {"forward_motion", "pure forward motion", "E4", 20,
       DegenerateLayout(ReferenceLayout::kForward)},
      {"minimal", "3 2D-3D and 6 2D-2D", "F", 50, tiny},
  };
}

}  // namespace

SyntheticProblem MakeSyntheticProblem(const std::string& name, const SyntheticOptions& options,
                                      Rng& rng) {
  return ProblemMaker(options, rng).Make(name);
}

std::span<const SyntheticRegime> AllRegimes() {
  static const std::vector<SyntheticRegime> regimes = MakeRegimes();
  return regimes;
}

const SyntheticRegime& RegimeByName(std::string_view name) {
  const auto regimes = AllRegimes();
  const auto found = std::find_if(regimes.begin(), regimes.end(),
                                  [name](const SyntheticRegime& r) { return r.name == name; });
  RAYLIFT_CHECK(found != regimes.end());
  return *found;
}

std::vector<SyntheticProblem> MakeRegime(const SyntheticRegime& regime, int count, uint64_t seed) {
  std::vector<SyntheticProblem> problems;
  for (int i = 0; i < count; ++i) {
    const std::string name = fmt::format("{}-{:03}", regime.stream, i);
    Rng rng(StreamSeed(seed, name, "synthetic"));
    problems.push_back(MakeSyntheticProblem(name, regime.options, rng));
  }
  return problems;
}

}  // namespace raylift
