// Kernels that find where on its ray each keypoint of the joint refinement lies: see joint.h.

#pragma once

#include "estimation/kernels/joint_expectation.h"

namespace raylift::kernels {
namespace {

// The rays of a block's keypoints, in the local frame.
struct RayLanes {
  Real3 origin, direction;

  RayLanes(const JointKeypoints& keypoints, const WideParameters& parameters)
      : origin(parameters.Center(keypoints)) {
    const Real focal_error = Constant(parameters.of.focal_error);
    const Real3 row2 = Load3(keypoints.image_from_cam + 6);
    // The rows are those of the longer focal length.
    const Real3 row0 =
        Load3(keypoints.image_from_cam) + row2 * (focal_error * Load(keypoints.px_by_log_focal[0]));
    const Real3 row1 = Load3(keypoints.image_from_cam + 3) +
                       row2 * (focal_error * Load(keypoints.px_by_log_focal[1]));
    const Real3 ray = Cross(row0, row1);
    const Real length = SquareRoot(Dot(ray, ray));
    const Real sign = Select(Constant(0) < Dot(row2, ray), Constant(1), Constant(-1));
    direction = parameters.RotateBack(ray * (sign / length));
  }
  Real3 At(const Real& distance) const { return origin + direction * distance; }
};

// The residual in a reference, pixels, of a point that moves along the query's ray:
//   at_infinity + direction / (offset + slope * distance).
struct ScanLanes {
  Real at_infinity_x, at_infinity_y, direction_x, direction_y, offset, slope;

  ScanLanes(const JointObservations& slot, const RayLanes& ray) {
    const Real3 row0 = Load3(slot.image_from_ray), row1 = Load3(slot.image_from_ray + 3),
                row2 = Load3(slot.image_from_ray + 6);
    const Real3 start = ray.origin - Load3(slot.center);
    offset = Dot(row2, start);
    slope = Dot(row2, ray.direction);
    at_infinity_x = Dot(row0, ray.direction) / slope;
    at_infinity_y = Dot(row1, ray.direction) / slope;
    direction_x = Dot(row0, start) - offset * at_infinity_x;
    direction_y = Dot(row1, start) - offset * at_infinity_y;
  }
  explicit ScanLanes(const Row* rows)
      : at_infinity_x(Load(rows[0])),
        at_infinity_y(Load(rows[1])),
        direction_x(Load(rows[2])),
        direction_y(Load(rows[3])),
        offset(Load(rows[4])),
        slope(Load(rows[5])) {}
  void Store(Row* rows) const {
    const Real entries[] = {at_infinity_x, at_infinity_y, direction_x, direction_y, offset, slope};
    for (int i = 0; i < 6; ++i) entries[i].Store(rows[i]);
  }
  Real Squared(const Real& depth) const {
    const Real inverse = Constant(1) / depth;
    const Real x = at_infinity_x + direction_x * inverse;
    const Real y = at_infinity_y + direction_y * inverse;
    return x * x + y * y;
  }
  Real SquaredDirection() const { return direction_x * direction_x + direction_y * direction_y; }
  // Return the distance of the smallest error, and that error squared.
  Real BestDistance() const {
    const Real along = at_infinity_x * direction_x + at_infinity_y * direction_y;
    return (-SquaredDirection() / along - offset) / slope;
  }
  Real SmallestSquared() const {
    const Real cross = at_infinity_x * direction_y - at_infinity_y * direction_x;
    return cross * cross / SquaredDirection();
  }
};

// The likelihoods of a piece of evidence, right and with its depth or right alone, over a wrong
// one's.
struct RatioLanes {
  Real with_depth = Constant(0), without_depth = Constant(0);

  Real Right() const { return with_depth + without_depth; }
};

class VotingKernel {
 public:
  VotingKernel(const JointBlocks& blocks, const JointParameters& parameters,
               const JointVoting& voting)
      : blocks_(blocks),
        of_(parameters),
        wide_(parameters),
        depth_variance_(Constant(parameters.depth + parameters.common_depth)),
        pixel_variance_(2 * parameters.keypoint_px2),
        far_(Constant(voting.far * pixel_variance_)),
        fit_(Constant(voting.fit * pixel_variance_)),
        right_(Constant(parameters.right / (1 - parameters.right) * parameters.matched_area_px2 /
                        (kTwoPi * pixel_variance_))),
        mean_distance_(Exp(Constant(parameters.log_distance_mean))),
        as_good_as_parallel_(Exp(Constant(parameters.log_distance_mean +
                                          2 * __builtin_sqrt(parameters.log_distance_variance)))) {}

  void Vote(JointKeypoints& keypoints) const;

 private:
  struct Best {
    Real distance, log_evidence;
    Mask is_any;
  };

  void Consider(const JointKeypoints& keypoints, const RayLanes& ray, const Real& distance,
                const Mask& is_candidate, Best& best) const;
  RatioLanes RatiosOf(const JointObservations& slot, bool has_depths, const RayLanes& ray,
                      const Real& distance) const;
  Real RatioOf(const JointUnanchored& slot, const RayLanes& ray, const Real& distance) const;
  // Returns the logarithm of how much likelier the evidence is with the keypoint at this distance.
  Real LogEvidence(const JointKeypoints& keypoints, const RayLanes& ray,
                   const Real& distance) const;

  const JointBlocks& blocks_;
  const JointParameters& of_;
  const WideParameters wide_;
  const Real depth_variance_;
  const double pixel_variance_;  // both pixels' noise shows in the reference
  const Real far_, fit_;         // squared
  const Real right_, mean_distance_, as_good_as_parallel_;
};

RatioLanes VotingKernel::RatiosOf(const JointObservations& slot, bool has_depths,
                                  const RayLanes& ray, const Real& distance) const {
  const ScanLanes scan(slot.scan);
  const Real depth = scan.offset + scan.slope * distance;
  const Real squared = scan.Squared(depth);
  const Mask is_near =
      (Constant(0) < depth) & (squared < far_) & (Constant(0) < Load(slot.is_there));
  RatioLanes ratios;
  if (!Any(is_near)) return ratios;
  const Real right =
      Where(is_near, right_ * StudentDensity(squared * Constant(1 / pixel_variance_), of_) /
                         Load(slot.epipolar_clutter));
  ratios.without_depth = right;
  if (!has_depths) return ratios;
  const Real3 offset = ray.At(distance) - Load3(slot.center);
  const Real error = Constant(0.5) * Log(Dot(offset, offset)) - Load(slot.log_distance);
  const Real far = error * error / (depth_variance_ + Load(slot.depth_variance));
  const Mask has_depth = Constant(0) < Load(slot.has_depth);
  ratios.with_depth =
      Where(has_depth & (far < Constant(40)),
            right * Constant(of_.depth_right) * Load(slot.depth_ratio) * Exp(Constant(-0.5) * far));
  ratios.without_depth = right * Select(has_depth, Constant(1 - of_.depth_right), Constant(1));
  return ratios;
}

Real VotingKernel::RatioOf(const JointUnanchored& slot, const RayLanes& ray,
                           const Real& distance) const {
  const Real3 off = Load3(slot.point) - ray.At(distance);
  const Real along = Dot(off, ray.direction);
  const Real px2 = Load(slot.px2);
  const Real variance = Constant(of_.unanchored) + Load(slot.variance);
  const Real across = variance + Constant(of_.keypoint_px2) / px2;
  const Real of_distance = variance + Constant(1e-12) * distance * distance;
  const Real far = (Dot(off, off) - along * along) / across + along * along / of_distance;
  const Real density = Exp(Constant(-0.5) * far) /
                       (Constant(kTwoPi) * across * SquareRoot(Constant(kTwoPi) * of_distance));
  const Real any = DensityOfAny(Log(distance), of_) / distance;
  return Where((Constant(0) < Load(slot.is_there)) & (Constant(0) < px2),
               Constant(of_.unanchored_right / (1 - of_.unanchored_right) * of_.matched_area_px2) /
                   px2 * density / any);
}

Real VotingKernel::LogEvidence(const JointKeypoints& keypoints, const RayLanes& ray,
                               const Real& distance) const {
  const Real off = Log(distance) - Constant(of_.log_distance_mean);
  Real sum = off * off * Constant(-0.5 / of_.log_distance_variance);
  Real product = Constant(1);
  for (int i = keypoints.first_observation; i < keypoints.end_observation; ++i) {
    product =
        product * (Constant(1) +
                   RatiosOf(blocks_.observations[i], keypoints.has_depths, ray, distance).Right());
    // One logarithm for some factors, of which none is beyond 1e50.
    if ((i - keypoints.first_observation) % 4 != 3) continue;
    sum = sum + Log(product);
    product = Constant(1);
  }
  for (int i = keypoints.first_unanchored; i < keypoints.end_unanchored; ++i) {
    sum = sum + Log(Constant(1) + RatioOf(blocks_.unanchored[i], ray, distance));
  }
  return sum + Log(product);
}

void VotingKernel::Consider(const JointKeypoints& keypoints, const RayLanes& ray,
                            const Real& distance, const Mask& is_candidate, Best& best) const {
  if (!Any(is_candidate)) return;
  const Real log_evidence =
      LogEvidence(keypoints, ray, Select(is_candidate, distance, mean_distance_));
  const Mask is_better = is_candidate & (best.log_evidence < log_evidence);
  best.log_evidence = Select(is_better, log_evidence, best.log_evidence);
  best.distance = Select(is_better, distance, best.distance);
  best.is_any = best.is_any | is_candidate;
}

void VotingKernel::Vote(JointKeypoints& keypoints) const {
  const Real zero = Constant(0), one = Constant(1);
  const RayLanes ray(keypoints, wide_);
  Best best = {mean_distance_, Constant(-1e300), zero < zero};
  for (int i = keypoints.first_observation; i < keypoints.end_observation; ++i) {
    const JointObservations& slot = blocks_.observations[i];
    const ScanLanes scan(slot.scan);
    const Mask fits = (zero < Load(slot.is_there)) & (Load(slot.smallest_px2) < fit_);
    Real distance = scan.BestDistance();
    // Rays that do not meet are as good as parallel.
    distance = Select((zero < distance) & IsFinite(distance), distance, as_good_as_parallel_);
    Consider(keypoints, ray, distance, fits, best);
    if (!keypoints.has_depths) continue;
    const Real3 lifted = Load3(slot.center) + Load3(slot.ray) * Exp(Load(slot.log_distance));
    const Real along = Dot(lifted - ray.origin, ray.direction);
    const Real apart = Max(along - distance, distance - along);
    Consider(
        keypoints, ray, along,
        fits & (zero < Load(slot.has_depth)) & (zero < along) & (Constant(1e-3) * distance < apart),
        best);
  }
  for (int i = keypoints.first_unanchored; i < keypoints.end_unanchored; ++i) {
    const JointUnanchored& slot = blocks_.unanchored[i];
    const Real along = Dot(Load3(slot.point) - ray.origin, ray.direction);
    Consider(keypoints, ray, along, (zero < Load(slot.is_there)) & (zero < along), best);
  }
  // Rays that are as good as parallel fit any distance.
  const Mask is_any = best.is_any;
  Consider(keypoints, ray, mean_distance_, is_any, best);

  Store3(ray.At(best.distance), keypoints.point);
  zero.Store(keypoints.common);
  one.Store(keypoints.query_right);
  one.Store(keypoints.query_precision);
  for (int i = keypoints.first_observation; i < keypoints.end_observation; ++i) {
    JointObservations& slot = blocks_.observations[i];
    const RatioLanes ratios = RatiosOf(slot, keypoints.has_depths, ray, best.distance);
    const Real right = ratios.Right();
    Where(is_any, right / (right + one)).Store(slot.weight);
    Where(is_any & (zero < right), ratios.with_depth / right).Store(slot.depth);
    one.Store(slot.precision);
  }
  for (int i = keypoints.first_unanchored; i < keypoints.end_unanchored; ++i) {
    JointUnanchored& slot = blocks_.unanchored[i];
    const Real right = RatioOf(slot, ray, best.distance);
    Where(is_any, right / (right + one)).Store(slot.weight);
  }
}

// Fills what voting needs of each piece, before the clutter of references is known.
[[gnu::flatten]] void ScanJointly(const JointBlocks& blocks, const JointParameters& parameters) {
  const WideParameters wide(parameters);
  for (int k = 0; k < blocks.count; ++k) {
    const JointKeypoints& keypoints = blocks.keypoints[k];
    const RayLanes ray(keypoints, wide);
    for (int i = keypoints.first_observation; i < keypoints.end_observation; ++i) {
      JointObservations& slot = blocks.observations[i];
      const ScanLanes scan(slot, ray);
      scan.Store(slot.scan);
      scan.SmallestSquared().Store(slot.smallest_px2);
      if (!keypoints.has_depths) continue;
      const Real variance =
          Constant(parameters.depth + parameters.common_depth) + Load(slot.depth_variance);
      (Constant(1) / (SquareRoot(Constant(kTwoPi) * variance) *
                      DensityOfAny(Load(slot.log_distance), parameters)))
          .Store(slot.depth_ratio);
    }
    for (int i = keypoints.first_unanchored; i < keypoints.end_unanchored; ++i) {
      JointUnanchored& slot = blocks.unanchored[i];
      const PixelLanes seen(keypoints.image_from_cam,
                            wide.PointInCamera(keypoints, Load3(slot.point)));
      Where(seen.in_front,
            Constant(0.5) * (Dot(seen.by_ray.x, seen.by_ray.x) + Dot(seen.by_ray.y, seen.by_ray.y)))
          .Store(slot.px2);
    }
  }
}

[[gnu::flatten]] void VoteJointly(const JointBlocks& blocks, const JointParameters& parameters,
                                  const JointVoting& voting) {
  const VotingKernel kernel(blocks, parameters, voting);
  for (int k = 0; k < blocks.count; ++k) kernel.Vote(blocks.keypoints[k]);
}

}  // namespace
}  // namespace raylift::kernels
