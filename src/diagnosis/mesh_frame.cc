#include "diagnosis/mesh_frame.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>
#include <utility>

#include "base/rng.h"
#include "base/statistics.h"
#include "diagnosis/match_agreement.h"
#include "diagnosis/stored_faults.h"
#include "diagnosis/surface_grid.h"
#include "geometry/signed_permutations.h"
#include "lifting/mesh_spec.h"
#include "surfaces/resampled_mesh.h"
#include <Eigen/Geometry>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"

namespace raylift {
namespace {

// Keypoints whose depth is less certain than this are not used.
constexpr double kLeastGainPx = 10;

// Scales of meshes that are usual, apart from the right one.
constexpr std::array<double, 13> kUsualScales = {
    1, 0.001, 0.01, 0.1, 10, 100, 1000, 0.5, 2, 0.0254, 1 / 0.0254, 0.3048, 1 / 0.3048};

double AreaOfBox(const Eigen::Vector3d& size) {
  return 2 * (size.x() * size.y() + size.y() * size.z() + size.z() * size.x());
}

// Returns how many triangles' boxes a random line through the mesh's box crosses (as areas of
// convex bodies tell): of scenes dozens, of triangles at random thousands, among which each ray is
// slow.
double ExpectedCrossings(const TriangleMesh& mesh) {
  Eigen::Array3d low = Eigen::Array3d::Constant(std::numeric_limits<double>::infinity());
  Eigen::Array3d high = -low;
  double sum = 0;
  for (const auto& t : mesh.triangles) {
    const Eigen::Array3d a = mesh.vertices[t[0]].cast<double>().array();
    const Eigen::Array3d b = mesh.vertices[t[1]].cast<double>().array();
    const Eigen::Array3d c = mesh.vertices[t[2]].cast<double>().array();
    const Eigen::Array3d own_low = a.min(b).min(c);
    const Eigen::Array3d own_high = a.max(b).max(c);
    sum += AreaOfBox(own_high - own_low);
    low = low.min(own_low);
    high = high.max(own_high);
  }
  const double whole = AreaOfBox(high - low);
  return whole > 0 ? sum / whole : 0;
}

template <typename Candidate>
void KeepBest(std::vector<Candidate>& candidates, size_t count) {
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.score > b.score; });
  candidates.resize(std::min(count, candidates.size()));
}

}  // namespace

MeshFrameSearch::MeshFrameSearch(const RayCaster& mesh, const DoctorInput& input,
                                 const ConventionResiduals& data, const DataConvention& convention,
                                 int threads)
    : mesh_(mesh),
      data_(data),
      convention_(convention),
      as_placed_(input.as_placed),
      threads_(threads) {
  const auto triangulated = data.Triangulated(convention.poses);
  std::vector<PosedImage> posed;
  for (const PosedImage& reference : input.references) {
    posed.push_back(ReadAs(reference, input.as_read.poses, convention.poses));
  }
  const std::vector<Half> halves = SplitKeypoints(data);
  std::vector<Eigen::Vector3d> points;
  for (size_t i = 0; i < triangulated.size(); ++i) {
    if (halves[i] == Half::kNeither || !triangulated[i] || triangulated[i]->gain_px < kLeastGainPx)
      continue;
    const auto& keypoint = data.keypoints()[i];
    const PosedImage& map = posed[static_cast<size_t>(keypoint.map)];
    const auto ray = map.camera.RayInCam(keypoint.pixel);
    if (!ray || !(ray->z() > 0)) continue;
    const Sample sample{.keypoint = i,
                        .origin = map.cam_from_world.OriginInSource(),
                        .direction = map.cam_from_world.rotation.conjugate() * (*ray / ray->z()),
                        .z = triangulated[i]->z,
                        .gain_px = triangulated[i]->gain_px};
    if (halves[i] == Half::kFitting) {
      fitting_.push_back(sample);
      points.push_back(sample.origin + sample.z * sample.direction);
    } else {
      held_out_.push_back(sample);
    }
  }
  if (!points.empty()) center_ = Quantile(points, 0.5);
  Rng rng(0);
  for (size_t i = fitting_.size(); i > 1; --i) {
    std::swap(fitting_[i - 1], fitting_[rng.UniformIndex(static_cast<uint32_t>(i))]);
  }
}

std::vector<std::optional<RayHit>> MeshFrameSearch::Cast(std::span<const Sample> samples,
                                                         const MeshPlacement& placement) const {
  const Eigen::Matrix3d mesh_from_world = placement.axes.transpose() / placement.scale;
  std::vector<Ray> rays;
  rays.reserve(samples.size());
  for (const Sample& sample : samples) {
    rays.push_back({mesh_from_world * (sample.origin - placement.shift),
                    mesh_from_world * sample.direction, 0});
  }
  return mesh_.Cast(rays);
}

double MeshFrameSearch::Score(std::span<const Sample> samples, const MeshPlacement& placement,
                              double tolerance) const {
  const auto hits = Cast(samples, placement);
  double score = 0;
  for (size_t i = 0; i < samples.size(); ++i) {
    if (!hits[i] || !(hits[i]->ray_t > 0)) continue;
    const double width = tolerance + 1 / samples[i].gain_px;
    const double off = std::log(hits[i]->ray_t / samples[i].z) / width;
    score += std::max(0.0, 1 - off * off);
  }
  return score / static_cast<double>(samples.size());
}

double MeshFrameSearch::MedianPx(std::span<const Sample> samples,
                                 const MeshPlacement& placement) const {
  const auto hits = Cast(samples, placement);
  std::vector<double> errors_px;
  for (size_t i = 0; i < samples.size(); ++i) {
    const bool met = hits[i] && hits[i]->ray_t > 0;
    errors_px.push_back(met ? data_.ErrorAt(convention_, samples[i].keypoint, hits[i]->ray_t)
                            : ConventionResiduals::kLargestPx);
  }
  return UpperMedianOr(std::move(errors_px), ConventionResiduals::kLargestPx);
}

std::vector<MeshFrameSearch::Candidate> MeshFrameSearch::ScaledAboutOrigin() const {
  constexpr double kStep = 0.05;
  constexpr double kTolerance = 0.12;
  const double largest = std::log(2e4);
  const auto few = std::span(fitting_).first(std::min<size_t>(48, fitting_.size()));
  const auto more = std::span(fitting_).first(std::min<size_t>(300, fitting_.size()));
  const std::vector<Eigen::Matrix3d> all_axes = SignedPermutations();
  std::vector<std::vector<Candidate>> of_axes(all_axes.size());
  ParallelFor(all_axes.size(), threads_, [&](size_t a) {
    std::vector<Candidate>& candidates = of_axes[a];
    const auto add = [&](double scale) {
      Candidate candidate{{.scale = scale, .axes = all_axes[a]}};
      candidate.score = Score(few, candidate.placement, kTolerance);
      candidates.push_back(candidate);
    };
    for (double log_scale = -largest; log_scale <= largest; log_scale += kStep) {
      add(std::exp(log_scale));
    }
    for (const double scale : kUsualScales) add(scale);
    KeepBest(candidates, 3);
    for (Candidate& candidate : candidates) {
      candidate.score = Score(more, candidate.placement, kTolerance);
    }
    KeepBest(candidates, 1);
  });
  std::vector<Candidate> candidates;
  for (const auto& some : of_axes) candidates.insert(candidates.end(), some.begin(), some.end());
  KeepBest(candidates, 16);
  return candidates;
}

std::vector<MeshFrameSearch::Candidate> MeshFrameSearch::Shifted() const {
  std::vector<Eigen::Vector3d> points;
  for (const Sample& sample : std::span(fitting_).first(std::min<size_t>(2000, fitting_.size()))) {
    points.push_back(sample.origin + sample.z * sample.direction);
  }
  const Eigen::Vector3d low = Quantile(points, 0.05);
  const Eigen::Vector3d high = Quantile(points, 0.95);
  std::erase_if(points, [&](const Eigen::Vector3d& p) {
    return (p.array() < low.array()).any() || (p.array() > high.array()).any();
  });
  constexpr size_t kPoints = 100;
  points.resize(std::min(points.size(), kPoints));
  if (points.empty()) return {};
  constexpr size_t kSurfaceSamples = 30000;
  std::vector<Eigen::Vector3d> surface;
  for (const SurfaceSample& sample : SampleSurface(mesh_.mesh(), kSurfaceSamples, 0)) {
    surface.push_back(sample.point_in_world);
  }
  if (surface.empty()) return {};
  const SurfaceGrid grid(surface);
  if (grid.IsFull()) return {};
  const double mesh_extent = (grid.high() - grid.low()).norm();
  const double extent = (high - low).norm();
  struct Start {
    Eigen::Matrix3d axes;
    double scale;
  };
  std::vector<Start> starts;
  for (const double scale : kUsualScales) {
    // References see a part of the mesh that is not tiny.
    constexpr double kSmallest = 0.6;
    constexpr double kLargest = 12;
    const double ratio = scale * mesh_extent / extent;
    if (ratio < kSmallest || ratio > kLargest) continue;
    for (const Eigen::Matrix3d& axes : SignedPermutations()) starts.push_back({axes, scale});
  }
  const auto some = std::span(fitting_).first(std::min<size_t>(200, fitting_.size()));
  std::vector<std::vector<Candidate>> of_start(starts.size());
  ParallelFor(starts.size(), threads_, [&](size_t s) {
    const Start& start = starts[s];
    std::vector<Eigen::Vector3d> in_mesh;
    for (const Eigen::Vector3d& point : points) {
      in_mesh.push_back(start.axes.transpose() * point / start.scale);
    }
    // A shift alone is the most usual.
    const bool alone = start.scale == 1 && start.axes == Eigen::Matrix3d::Identity();
    for (const ScoredShift& found : BestShifts(grid, in_mesh, alone ? 40 : 6)) {
      Candidate candidate{{.scale = start.scale,
                           .axes = start.axes,
                           .shift = -start.scale * (start.axes * found.shift)}};
      candidate.score = Score(some, candidate.placement, 0.15);
      of_start[s].push_back(candidate);
    }
  });
  std::vector<Candidate> candidates;
  for (const auto& found : of_start) {
    candidates.insert(candidates.end(), found.begin(), found.end());
  }
  KeepBest(candidates, 64);
  ParallelFor(candidates.size(), threads_, [&](size_t i) {
    MeshPlacement& placement = candidates[i].placement;
    placement = Refine(placement, some, 0.2, Freedom::kShift);
    placement = Refine(placement, some, 0.06, Freedom::kShift);
    candidates[i].score = Score(some, placement, 0.04);
  });
  return BestDifferent(std::move(candidates), 32);
}

// Returns the best `count` placements that differ from each other, as many starts come to the same
// one.
std::vector<MeshFrameSearch::Candidate> MeshFrameSearch::BestDifferent(
    std::vector<Candidate> candidates, size_t count) const {
  KeepBest(candidates, candidates.size());
  std::vector<Candidate> different;
  for (const Candidate& candidate : candidates) {
    if (different.size() == count) break;
    const bool known = std::any_of(different.begin(), different.end(), [&](const auto& other) {
      return IsSame(other.placement, candidate.placement);
    });
    if (!known) different.push_back(candidate);
  }
  return different;
}

PlacedMesh MeshFrameSearch::Judge(const MeshPlacement& placement) const {
  const auto hits = Cast(held_out_, placement);
  std::vector<std::optional<double>> depths(data_.keypoints().size());
  for (size_t i = 0; i < hits.size(); ++i) {
    if (hits[i] && hits[i]->ray_t > 0) depths[held_out_[i].keypoint] = hits[i]->ray_t;
  }
  const std::vector<size_t> shuffled = data_.Shuffled();
  std::vector<double> errors_px, chance_px;
  for (const Sample& sample : held_out_) {
    const size_t i = sample.keypoint;
    if (depths[i]) errors_px.push_back(data_.ErrorAt(convention_, i, *depths[i]));
    if (const auto& other = depths[shuffled[i]]) {
      chance_px.push_back(data_.ErrorAt(convention_, i, *other));
    }
  }
  PlacedMesh placed{
      placement, placement * as_placed_, MakeFit(std::move(errors_px), std::move(chance_px)), {}};
  data_.LimitChance(convention_, depths, placed.fit);
  placed.errors_px.resize(depths.size());
  for (const Sample& sample : held_out_) {
    const auto& depth = depths[sample.keypoint];
    placed.errors_px[sample.keypoint] = depth ? data_.ErrorAt(convention_, sample.keypoint, *depth)
                                              : ConventionResiduals::kLargestPx;
  }
  placed.fit.asked = held_out_.size();
  placed.fit.coverage = static_cast<double>(placed.fit.count) /
                        std::max<double>(1, static_cast<double>(held_out_.size()));
  return placed;
}

// Rates the placement by its keys, to their digits: that is what the user will have.
PlacedMesh MeshFrameSearch::JudgeByKeys(const MeshPlacement& placement) const {
  const std::string keys = KeysOf(placement * as_placed_);
  const MeshPlacement by_keys =
      ParseMeshSpec("mesh:found" + (keys.empty() ? "" : "," + keys), MeshUse::kLift).placement;
  PlacedMesh placed = Judge(by_keys * Inverse(as_placed_));
  placed.from_files = by_keys;
  return placed;
}

// Returns whether most keypoints lie on the same places of the mesh.
bool MeshFrameSearch::IsSame(const MeshPlacement& a, const MeshPlacement& b) const {
  constexpr double kSamePlace = 0.1;  // of the depth
  const auto samples = std::span(fitting_).first(std::min<size_t>(300, fitting_.size()));
  const auto hits_a = Cast(samples, a);
  const auto hits_b = Cast(samples, b);
  size_t both = 0;
  size_t same = 0;
  for (size_t i = 0; i < samples.size(); ++i) {
    if (!hits_a[i] || !hits_b[i]) continue;
    const auto in_mesh = [&](const MeshPlacement& p, const RayHit& hit) -> Eigen::Vector3d {
      const Eigen::Vector3d point = samples[i].origin + hit.ray_t * samples[i].direction;
      return p.axes.transpose() * (point - p.shift) / p.scale;
    };
    ++both;
    const double apart = (in_mesh(a, *hits_a[i]) - in_mesh(b, *hits_b[i])).norm();
    if (apart * std::min(a.scale, b.scale) < kSamePlace * samples[i].z) ++same;
  }
  return 2 * same > both;
}

MeshSearch MeshFrameSearch::Obstacle() const {
  constexpr size_t kFewest = 30;
  constexpr double kMostCrossings = 500;
  if (fitting_.size() < kFewest || held_out_.size() < kFewest) return MeshSearch::kTooFewMatches;
  if (ExpectedCrossings(mesh_.mesh()) > kMostCrossings) return MeshSearch::kTooTangled;
  return MeshSearch::kNoneFound;
}

std::vector<PlacedMesh> MeshFrameSearch::Find() const {
  if (Obstacle() != MeshSearch::kNoneFound || mesh_.mesh().triangles.empty()) return {};
  std::vector<Candidate> candidates = ScaledAboutOrigin();
  const std::vector<Candidate> shifted = Shifted();
  candidates.insert(candidates.end(), shifted.begin(), shifted.end());
  const auto samples = [&](size_t count) {
    return std::span(fitting_).first(std::min(count, fitting_.size()));
  };
  ParallelFor(candidates.size(), threads_,
              [&](size_t i) { RefineFully(candidates[i], samples(200)); });
  candidates = BestDifferent(std::move(candidates), 8);
  ParallelFor(candidates.size(), threads_, [&](size_t i) {
    for (int round = 0; round < 2; ++round) RefineFully(candidates[i], samples(600));
  });
  KeepBest(candidates, candidates.size());
  std::vector<PlacedMesh> found;
  constexpr size_t kMost = 3;
  for (const Candidate& candidate : candidates) {
    const bool known = std::any_of(found.begin(), found.end(), [&](const PlacedMesh& other) {
      return IsSame(other.placement, candidate.placement);
    });
    if (known) continue;
    PlacedMesh placed = JudgeByKeys(Simplify(candidate.placement));
    const bool became_known = std::any_of(found.begin(), found.end(), [&](const PlacedMesh& other) {
      return IsSame(other.placement, placed.placement);
    });
    if (!became_known) found.push_back(std::move(placed));
    if (found.size() == kMost) break;
  }
  return found;
}

}  // namespace raylift
