#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/constants.h"
#include "base/rng.h"
#include "surfaces/resampled_mesh.h"
#include "views/space_probe.h"
#include <Eigen/Geometry>
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"
#include "raylift/views/view_sampler.h"

namespace raylift {
namespace {

constexpr size_t kSurfaceSamples = 1500;
constexpr double kOutermost = 0.02;  // share of the samples, on each side
// Distance from the surface that a camera looks at, as a share of the mesh's size (the diagonal of
// its bounds without the outermost points).
constexpr double kMinDistance = 0.12;
constexpr double kMaxDistance = 0.5;
constexpr double kMinCoverage = 0.5;      // share of the picture that must see a surface
constexpr int kDirections = 1024;         // in which surfaces are looked for, around a camera
constexpr double kMaxObliqueDeg = 50;     // of the line of sight from the surface's normal
constexpr double kMaxIncidenceDeg = 70;   // beyond it a surface point does not count as seen
constexpr double kSimilarAngleDeg = 25;   // views of a point from similar places
constexpr double kSimilarDistance = 1.6;  // their distances' ratio
constexpr size_t kMinCandidates = 800;
constexpr size_t kCandidatesPerView = 16;

// A surface sample as a candidate view sees it.
struct SeenSample {
  size_t sample;
  Eigen::Vector3d toward_camera;  // unit
  double distance;
  int similar = 0;  // views taken so far that see it alike
};

struct Candidate {
  Rigid3 cam_from_world;
  std::vector<SeenSample> seen;
  bool taken = false;
};

bool IsAlike(const SeenSample& a, const SeenSample& b) {
  const double ratio = std::max(a.distance, b.distance) / std::min(a.distance, b.distance);
  return ratio < kSimilarDistance &&
         a.toward_camera.dot(b.toward_camera) > std::cos(kSimilarAngleDeg * kRadPerDeg);
}

double SizeOf(const std::vector<SurfaceSample>& samples) {
  Eigen::Vector3d extent = Eigen::Vector3d::Zero();
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> values;
    values.reserve(samples.size());
    for (const SurfaceSample& sample : samples) values.push_back(sample.point_in_world[axis]);
    std::sort(values.begin(), values.end());
    const auto skip = static_cast<size_t>(kOutermost * static_cast<double>(values.size()));
    if (!values.empty()) extent[axis] = values[values.size() - 1 - skip] - values[skip];
  }
  return extent.norm();
}

class CoveringSampler {
 public:
  CoveringSampler(const RayCaster& mesh, const ViewSamplerOptions& options)
      : mesh_(mesh),
        options_(options),
        up_(options.up_in_world.normalized()),
        samples_(SampleSurface(mesh.mesh(), kSurfaceSamples, options.seed)),
        size_(SizeOf(samples_)) {}

  SampledViews Run() {
    candidates_ = FindCandidates();
    if (candidates_.empty()) {
      throw InputError(
          "no place for a camera in front of the mesh's surfaces was found: is the clearance that "
          "of the scene's unit, are the triangles wound consistently?");
    }
    Index();
    SampledViews views;
    while (static_cast<int>(views.cam_from_world.size()) < options_.count) {
      Candidate* best = FindBest();
      if (best == nullptr) break;
      Take(*best);
      views.cam_from_world.push_back(best->cam_from_world);
    }
    if (static_cast<int>(views.cam_from_world.size()) < options_.count) {
      views.warnings.push_back(
          fmt::format("only {} of {} views were found that are clear of surfaces",
                      views.cam_from_world.size(), options_.count));
    }
    return views;
  }

  // Returns the sum over the views, each counted for what those before it do not show.
  double Measure(std::span<const Rigid3> cam_from_world) {
    candidates_.resize(cam_from_world.size());
    ParallelFor(cam_from_world.size(), options_.threads, [&](size_t i) {
      candidates_[i] = {cam_from_world[i], SeenSamples(cam_from_world[i])};
    });
    Index();
    double sum = 0;
    for (Candidate& candidate : candidates_) {
      sum += Gain(candidate);
      Take(candidate);
    }
    return samples_.empty() ? 0 : sum / static_cast<double>(samples_.size());
  }

 private:
  std::vector<Candidate> FindCandidates() const {
    const size_t count =
        samples_.empty()
            ? 0
            : std::max(kMinCandidates, kCandidatesPerView * static_cast<size_t>(options_.count));
    std::vector<std::optional<Candidate>> tried(count);
    ParallelFor(count, options_.threads, [&](size_t i) {
      if (const auto pose = DrawPose(i)) tried[i] = Candidate{*pose, SeenSamples(*pose)};
    });
    std::vector<Candidate> found;
    for (auto& candidate : tried) {
      if (candidate) found.push_back(std::move(*candidate));
    }
    return found;
  }

  // Draws a camera that looks at a random surface point; nullopt where there is no room for it or
  // not enough to see.
  std::optional<Rigid3> DrawPose(size_t index) const {
    Rng rng(StreamSeed(options_.seed, std::to_string(index), "covering"));
    const SurfaceSample& target =
        samples_[rng.UniformIndex(static_cast<uint32_t>(samples_.size()))];
    Eigen::Vector3d normal = target.normal_in_world;
    if (options_.any_side && rng.UniformIndex(2) == 0) normal = -normal;
    const Eigen::Vector3d outward = DirectionAround(normal, rng);
    const double distance =
        size_ * std::exp(rng.Uniform(std::log(kMinDistance), std::log(kMaxDistance)));
    const Eigen::Vector3d eye = target.point_in_world + distance * outward;
    if (!Sees(eye, target.point_in_world)) return std::nullopt;
    const Surroundings around = ProbeSurroundings(mesh_, eye, kDirections);
    if (around.clearance < options_.clearance) return std::nullopt;
    const Rigid3 pose = LookAlong(eye, -outward, up_);
    const VisibleSurface sight = MeasureView(mesh_, options_.camera, pose);
    if (sight.coverage < kMinCoverage || sight.median_range < 2 * options_.clearance) {
      return std::nullopt;
    }
    if (!options_.any_side && sight.front_share < kMinFrontShare) return std::nullopt;
    return pose;
  }

  // Returns a random direction within kMaxObliqueDeg of a unit vector, evenly by area.
  static Eigen::Vector3d DirectionAround(const Eigen::Vector3d& axis, Rng& rng) {
    const double cosine = rng.Uniform(std::cos(kMaxObliqueDeg * kRadPerDeg), 1);
    const double bearing = rng.Uniform(0, 2 * std::numbers::pi);
    const Eigen::Vector3d aside = axis.unitOrthogonal();
    return cosine * axis + std::sqrt(1 - cosine * cosine) *
                               (std::cos(bearing) * aside + std::sin(bearing) * axis.cross(aside));
  }

  bool Sees(const Eigen::Vector3d& eye, const Eigen::Vector3d& point) const {
    const Ray ray{eye, point - eye};
    const auto hit = mesh_.Cast(std::span(&ray, 1)).front();
    return hit && std::abs(hit->ray_t - 1) < 1e-3;
  }

  std::vector<SeenSample> SeenSamples(const Rigid3& cam_from_world) const {
    const Eigen::Vector3d eye = cam_from_world.OriginInSource();
    std::vector<SeenSample> seen;
    std::vector<Ray> rays;
    for (size_t i = 0; i < samples_.size(); ++i) {
      const Eigen::Vector3d to_camera = eye - samples_[i].point_in_world;
      const double cosine = to_camera.normalized().dot(samples_[i].normal_in_world);
      if ((options_.any_side ? std::abs(cosine) : cosine) <
          std::cos(kMaxIncidenceDeg * kRadPerDeg)) {
        continue;
      }
      const auto pixel = options_.camera.ImgFromCam(cam_from_world * samples_[i].point_in_world);
      if (!pixel || !options_.camera.Contains(*pixel)) continue;
      seen.push_back({i, to_camera.normalized(), to_camera.norm()});
      rays.push_back({eye, -to_camera});
    }
    const auto hits = mesh_.Cast(rays);
    std::vector<SeenSample> visible;
    for (size_t i = 0; i < seen.size(); ++i) {
      if (hits[i] && std::abs(hits[i]->ray_t - 1) < 1e-2) visible.push_back(seen[i]);
    }
    return visible;
  }

  void Index() {
    seen_of_sample_.assign(samples_.size(), {});
    for (Candidate& candidate : candidates_) {
      for (SeenSample& seen : candidate.seen) seen_of_sample_[seen.sample].push_back(&seen);
    }
  }

  static double Gain(const Candidate& candidate) {
    double gain = 0;
    for (const SeenSample& seen : candidate.seen) gain += 1.0 / (1 + seen.similar);
    return gain;
  }

  // Returns the first of those that add most; null where none adds anything.
  Candidate* FindBest() {
    Candidate* best = nullptr;
    double most = 0;
    for (Candidate& candidate : candidates_) {
      if (candidate.taken) continue;
      const double gain = Gain(candidate);
      if (gain > most) {
        most = gain;
        best = &candidate;
      }
    }
    return best;
  }

  void Take(Candidate& candidate) {
    candidate.taken = true;
    for (const SeenSample& taken : candidate.seen) {
      for (SeenSample* other : seen_of_sample_[taken.sample]) {
        if (IsAlike(taken, *other)) ++other->similar;
      }
    }
  }

  const RayCaster& mesh_;
  const ViewSamplerOptions& options_;
  Eigen::Vector3d up_;
  std::vector<SurfaceSample> samples_;
  double size_;
  std::vector<Candidate> candidates_;
  std::vector<std::vector<SeenSample*>> seen_of_sample_;  // into candidates_
};

}  // namespace

SampledViews SampleCovering(const RayCaster& mesh, const ViewSamplerOptions& options) {
  return CoveringSampler(mesh, options).Run();
}

double CoverageOf(const RayCaster& mesh, const ViewSamplerOptions& options,
                  std::span<const Rigid3> cam_from_world) {
  return CoveringSampler(mesh, options).Measure(cam_from_world);
}

double MeshSize(const TriangleMesh& mesh, uint64_t seed) {
  return SizeOf(SampleSurface(mesh, kSurfaceSamples, seed));
}

}  // namespace raylift
