// Refines placements of a mesh by the planes that the rays of keypoints meet, and makes them as
// simple as the matches allow.

#include <algorithm>
#include <cmath>

#include "diagnosis/mesh_frame.h"
#include "lifting/mesh_placement.h"
#include <Eigen/Cholesky>
#include <Eigen/Geometry>

#include "raylift/geometry/rigid3.h"

namespace raylift {
namespace {

// A placement of more freedom must have a score (PxScore) that is higher by this.
constexpr double kWorthOfFreedom = 0.05;

// Returns the value to some significant digits.
double Rounded(double value, int digits) {
  if (value == 0) return 0;
  const double unit = std::pow(10, std::floor(std::log10(std::abs(value))) + 1 - digits);
  return std::round(value / unit) * unit;
}

}  // namespace

MeshPlacement MeshFrameSearch::Refine(MeshPlacement placement, std::span<const Sample> samples,
                                      double tolerance, Freedom freedom) const {
  constexpr int kIterations = 8;
  const int unknowns = freedom == Freedom::kShift ? 3 : freedom == Freedom::kShiftAndScale ? 4 : 7;
  using Vector7d = Eigen::Matrix<double, 7, 1>;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    Eigen::Matrix<double, 7, 7> normal = Eigen::Matrix<double, 7, 7>::Zero();
    Vector7d right = Vector7d::Zero();
    const auto hits = Cast(samples, placement);
    for (size_t i = 0; i < samples.size(); ++i) {
      if (!hits[i] || !(hits[i]->ray_t > 0)) continue;
      const Sample& sample = samples[i];
      const double width = tolerance + 1 / sample.gain_px;
      const double off = std::log(hits[i]->ray_t / sample.z) / width;
      const double weight =
          1 / ((1 + off * off) * (1 + off * off) * width * width * sample.z * sample.z);
      const Eigen::Vector3d n = placement.axes * hits[i]->normal_in_world;
      const Eigen::Vector3d met = sample.origin + hits[i]->ray_t * sample.direction;
      const Eigen::Vector3d arm = met - center_;
      Vector7d row;
      row << n, n.dot(arm), arm.cross(n);
      const double residual = n.dot(sample.direction) * (sample.z - hits[i]->ray_t);
      normal += weight * row * row.transpose();
      right += weight * residual * row;
    }
    const auto part = normal.topLeftCorner(unknowns, unknowns).eval();
    const Eigen::MatrixXd damped = part + 1e-6 * Eigen::MatrixXd(part.diagonal().asDiagonal()) +
                                   1e-12 * Eigen::MatrixXd::Identity(unknowns, unknowns);
    Vector7d step = Vector7d::Zero();
    step.head(unknowns) = damped.ldlt().solve(right.head(unknowns));
    if (!step.allFinite()) break;
    const double factor = std::exp(std::clamp(step[3], -0.2, 0.2));
    const Eigen::Matrix3d turn = RotationFromVector(step.tail<3>()).toRotationMatrix();
    placement.scale *= factor;
    placement.axes = turn * placement.axes;
    placement.shift = center_ + factor * (turn * (placement.shift - center_)) + step.head<3>();
  }
  return placement;
}

// Returns the placement with axes that have a name instead of ones that are nearly so, turned about
// what where they are not or have one already.
std::optional<MeshPlacement> MeshFrameSearch::AlongAxes(const MeshPlacement& placement,
                                                        std::span<const Sample> samples) const {
  constexpr double kNear = 0.03;  // a degree, in norm
  const Eigen::Matrix3d axes = placement.axes.array().round() + 0.0;
  if (axes == placement.axes || (axes - placement.axes).norm() > kNear || !NameOfAxes(axes)) {
    return std::nullopt;
  }
  MeshPlacement turned = placement;
  turned.axes = axes;
  turned.shift = center_ + axes * placement.axes.transpose() * (placement.shift - center_);
  turned = Refine(turned, samples, 0.05, Freedom::kShiftAndScale);
  return Refine(turned, samples, 0.02, Freedom::kShiftAndScale);
}

// Returns a placement of known units, round numbers and no shift at all where they are about as
// good.
MeshPlacement MeshFrameSearch::Simplify(MeshPlacement refined) const {
  constexpr double kTolerance = 0.02;
  constexpr double kAboutAsGood = 1.15;
  const auto samples = std::span(fitting_).first(std::min<size_t>(2000, fitting_.size()));
  const double largest_px = std::max(kAboutAsGood * MedianPx(samples, refined), 0.1);
  // Fewer than half of the keypoints may see where it is along a corridor.
  const double least_score = PxScore(samples, refined) - kWorthOfFreedom;
  const auto as_good = [&](const MeshPlacement& other) {
    return MedianPx(samples, other) <= largest_px && PxScore(samples, other) >= least_score;
  };
  // It may be as its files have it.
  if (!as_placed_.IsIdentity() && as_good(Inverse(as_placed_))) return Inverse(as_placed_);
  const auto along_axes = AlongAxes(refined, samples);
  if (along_axes && as_good(*along_axes)) refined = *along_axes;
  MeshPlacement simple = refined;
  const double unit = std::exp(KnownUnit(std::log(refined.scale)));
  for (const double scale : {Rounded(unit, 4), Rounded(refined.scale, 1), Rounded(refined.scale, 2),
                             Rounded(refined.scale, 3)}) {
    MeshPlacement scaled = refined;
    scaled.scale = scale;
    MeshPlacement in_place = scaled;
    in_place.shift = Eigen::Vector3d::Zero();
    if (as_good(in_place)) return in_place;
    // About the points that are seen, then on with its own best shift.
    scaled.shift = center_ + scale / refined.scale * (refined.shift - center_);
    scaled = Refine(scaled, samples, 0.05, Freedom::kShift);
    scaled = Refine(scaled, samples, kTolerance, Freedom::kShift);
    if (as_good(scaled)) {
      simple = scaled;
      break;
    }
  }
  MeshPlacement in_place = simple;
  in_place.shift = Eigen::Vector3d::Zero();
  if (as_good(in_place)) return in_place;
  for (const int digits : {1, 2, 3, 4}) {
    MeshPlacement rounded = simple;
    const double unit_of_shift =
        std::pow(10, std::floor(std::log10(simple.shift.norm())) + 1 - digits);
    // No minus zeros.
    rounded.shift = (simple.shift / unit_of_shift).array().round() * unit_of_shift + 0.0;
    if (as_good(rounded)) return rounded;
  }
  return simple;
}

// Returns a score near 1 where keypoints are exact, near 0 where they are far off.
double MeshFrameSearch::PxScore(std::span<const Sample> samples,
                                const MeshPlacement& placement) const {
  constexpr double kWidthPx = 2;
  const auto hits = Cast(samples, placement);
  double score = 0;
  for (size_t i = 0; i < samples.size(); ++i) {
    if (!hits[i] || !(hits[i]->ray_t > 0)) continue;
    const double off = data_.ErrorAt(convention_, samples[i].keypoint, hits[i]->ray_t) / kWidthPx;
    score += 1 / (1 + off * off);
  }
  return score / static_cast<double>(samples.size());
}

// Takes the best of refinements of more and more freedom.
void MeshFrameSearch::RefineFully(Candidate& candidate, std::span<const Sample> samples) const {
  constexpr double kCoarse = 0.15;
  constexpr double kFine = 0.03;
  candidate.score = PxScore(samples, candidate.placement);
  // A scale, and a turn beside the axes, must pay for themselves.
  const auto consider = [&](Freedom freedom, double tolerance, double worth) {
    MeshPlacement refined = Refine(candidate.placement, samples, tolerance, freedom);
    if (tolerance > kFine) refined = Refine(refined, samples, kFine, freedom);
    const double score = PxScore(samples, refined);
    if (score > candidate.score + worth) candidate = {refined, score};
  };
  consider(Freedom::kShift, kFine, 0);
  consider(Freedom::kShift, kCoarse, 0);
  consider(Freedom::kShiftAndScale, kFine, 0.01);
  consider(Freedom::kShiftAndScale, kCoarse, 0.01);
  consider(Freedom::kSimilarity, kFine, kWorthOfFreedom);
  consider(Freedom::kSimilarity, kCoarse, kWorthOfFreedom);
}

}  // namespace raylift
