// The kernels of the joint refinement; see joint.h for what they take and lanes.h for how they
// compute.

#pragma once

#include "estimation/kernels/joint.h"
#include "estimation/kernels/lanes.h"

namespace raylift::kernels {
namespace {

using Real = Lanes<double>;
using Real3 = Vec3<double>;

inline Real Constant(double value) { return Real::Fill(value); }
inline Real Load(const Row& row) { return Real::Load(row); }
inline Real3 Load3(const Row* rows) { return LoadVec3<double>(rows); }
inline void Store3(const Real3& v, Row* rows) {
  v.x.Store(rows[0]);
  v.y.Store(rows[1]);
  v.z.Store(rows[2]);
}
inline Real operator-(const Real& a) { return Constant(0) - a; }
// Returns x where a mask holds, and zero elsewhere, whatever is there.
inline Real Where(const Mask& mask, const Real& x) { return Select(mask, x, Constant(0)); }
inline Mask IsFinite(const Real& x) { return (x - x) <= Constant(0); }

// A symmetric matrix, the upper triangle row by row.
struct Symmetric2 {
  Real xx, xy, yy;

  Real Trace() const { return xx + yy; }
  Real Determinant() const { return xx * yy - xy * xy; }
};
struct Symmetric3 {
  Real xx, xy, xz, yy, yz, zz;

  static Symmetric3 Zero() {
    const Real zero = Constant(0);
    return {zero, zero, zero, zero, zero, zero};
  }
  Real3 Row0() const { return {xx, xy, xz}; }
  Real3 Row1() const { return {xy, yy, yz}; }
  Real3 Row2() const { return {xz, yz, zz}; }
  Real3 operator*(const Real3& v) const { return {Dot(Row0(), v), Dot(Row1(), v), Dot(Row2(), v)}; }
  Real Trace() const { return xx + yy + zz; }
  void Add(const Real3& v, const Real3& weighted) {
    xx = xx + v.x * weighted.x;
    xy = xy + v.x * weighted.y;
    xz = xz + v.x * weighted.z;
    yy = yy + v.y * weighted.y;
    yz = yz + v.y * weighted.z;
    zz = zz + v.z * weighted.z;
  }
  void AddToDiagonal(const Real& value) {
    xx = xx + value;
    yy = yy + value;
    zz = zz + value;
  }
  Symmetric3 Times(const Real& s) const { return {xx * s, xy * s, xz * s, yy * s, yz * s, zz * s}; }
  Symmetric3 Cofactors() const {
    return {yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy,
            xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy};
  }
  // Expands the determinant along the first row.
  Real Determinant(const Symmetric3& cofactors) const { return Dot(Row0(), cofactors.Row0()); }
  Symmetric3 Inverse() const {
    const Symmetric3 cofactors = Cofactors();
    return cofactors.Times(Constant(1) / Determinant(cofactors));
  }
};
// A symmetric matrix of a point and the error that its depths have in common.
struct Symmetric4 {
  Symmetric3 point;
  Real3 mixed;
  Real common;
};

inline void Store10(const Symmetric4& m, Row* rows) {
  const Real entries[] = {m.point.xx, m.point.xy, m.point.xz, m.mixed.x, m.point.yy,
                          m.point.yz, m.mixed.y,  m.point.zz, m.mixed.z, m.common};
  for (int i = 0; i < 10; ++i) entries[i].Store(rows[i]);
}
inline Symmetric4 Load10(const Row* rows) {
  return {
      {Load(rows[0]), Load(rows[1]), Load(rows[2]), Load(rows[4]), Load(rows[5]), Load(rows[7])},
      {Load(rows[3]), Load(rows[6]), Load(rows[8])},
      Load(rows[9])};
}

// The Jacobian of a pixel by a point: its rows.
struct PixelJacobian {
  Real3 x, y;

  Symmetric2 Covariance(const Symmetric3& of_point) const {
    const Real3 half = of_point * x;
    return {Dot(half, x), Dot(half, y), Dot(of_point * y, y)};
  }
};

// The residual of a ray in an image, as ResidualOf() returns it.
struct PixelLanes {
  Mask in_front;
  Real x, y;  // the residual, pixels
  PixelJacobian by_ray;

  PixelLanes(const Row* image_from_ray, const Real3& ray) {
    const Real3 row0 = Load3(image_from_ray), row1 = Load3(image_from_ray + 3),
                row2 = Load3(image_from_ray + 6);
    const Real depth = Dot(row2, ray);
    const Real inverse = Constant(1) / depth;
    in_front = Constant(0) < depth;
    x = Dot(row0, ray) * inverse;
    y = Dot(row1, ray) * inverse;
    by_ray = {(row0 - row2 * x) * inverse, (row1 - row2 * y) * inverse};
  }
  Real Squared() const { return x * x + y * y; }
};

// A quadratic in a point's displacement and one more unknown, which is subtracted from a distance's
// logarithm.
struct QuadraticLanes {
  Symmetric4 hessian{Symmetric3::Zero(), {Constant(0), Constant(0), Constant(0)}, Constant(0)};
  Real3 gradient{Constant(0), Constant(0), Constant(0)};
  Real last_gradient = Constant(0);

  // Adds weight |error + jacobian displacement|^2 / 2.
  void AddPixel(const PixelJacobian& jacobian, const Real& x, const Real& y, const Real& weight) {
    const Real3 weighted_x = jacobian.x * weight, weighted_y = jacobian.y * weight;
    hessian.point.Add(jacobian.x, weighted_x);
    hessian.point.Add(jacobian.y, weighted_y);
    gradient = gradient + weighted_x * x + weighted_y * y;
  }
  // Adds weight (error + log_gradient' displacement - last)^2 / 2.
  void AddLogDistance(const Real3& log_gradient, const Real& error, const Real& weight) {
    const Real3 weighted = log_gradient * weight;
    hessian.point.Add(log_gradient, weighted);
    hessian.mixed = hessian.mixed - weighted;
    hessian.common = hessian.common + weight;
    gradient = gradient + weighted * error;
    last_gradient = last_gradient - weight * error;
  }
};

// The parameters in all lanes.
struct WideParameters {
  const JointParameters& of;
  Real3 row[3], translation;
  Real least_weight;

  explicit WideParameters(const JointParameters& parameters)
      : of(parameters),
        row{Fill3(parameters.rotation), Fill3(parameters.rotation + 3),
            Fill3(parameters.rotation + 6)},
        translation(Fill3(parameters.translation)),
        least_weight(Constant(parameters.least_weight)) {}
  Real3 Rotate(const Real3& v) const { return {Dot(row[0], v), Dot(row[1], v), Dot(row[2], v)}; }
  Real3 RotateBack(const Real3& v) const { return row[0] * v.x + row[1] * v.y + row[2] * v.z; }
  // Returns the center of the camera that a keypoint is seen by.
  Real3 Center(const JointKeypoints& keypoints) const {
    return RotateBack(Load3(keypoints.camera_center) - translation);
  }
  Real3 PointInCamera(const JointKeypoints& keypoints, const Real3& point) const {
    return Rotate(point) + translation - Load3(keypoints.camera_center);
  }
  // Returns the information of an unanchored point in each coordinate.
  Real Information(const JointUnanchored& slot) const {
    const Real weight = Load(slot.weight);
    return Where(least_weight <= weight, weight / (Constant(of.unanchored) + Load(slot.variance)));
  }
  // Returns a point as the unanchored points have it, displaced by their common error.
  Real3 Displaced(const Real3& point) const {
    if (!of.have_references_errors) return point;
    return point + Cross(Fill3(of.unanchored_error), point) + Fill3(of.unanchored_error + 3);
  }
};

// The query's pixel, and the prior of the point's distance, linearized.
struct QueryLanes {
  Mask in_front;
  Real x, y;               // the pixel's residual
  PixelJacobian jacobian;  // by the point
  Real weight;             // over the pixel's variance
  QuadraticLanes cost;     // in the displacement and the prior's mean

  QueryLanes(const JointKeypoints& keypoints, const Real3& point,
             const WideParameters& parameters) {
    const JointParameters& of = parameters.of;
    const PixelLanes seen(keypoints.image_from_cam, parameters.PointInCamera(keypoints, point));
    const Real focal_error = Constant(of.focal_error);
    in_front = seen.in_front;
    x = seen.x + focal_error * Load(keypoints.px_by_log_focal[0]);
    y = seen.y + focal_error * Load(keypoints.px_by_log_focal[1]);
    jacobian = {parameters.RotateBack(seen.by_ray.x), parameters.RotateBack(seen.by_ray.y)};
    weight = Load(keypoints.query_right) * Load(keypoints.query_precision) *
             Constant(1 / of.keypoint_px2);
    cost.AddPixel(jacobian, x, y, weight);
    const Real3 offset = point - parameters.Center(keypoints);
    const Real squared = Dot(offset, offset);
    cost.AddLogDistance(offset * (Constant(1) / squared),
                        Constant(0.5) * Log(squared) - Constant(of.log_distance_mean),
                        Constant(1 / of.log_distance_variance));
  }
  Real Squared() const { return x * x + y * y; }
};

// An observation, linearized; Keep() writes what is left of it to its slot.
struct ObservationLanes {
  Mask in_front;
  Real x, y;
  PixelJacobian jacobian;
  Real pixel_variance, pixel_weight;
  Real3 log_gradient;
  Real depth_error, depth_variance, depth_weight;

  ObservationLanes(JointObservations& slot, bool has_depths, const Real3& point, const Real& common,
                   const WideParameters& parameters) {
    const JointParameters& of = parameters.of;
    Real3 displaced = point;
    if (of.have_references_errors) {
      displaced =
          point + Cross(Load3(slot.reference_error), point) + Load3(slot.reference_error + 3);
    }
    const Real3 offset = displaced - Load3(slot.center);
    const PixelLanes seen(slot.image_from_ray, offset);
    const Real weight = Load(slot.weight);
    in_front = seen.in_front & (Constant(0) < Load(slot.is_there));
    const Mask counts = in_front & (parameters.least_weight <= weight);
    x = seen.x;
    y = seen.y;
    jacobian = seen.by_ray;
    pixel_variance = Constant(of.keypoint_px2) + Load(slot.extra_variance_px2);
    pixel_weight = Where(counts, weight * Load(slot.precision) / pixel_variance);
    depth_error = depth_weight = depth_variance = Constant(0);
    log_gradient = {depth_error, depth_error, depth_error};
    if (has_depths) {
      const Real squared = Dot(offset, offset);
      const Real depth = Load(slot.depth);
      log_gradient = offset * (Constant(1) / squared);
      depth_variance = Constant(of.depth) + Load(slot.depth_variance);
      depth_error = Constant(0.5) * Log(squared) - Load(slot.log_distance) - common;
      if (of.have_references_errors) depth_error = depth_error - Load(slot.reference_error[6]);
      depth_weight =
          Where(counts & (parameters.least_weight <= depth) & (Constant(0) < Load(slot.has_depth)),
                weight * depth / depth_variance);
    }
  }
  Real Squared() const { return x * x + y * y; }
  void AddTo(bool has_depths, QuadraticLanes& cost) const {
    cost.AddPixel(jacobian, Where(in_front, x), Where(in_front, y), pixel_weight);
    if (has_depths) cost.AddLogDistance(log_gradient, depth_error, depth_weight);
  }
  void Keep(JointObservations& slot) const {
    Store3(jacobian.x, slot.jacobian);
    Store3(jacobian.y, slot.jacobian + 3);
    x.Store(slot.error_px[0]);
    y.Store(slot.error_px[1]);
    pixel_weight.Store(slot.pixel_weight);
    Store3(log_gradient, slot.log_gradient);
    depth_error.Store(slot.depth_error);
    depth_weight.Store(slot.depth_weight);
  }
};

// The evidence of the points of a block and of their depths' common errors, to which observations
// are added.
struct PointLanes {
  Real3 point;
  Real common;
  QueryLanes query;
  QuadraticLanes cost;
  Real total;  // weight

  PointLanes(const JointKeypoints& keypoints, const JointBlocks& blocks,
             const WideParameters& parameters)
      : point(Load3(keypoints.point)),
        common(Load(keypoints.common)),
        query(keypoints, point, parameters),
        total(Constant(0)) {
    const JointParameters& of = parameters.of;
    cost.hessian.point = query.cost.hessian.point;
    cost.gradient = query.cost.gradient;
    cost.hessian.common = Constant(1 / of.common_depth);
    cost.last_gradient = common * cost.hessian.common;
    for (int i = keypoints.first_unanchored; i < keypoints.end_unanchored; ++i) {
      const JointUnanchored& slot = blocks.unanchored[i];
      total = total + Load(slot.weight);
      const Real information = parameters.Information(slot);
      cost.hessian.point.AddToDiagonal(information);
      cost.gradient =
          cost.gradient + (parameters.Displaced(point) - Load3(slot.point)) * information;
    }
  }
  // Returns H_pp^-1.
  Symmetric4 Covariance(bool has_depths) const {
    const Symmetric4& h = cost.hessian;
    const Real inverse = Constant(1) / h.common;
    if (!has_depths) {
      const Real zero = Constant(0);
      return {h.point.Inverse(), {zero, zero, zero}, inverse};
    }
    const Real3 gain = h.mixed * inverse;
    Symmetric3 rest = h.point;
    rest.Add(gain, h.mixed * Constant(-1));
    const Symmetric3 of_point = rest.Inverse();
    const Real3 mixed = of_point * gain * Constant(-1);
    return {of_point, mixed, inverse - Dot(gain, mixed)};
  }
};

// The sums of a linearization over lanes.
struct JointNormalLanes {
  Real hessian[28], gradient[7], mixed[7], slope, curvature;

  JointNormalLanes() {
    for (Real& h : hessian) h = Constant(0);
    for (int i = 0; i < 7; ++i) gradient[i] = mixed[i] = Constant(0);
    slope = curvature = Constant(0);
  }
  // Adds D' m D, with D = (-[point]x, 1, 0; 0, 0, 1).
  void AddDisplaced(const Symmetric4& m, const Real3& point) {
    const Real3 turned[3] = {Cross(point, m.point.Row0()), Cross(point, m.point.Row1()),
                             Cross(point, m.point.Row2())};  // columns of [point]x m
    const Real3 last = Cross(point, m.mixed);
    const Real3 across[3] = {Cross(point, {turned[0].x, turned[1].x, turned[2].x}),
                             Cross(point, {turned[0].y, turned[1].y, turned[2].y}),
                             Cross(point, {turned[0].z, turned[1].z, turned[2].z})};
    const Real upper[28] = {
        across[0].x, across[0].y, across[0].z, turned[0].x, turned[1].x, turned[2].x, last.x,
        across[1].y, across[1].z, turned[0].y, turned[1].y, turned[2].y, last.y,      across[2].z,
        turned[0].z, turned[1].z, turned[2].z, last.z,      m.point.xx,  m.point.xy,  m.point.xz,
        m.mixed.x,   m.point.yy,  m.point.yz,  m.mixed.y,   m.point.zz,  m.mixed.z,   m.common};
    for (int i = 0; i < 28; ++i) hessian[i] = hessian[i] + upper[i];
  }
  static void AddDisplaced(const Real3& v, const Real& last, const Real3& point, Real* sums) {
    const Real3 turned = Cross(point, v);
    const Real seven[7] = {turned.x, turned.y, turned.z, v.x, v.y, v.z, last};
    for (int i = 0; i < 7; ++i) sums[i] = sums[i] + seven[i];
  }
  JointNormals Sum() const {
    JointNormals sums;
    for (int i = 0; i < 28; ++i) sums.hessian[i] = hessian[i].Sum();
    for (int i = 0; i < 7; ++i) {
      sums.gradient[i] = gradient[i].Sum();
      sums.mixed[i] = mixed[i].Sum();
    }
    sums.slope = slope.Sum();
    sums.curvature = curvature.Sum();
    return sums;
  }
};

inline void ZeroUnless(const Mask& mask, Real3& v) {
  v = {Where(mask, v.x), Where(mask, v.y), Where(mask, v.z)};
}
inline void ZeroUnless(const Mask& mask, Symmetric3& m) {
  m = {Where(mask, m.xx), Where(mask, m.xy), Where(mask, m.xz),
       Where(mask, m.yy), Where(mask, m.yz), Where(mask, m.zz)};
}
inline void ZeroUnless(const Mask& mask, QuadraticLanes& q) {
  ZeroUnless(mask, q.hessian.point);
  ZeroUnless(mask, q.hessian.mixed);
  q.hessian.common = Where(mask, q.hessian.common);
  ZeroUnless(mask, q.gradient);
  q.last_gradient = Where(mask, q.last_gradient);
}

// Adds the focal length's part of a block, whose points are eliminated.
void AddFocal(JointKeypoints& keypoints, const QueryLanes& query, const Mask& used,
              const Symmetric4& covariance, const QuadraticLanes& cost, const Real3& point,
              JointNormalLanes& sums) {
  const Real by_x = Load(keypoints.px_by_log_focal[0]), by_y = Load(keypoints.px_by_log_focal[1]);
  const Real weight = Where(used, query.weight);
  Real3 by_point = (query.jacobian.x * by_x + query.jacobian.y * by_y) * weight;
  ZeroUnless(used, by_point);
  Store3(by_point, keypoints.by_focal);
  const Real3 solved = covariance.point * by_point;
  const Real solved_common = Dot(covariance.mixed, by_point);
  sums.slope = sums.slope + weight * Where(used, by_x * query.x + by_y * query.y) -
               Dot(solved, cost.gradient) - solved_common * cost.last_gradient;
  sums.curvature = sums.curvature + weight * (by_x * by_x + by_y * by_y) - Dot(solved, by_point);
  const Symmetric4& h = query.cost.hessian;
  JointNormalLanes::AddDisplaced(by_point - h.point * solved, -Dot(h.mixed, solved), point,
                                 sums.mixed);
}

[[gnu::flatten]] JointNormals LinearizeJointly(const JointBlocks& blocks,
                                               const JointParameters& parameters) {
  const WideParameters wide(parameters);
  JointNormalLanes sums;
  for (int k = 0; k < blocks.count; ++k) {
    JointKeypoints& keypoints = blocks.keypoints[k];
    const bool has_depths = keypoints.has_depths;
    PointLanes known(keypoints, blocks, wide);
    for (int i = keypoints.first_observation; i < keypoints.end_observation; ++i) {
      JointObservations& slot = blocks.observations[i];
      const ObservationLanes term(slot, has_depths, known.point, known.common, wide);
      known.total = known.total + Load(slot.weight);
      term.AddTo(has_depths, known.cost);
      term.Keep(slot);
    }
    Symmetric4 covariance = known.Covariance(has_depths);
    const Mask used = known.query.in_front & (wide.least_weight <= known.total) &
                      IsFinite(covariance.point.Trace() + covariance.common);
    ZeroUnless(used, covariance.point);
    ZeroUnless(used, covariance.mixed);
    covariance.common = Where(used, covariance.common);
    ZeroUnless(used, known.cost);
    ZeroUnless(used, known.query.cost);
    Store10(covariance, keypoints.covariance);
    Store3(known.cost.gradient, keypoints.gradient);
    known.cost.last_gradient.Store(keypoints.gradient[3]);
    const QuadraticLanes& query = known.query.cost;
    Store10(query.hessian, keypoints.query_hessian);

    const Real3 solved =
        covariance.point * known.cost.gradient + covariance.mixed * known.cost.last_gradient;
    Real pose_gradient[7];
    for (Real& g : pose_gradient) g = Constant(0);
    JointNormalLanes::AddDisplaced(query.gradient - query.hessian.point * solved,
                                   query.last_gradient - Dot(query.hessian.mixed, solved),
                                   known.point, pose_gradient);
    for (int i = 0; i < 7; ++i) {
      pose_gradient[i].Store(keypoints.pose_gradient[i]);
      sums.gradient[i] = sums.gradient[i] + pose_gradient[i];
    }
    // H_q - K H_pp^-1 K' with K = (h, m)' of the point.
    const Symmetric3& h = query.hessian.point;
    const Real3 half0 = covariance.point * h.Row0(), half1 = covariance.point * h.Row1(),
                half2 = covariance.point * h.Row2(), half3 = covariance.point * query.hessian.mixed;
    const Symmetric4 reduced = {
        {h.xx - Dot(half0, h.Row0()), h.xy - Dot(half0, h.Row1()), h.xz - Dot(half0, h.Row2()),
         h.yy - Dot(half1, h.Row1()), h.yz - Dot(half1, h.Row2()), h.zz - Dot(half2, h.Row2())},
        query.hessian.mixed -
            Real3{Dot(half3, h.Row0()), Dot(half3, h.Row1()), Dot(half3, h.Row2())},
        query.hessian.common - Dot(half3, query.hessian.mixed)};
    sums.AddDisplaced(reduced, known.point);
    if (parameters.is_focal_unknown) {
      AddFocal(keypoints, known.query, used, covariance, known.cost, known.point, sums);
    }
  }
  return sums.Sum();
}

// Adds to a keypoint's gradient, of its point and of its common error, the part of the references'
// steps.
inline void AddReferenceSteps(const JointBlocks& blocks, const JointKeypoints& keypoints,
                              const WideParameters& parameters, Real3& pull, Real& common_pull) {
  const Real3 point = Load3(keypoints.point);
  for (int i = keypoints.first_observation; i < keypoints.end_observation; ++i) {
    const JointObservations& slot = blocks.observations[i];
    const Real3 displacement =
        Cross(Load3(slot.reference_step), point) + Load3(slot.reference_step + 3);
    const Real3 by_x = Load3(slot.jacobian), by_y = Load3(slot.jacobian + 3);
    const Real weight = Load(slot.pixel_weight);
    pull = pull + by_x * (weight * Dot(by_x, displacement)) +
           by_y * (weight * Dot(by_y, displacement));
    if (!keypoints.has_depths) continue;
    const Real3 by_depth = Load3(slot.log_gradient);
    const Real of_depth =
        Load(slot.depth_weight) * (Dot(by_depth, displacement) - Load(slot.reference_step[6]));
    pull = pull + by_depth * of_depth;
    common_pull = common_pull - of_depth;
  }
  const Real3 displacement =
      Cross(Fill3(parameters.of.unanchored_step), point) + Fill3(parameters.of.unanchored_step + 3);
  for (int i = keypoints.first_unanchored; i < keypoints.end_unanchored; ++i) {
    pull = pull + displacement * parameters.Information(blocks.unanchored[i]);
  }
}

// Moves the points after a step of the query, which `parameters` have taken already, and of
// references.
[[gnu::flatten]] void MoveJointly(const JointBlocks& blocks, const JointParameters& parameters,
                                  const double* step, double focal_step) {
  const WideParameters wide(parameters);
  const Real3 rotation = Fill3(step), translation = Fill3(step + 3);
  const Real mean = Constant(step[6]);
  for (int k = 0; k < blocks.count; ++k) {
    JointKeypoints& keypoints = blocks.keypoints[k];
    const Real3 point = Load3(keypoints.point);
    const Symmetric4 covariance = Load10(keypoints.covariance);
    const Symmetric4 query = Load10(keypoints.query_hessian);
    const Real3 displacement = Cross(rotation, point) + translation;
    Real3 pull = Load3(keypoints.gradient) + query.point * displacement + query.mixed * mean;
    if (parameters.is_focal_unknown) {
      pull = pull + Load3(keypoints.by_focal) * Constant(focal_step);
    }
    Real common_pull = Load(keypoints.gradient[3]);
    if (parameters.have_references_errors) {
      AddReferenceSteps(blocks, keypoints, wide, pull, common_pull);
    }
    const Real3 move = covariance.point * pull + covariance.mixed * common_pull;
    const Real common_move = Dot(covariance.mixed, pull) + covariance.common * common_pull;
    // A step goes no farther than the linearization tells: half of the way to the camera.
    const Real3 offset = point - wide.Center(keypoints);
    const Real limit = Constant(0.5) * SquareRoot(Dot(offset, offset));
    const Real length = SquareRoot(Dot(move, move));
    const Real share =
        Where(IsFinite(length + common_move), Select(limit < length, limit / length, Constant(1)));
    const Real3 bounded = {Where(Constant(0) < share, move.x), Where(Constant(0) < share, move.y),
                           Where(Constant(0) < share, move.z)};
    Store3(point - bounded * share, keypoints.point);
    (Load(keypoints.common) - Where(Constant(0) < share, common_move) * share)
        .Store(keypoints.common);
  }
}

}  // namespace
}  // namespace raylift::kernels
