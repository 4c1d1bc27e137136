// The E step of the joint refinement as a kernel: see joint.h and, for the equations, README.md in
// src/estimation.

#pragma once

#include "estimation/kernels/joint_lanes.h"

namespace raylift::kernels {
namespace {

constexpr double kTwoPi = 6.283185307179586;
constexpr double kAsGoodAsNormalTail = 1e-3;
constexpr double kLeastDistanceDensity = 1e-9;

// Returns Student's density over that at the center: (1 + tail squared)^-(1 + 1 / (2 tail)).
inline Real StudentDensity(const Real& squared, const JointParameters& of) {
  if (of.keypoint_tail < kAsGoodAsNormalTail) return Exp(Constant(-0.5) * squared);
  return Exp(Constant(-0.5 / of.keypoint_tail - 1) *
             Log(Constant(1) + Constant(of.keypoint_tail) * squared));
}
// Returns the density of the logarithm of a distance that says nothing of the keypoint: that of any
// point in the scene, and nowhere zero.
inline Real DensityOfAny(const Real& log_distance, const JointParameters& of) {
  const Real off = log_distance - Constant(of.log_distance_mean);
  const double variance = 2 * of.log_distance_variance;
  return Exp(off * off * Constant(-0.5 / variance)) *
             Constant(1 / __builtin_sqrt(kTwoPi * variance)) +
         Constant(kLeastDistanceDensity);
}

// The leave-one-out prediction of a pixel's error e. With the uncertainty S by all evidence
// (`evidence`), the pixel's own information W in that (`information`) and its variance V, the error
// is M e and its covariance M S + V, where M = (1 - S W)^-1.
struct PixelPrediction {
  Real x, y;
  Symmetric2 covariance;

  PixelPrediction() = default;
  PixelPrediction(const Real& error_x, const Real& error_y, const Real& variance,
                  const Real& information, const Symmetric2& evidence) {
    const Real one = Constant(1);
    const Symmetric2 rest = {one - information * evidence.xx, -(information * evidence.xy),
                             one - information * evidence.yy};
    const Real inverse = one / rest.Determinant();
    x = (rest.yy * error_x - rest.xy * error_y) * inverse;
    y = (rest.xx * error_y - rest.xy * error_x) * inverse;
    covariance = {(rest.yy * evidence.xx - rest.xy * evidence.xy) * inverse + variance,
                  (rest.yy * evidence.xy - rest.xy * evidence.yy) * inverse,
                  (rest.xx * evidence.yy - rest.xy * evidence.xy) * inverse + variance};
  }
  // Returns e' C^-1 e.
  Real Squared() const {
    return (x * x * covariance.yy - Constant(2) * x * y * covariance.xy + y * y * covariance.xx) /
           covariance.Determinant();
  }
};

// The leave-one-out prediction of a pixel with its depth.
struct DepthPrediction {
  PixelPrediction pixel;
  Real error, variance;  // of the depth, given the pixel

  DepthPrediction(const ObservationLanes& term, const Symmetric3& evidence) {
    // The columns of M^-1 = 1 - S W.
    const Real one = Constant(1), minus_pixel = -term.pixel_weight,
               minus_depth = -term.depth_weight;
    const Real3 column0 = Real3{evidence.xx, evidence.xy, evidence.xz} * minus_pixel +
                          Real3{one, one - one, one - one};
    const Real3 column1 = Real3{evidence.xy, evidence.yy, evidence.yz} * minus_pixel +
                          Real3{one - one, one, one - one};
    const Real3 column2 = Real3{evidence.xz, evidence.yz, evidence.zz} * minus_depth +
                          Real3{one - one, one - one, one};
    // The columns' cross products are the rows of M times the determinant.
    const Real3 row0 = Cross(column1, column2), row1 = Cross(column2, column0),
                row2 = Cross(column0, column1);
    const Real inverse = one / Dot(column0, row0);
    const Real3 residual = {term.x, term.y, term.depth_error};
    pixel.x = Dot(row0, residual) * inverse;
    pixel.y = Dot(row1, residual) * inverse;
    pixel.covariance = {Dot(row0, evidence.Row0()) * inverse + term.pixel_variance,
                        Dot(row0, evidence.Row1()) * inverse,
                        Dot(row1, evidence.Row1()) * inverse + term.pixel_variance};
    const Real with_x = Dot(row0, evidence.Row2()) * inverse,
               with_y = Dot(row1, evidence.Row2()) * inverse;
    const Real determinant = one / pixel.covariance.Determinant();
    const Real gain_x = (pixel.covariance.yy * with_x - pixel.covariance.xy * with_y) * determinant;
    const Real gain_y = (pixel.covariance.xx * with_y - pixel.covariance.xy * with_x) * determinant;
    error = Dot(row2, residual) * inverse - gain_x * pixel.x - gain_y * pixel.y;
    variance = Max(Dot(row2, evidence.Row2()) * inverse + term.depth_variance - gain_x * with_x -
                       gain_y * with_y,
                   term.depth_variance);
  }
};

struct SumLanes {
  Real squares = Constant(0), count = Constant(0);

  void Add(const Real& square, const Real& unexplained) {
    squares = squares + square;
    count = count + unexplained;
  }
  JointSum Sum() const { return {squares.Sum(), count.Sum()}; }
};

class JointExpectationKernel {
 public:
  JointExpectationKernel(const JointBlocks& blocks, const JointParameters& parameters,
                         const JointExpectation& expectation)
      : blocks_(blocks),
        of_(parameters),
        expectation_(expectation),
        wide_(parameters),
        share_(Constant(expectation.share)),
        far_(Constant(expectation.far)) {}

  void Update(JointKeypoints& keypoints);
  JointSums Sums() const {
    return {pixels_.Sum(),      depths_.Sum(),      commons_.Sum(),
            unanchored_.Sum(),  right_.Sum(),       unanchored_right_.Sum(),
            depth_right_.Sum(), depth_count_.Sum(), log_likelihood_.Sum()};
  }

 private:
  // The posterior of a keypoint's point by its evidence, for all of its observations.
  struct Posterior {
    Mask is_known;          // in front of the query, and its covariance is finite
    Symmetric4 covariance;  // of the point and its common error, the query's pose given
    Symmetric4 full;        // of the same, the pose being uncertain
    Real query_far;         // 1: its pixel is far off, and nothing tells whose is wrong
    // Weight in the noise's sums; a keypoint whose point has not settled yet says nothing of the
    // noise.
    Real trust;
  };

  // Sets the covariance that knows of the pose's; returns that of the point as the query sees it.
  Symmetric3 SpreadPose(const PointLanes& known, bool has_depths, Posterior& posterior) const;
  void UpdateQuery(JointKeypoints& keypoints, const PointLanes& known, const Real& num_right,
                   const Symmetric3& seen, const Posterior& posterior);
  void UpdateObservation(JointObservations& slot, const ObservationLanes& term, bool has_depths,
                         const Posterior& posterior);
  void UpdateUnanchored(JointUnanchored& slot, const JointKeypoints& keypoints,
                        const PointLanes& known, const Posterior& posterior);

  Real Approached(const Real& weight, const Real& next) const {
    return weight + share_ * (next - weight);
  }
  Mask IsFar(const Real& squared, const Real& variance) const { return far_ * variance < squared; }
  // Returns the precision of the normal distribution that an error seems to come from, over the
  // mean one.
  Real Precision(const Real& squared) const {
    return Constant(1 + 2 * of_.keypoint_tail) /
           (Constant(1) + Constant(of_.keypoint_tail) * squared);
  }
  // Returns the density of an error; 0 where it is not finite, or rounding leaves no covariance, as
  // where the match alone bounds what it would be predicted by.
  Real Density(const PixelPrediction& predicted) const {
    const Real determinant = predicted.covariance.Determinant();
    const Real density =
        StudentDensity(predicted.Squared(), of_) / (Constant(kTwoPi) * SquareRoot(determinant));
    const Mask is_positive = (Constant(0) < determinant) & (Constant(0) < predicted.covariance.xx);
    return Where(is_positive & IsFinite(density), density);
  }

  const JointBlocks& blocks_;
  const JointParameters& of_;
  const JointExpectation& expectation_;
  const WideParameters wide_;
  const Real share_, far_;
  SumLanes pixels_, depths_, commons_, unanchored_;
  Real right_ = Constant(0), unanchored_right_ = Constant(0), depth_right_ = Constant(0),
       depth_count_ = Constant(0), log_likelihood_ = Constant(0);
};

void JointExpectationKernel::Update(JointKeypoints& keypoints) {
  const Real zero = Constant(0), one = Constant(1);
  const bool has_depths = keypoints.has_depths;
  PointLanes known(keypoints, blocks_, wide_);
  Real num_right = zero, depth_total = zero;
  Mask far = IsFar(known.query.Squared(), Constant(of_.keypoint_px2));
  const Mask query_far = far;
  for (int i = keypoints.first_observation; i < keypoints.end_observation; ++i) {
    JointObservations& slot = blocks_.observations[i];
    const ObservationLanes term(slot, has_depths, known.point, known.common, wide_);
    const Real weight = Load(slot.weight);
    known.total = known.total + weight;
    num_right = num_right + Where(Constant(0.5) < weight, one);
    depth_total = depth_total + Where(zero < term.depth_weight, weight * Load(slot.depth));
    term.AddTo(has_depths, known.cost);
    far = far | ((zero < term.pixel_weight) & IsFar(term.Squared(), term.pixel_variance));
  }
  for (int i = keypoints.first_unanchored; i < keypoints.end_unanchored; ++i) {
    num_right = num_right + Where(Constant(0.5) < Load(blocks_.unanchored[i].weight), one);
  }
  Posterior posterior;
  posterior.covariance = posterior.full = known.Covariance(has_depths);
  posterior.is_known = known.query.in_front &
                       IsFinite(posterior.covariance.point.Trace() + posterior.covariance.common);
  Symmetric3 seen = posterior.covariance.point;
  if (!expectation_.is_pose_certain) seen = SpreadPose(known, has_depths, posterior);
  posterior.query_far = Where(query_far & (num_right <= one), one);
  posterior.trust = Where(posterior.is_known,
                          Select(far, zero, Min(one, known.total)) * Load(keypoints.query_right));
  UpdateQuery(keypoints, known, num_right, seen, posterior);
  const Real common_weight = Where(zero < depth_total, posterior.trust);
  commons_.Add(common_weight * known.common * known.common,
               common_weight * Where(posterior.is_known, one - posterior.covariance.common *
                                                                   Constant(1 / of_.common_depth)));
  for (int i = keypoints.first_observation; i < keypoints.end_observation; ++i) {
    JointObservations& slot = blocks_.observations[i];
    const ObservationLanes term(slot, has_depths, known.point, known.common, wide_);
    UpdateObservation(slot, term, has_depths, posterior);
  }
  for (int i = keypoints.first_unanchored; i < keypoints.end_unanchored; ++i) {
    UpdateUnanchored(blocks_.unanchored[i], keypoints, known, posterior);
  }
}

// Returns D Q D', the covariance of a point's displacement and of the last unknown by that of the
// query's unknowns, with D = (-[point]x, 1, 0; 0, 0, 1).
inline Symmetric4 SpreadLanes(const double* q, const Real3& point) {
  Real3 half[7];  // rows of D Q, transposed
  Real last[7];
  for (int column = 0; column < 7; ++column) {
    const Real3 rotation = {Constant(q[column]), Constant(q[7 + column]), Constant(q[14 + column])};
    half[column] =
        Cross(rotation, point) +
        Real3{Constant(q[21 + column]), Constant(q[28 + column]), Constant(q[35 + column])};
    last[column] = Constant(q[42 + column]);
  }
  const Real3 row0 =
      Cross({half[0].x, half[1].x, half[2].x}, point) + Real3{half[3].x, half[4].x, half[5].x};
  const Real3 row1 =
      Cross({half[0].y, half[1].y, half[2].y}, point) + Real3{half[3].y, half[4].y, half[5].y};
  const Real3 row2 =
      Cross({half[0].z, half[1].z, half[2].z}, point) + Real3{half[3].z, half[4].z, half[5].z};
  return {{row0.x, row0.y, row0.z, row1.y, row1.z, row2.z}, half[6], last[6]};
}

struct FourLanes {
  Real3 point;
  Real last;
};
inline FourLanes operator*(const Symmetric4& m, const FourLanes& v) {
  return {m.point * v.point + m.mixed * v.last, Dot(m.mixed, v.point) + m.common * v.last};
}
inline Real Dot(const FourLanes& a, const FourLanes& b) {
  return Dot(a.point, b.point) + a.last * b.last;
}
// Returns A m A' with the rows of A.
inline Symmetric3 Spread(const Symmetric4& m, const FourLanes (&rows)[3]) {
  const FourLanes half0 = m * rows[0], half1 = m * rows[1], half2 = m * rows[2];
  return {Dot(half0, rows[0]), Dot(half0, rows[1]), Dot(half0, rows[2]),
          Dot(half1, rows[1]), Dot(half1, rows[2]), Dot(half2, rows[2])};
}
inline Symmetric3 operator+(const Symmetric3& a, const Symmetric3& b) {
  return {a.xx + b.xx, a.xy + b.xy, a.xz + b.xz, a.yy + b.yy, a.yz + b.yz, a.zz + b.zz};
}

Symmetric3 JointExpectationKernel::SpreadPose(const PointLanes& known, bool has_depths,
                                              Posterior& posterior) const {
  const Symmetric4 frame = SpreadLanes(expectation_.query_covariance, known.point);
  const Symmetric4& query = known.query.cost.hessian;
  const Symmetric4& own = posterior.covariance;
  // The rows of -H_pp^-1 (h, m): how the point follows the query's displacement and mean distance.
  const auto follows = [&](const Real3& row) {
    return FourLanes{query.point * row * Constant(-1), -Dot(query.mixed, row)};
  };
  FourLanes rows[3] = {follows(own.point.Row0()), follows(own.point.Row1()),
                       follows(own.point.Row2())};
  posterior.full.point = own.point + Spread(frame, rows);
  if (has_depths) {
    const FourLanes common = follows(own.mixed);
    const FourLanes half = frame * common;
    posterior.full.mixed =
        own.mixed + Real3{Dot(half, rows[0]), Dot(half, rows[1]), Dot(half, rows[2])};
    posterior.full.common = own.common + Dot(half, common);
  }
  rows[0].point.x = rows[0].point.x + Constant(1);
  rows[1].point.y = rows[1].point.y + Constant(1);
  rows[2].point.z = rows[2].point.z + Constant(1);
  return own.point + Spread(frame, rows);
}

void JointExpectationKernel::UpdateQuery(JointKeypoints& keypoints, const PointLanes& known,
                                         const Real& num_right, const Symmetric3& seen,
                                         const Posterior& posterior) {
  const QueryLanes& query = known.query;
  const Real variance = Constant(of_.keypoint_px2);
  const Mask counts = posterior.is_known & (Constant(0.1) < known.total);
  const Real evidence = query.jacobian.Covariance(posterior.covariance.point).Trace();
  const Real query_right = Load(keypoints.query_right);
  Real precision = Load(keypoints.query_precision);
  precision = Select(
      counts, Approached(precision, Precision((query.Squared() + evidence) / variance)), precision);
  precision.Store(keypoints.query_precision);
  // The noise's sums take the weights that gave the point and the precision that its residual shows
  // (the EM algorithm's order).
  const Real trust = Where(counts, posterior.trust);
  pixels_.Add(Where(counts, trust * query_right * precision * query.Squared()),
              Where(counts, trust * (Constant(2) * query_right - query.weight * evidence)));

  // A single match does not tell whose pixel is wrong: that is its own weight.
  const PixelPrediction predicted(query.x, query.y, variance, query.weight,
                                  query.jacobian.Covariance(seen));
  const Real chance = Constant(expectation_.query_wrong / of_.matched_area_px2);
  const Real density = Constant(1 - expectation_.query_wrong) * Density(predicted);
  const Real right = Select(Constant(2) <= num_right, density / (density + chance), Constant(1));
  Select(counts, Approached(query_right, right), query_right).Store(keypoints.query_right);
}

void JointExpectationKernel::UpdateObservation(JointObservations& slot,
                                               const ObservationLanes& term, bool has_depths,
                                               const Posterior& posterior) {
  const Real zero = Constant(0), one = Constant(1);
  const Mask is_there = zero < Load(slot.is_there);
  const Mask seen = is_there & posterior.is_known & term.in_front;
  const Real old_weight = Load(slot.weight), old_depth = Load(slot.depth);
  const Symmetric2 pixel_covariance = term.jacobian.Covariance(posterior.covariance.point);
  const Real old_precision = Load(slot.precision);
  const Real precision = Approached(
      old_precision, Precision((term.Squared() + pixel_covariance.Trace()) / term.pixel_variance));
  Select(seen, precision, old_precision).Store(slot.precision);
  // The noise's sums are as with the query's pixel.
  pixels_.Add(Where(seen, posterior.trust * old_weight * precision * term.Squared() *
                              Constant(of_.keypoint_px2) / term.pixel_variance),
              Where(seen, posterior.trust * (Constant(2) * old_weight -
                                             term.pixel_weight * pixel_covariance.Trace())));
  PixelPrediction predicted;
  Real with_depth = zero, without_depth = zero;
  if (has_depths) {
    const Symmetric4& own = posterior.covariance;
    const Real3& by_point = term.log_gradient;
    const Mask has_weight = seen & (zero < term.depth_weight);
    const Real w = old_weight * old_depth;
    const Real of_depth =
        Dot(own.point * by_point, by_point) - Constant(2) * Dot(own.mixed, by_point) + own.common;
    depths_.Add(Where(has_weight, posterior.trust * w * term.depth_error * term.depth_error *
                                      Constant(of_.depth) / term.depth_variance),
                Where(has_weight, posterior.trust * (w - term.depth_weight * of_depth)));

    const Symmetric4& full = posterior.full;
    const Symmetric2 pixel = term.jacobian.Covariance(full.point);
    const Real3 half = full.point * by_point - full.mixed;
    const DepthPrediction depth(
        term, {pixel.xx, pixel.xy, Dot(half, term.jacobian.x), pixel.yy, Dot(half, term.jacobian.y),
               Dot(half, by_point) - Dot(full.mixed, by_point) + full.common});
    predicted = depth.pixel;
    const Real right = Constant(of_.right) * Density(predicted);
    const Mask has_depth = zero < Load(slot.has_depth);
    with_depth = right * Constant(of_.depth_right) *
                 Exp(Constant(-0.5) * depth.error * depth.error / depth.variance) /
                 (SquareRoot(Constant(kTwoPi) * depth.variance) *
                  DensityOfAny(Load(slot.log_distance), of_));
    with_depth = Where(has_depth, with_depth);
    without_depth = right * Select(has_depth, Constant(1 - of_.depth_right), one);
  } else {
    predicted = PixelPrediction(term.x, term.y, term.pixel_variance, term.pixel_weight,
                                term.jacobian.Covariance(posterior.full.point));
    without_depth = Constant(of_.right) * Density(predicted);
  }
  const Mask likely = seen & (posterior.query_far < one) & IsFinite(with_depth + without_depth) &
                      (term.Squared() <= far_ * term.pixel_variance);
  with_depth = Where(likely, with_depth);
  without_depth = Where(likely, without_depth);
  const Real wrong = Constant((1 - of_.right) / of_.matched_area_px2) * Load(slot.epipolar_clutter);
  const Real sum = with_depth + without_depth;
  const Real right = sum / (sum + wrong);
  const Real weight = Where(seen, Approached(old_weight, right));
  const Real depth = Where(seen, Approached(old_depth, Where(zero < with_depth, with_depth / sum)));
  weight.Store(slot.weight);
  depth.Store(slot.depth);
  right_ = right_ + weight;
  const Real with = Where(zero < Load(slot.has_depth), weight);
  depth_right_ = depth_right_ + with * depth;
  depth_count_ = depth_count_ + with;
  log_likelihood_ = log_likelihood_ +
                    Where(is_there, Log(Select(seen, (sum + wrong) * Constant(of_.matched_area_px2),
                                               Constant(1 - of_.right))));
  const Mask tells = likely & (Constant(0.5) < right) & (Constant(0.5) < posterior.trust);
  Where(tells, one).Store(slot.tells_noise);
  predicted.x.Store(slot.predicted_px[0]);
  predicted.y.Store(slot.predicted_px[1]);
  predicted.covariance.xx.Store(slot.predicted_covariance[0]);
  predicted.covariance.xy.Store(slot.predicted_covariance[1]);
  predicted.covariance.yy.Store(slot.predicted_covariance[2]);
}

void JointExpectationKernel::UpdateUnanchored(JointUnanchored& slot,
                                              const JointKeypoints& keypoints,
                                              const PointLanes& known, const Posterior& posterior) {
  const Mask is_there = Constant(0) < Load(slot.is_there);
  const Real old_weight = Load(slot.weight);
  const Real variance = Constant(of_.unanchored) + Load(slot.variance);
  const Real used = Where(wide_.least_weight <= old_weight, old_weight / variance);
  const Real3 point = Load3(slot.point);
  const Real3 error = wide_.Displaced(known.point) - point;
  const Symmetric3& evidence = posterior.covariance.point;
  const Mask counts = posterior.is_known & is_there;
  unanchored_.Add(
      Where(counts,
            posterior.trust * old_weight * Constant(of_.unanchored) / variance * Dot(error, error)),
      Where(counts, posterior.trust * (Constant(3) * old_weight - used * evidence.Trace())));

  const PixelLanes seen(keypoints.image_from_cam, wide_.PointInCamera(keypoints, point));
  const Mask in_front = counts & seen.in_front;
  // The leave-one-out prediction has the error M e and the covariance M S + V, M = (1 - S u)^-1.
  Symmetric3 rest = evidence.Times(-used);
  rest.AddToDiagonal(Constant(1));
  const Symmetric3 without = rest.Inverse();
  Symmetric3 covariance = {
      Dot(without.Row0(), evidence.Row0()), Dot(without.Row0(), evidence.Row1()),
      Dot(without.Row0(), evidence.Row2()), Dot(without.Row1(), evidence.Row1()),
      Dot(without.Row1(), evidence.Row2()), Dot(without.Row2(), evidence.Row2())};
  covariance.AddToDiagonal(variance);
  const Real3 predicted = without * error;
  const Symmetric3 cofactors = covariance.Cofactors();
  const Real determinant = covariance.Determinant(cofactors);
  const Real density = Exp(Constant(-0.5) * Dot(cofactors * predicted, predicted) / determinant) /
                       SquareRoot(Constant(kTwoPi * kTwoPi * kTwoPi) * determinant);
  const Mask is_positive =
      (Constant(0) < determinant) & (Constant(0) < covariance.xx) & (Constant(0) < cofactors.zz);
  const Real right =
      Where(is_positive & IsFinite(density), Constant(of_.unanchored_right) * density);
  // A wrong one is anywhere in the image, at any distance of the scene.
  const Real3 offset = point - wide_.Center(keypoints);
  const Real squared = Dot(offset, offset);
  const Real px2 =
      Constant(0.5) * (Dot(seen.by_ray.x, seen.by_ray.x) + Dot(seen.by_ray.y, seen.by_ray.y));
  const Real any = DensityOfAny(Constant(0.5) * Log(squared), of_) / SquareRoot(squared) * px2 *
                   Constant(1 / of_.matched_area_px2);
  const Real wrong = Constant(1 - of_.unanchored_right) * any;
  const Real weight = Where(in_front, Approached(old_weight, right / (right + wrong)));
  weight.Store(slot.weight);
  unanchored_right_ = unanchored_right_ + weight;
  const Real ratio = Min(Max((right + wrong) / any, Constant(1e-99)), Constant(1e99));
  log_likelihood_ =
      log_likelihood_ +
      Where(is_there, Log(Select(in_front, ratio, Constant(1 - of_.unanchored_right))));
}

[[gnu::flatten]] JointSums ExpectJointly(const JointBlocks& blocks,
                                         const JointParameters& parameters,
                                         const JointExpectation& expectation) {
  JointExpectationKernel kernel(blocks, parameters, expectation);
  for (int k = 0; k < blocks.count; ++k) kernel.Update(blocks.keypoints[k]);
  return kernel.Sums();
}

}  // namespace
}  // namespace raylift::kernels
