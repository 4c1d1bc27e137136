// The kernels themselves, on vectors of RAYLIFT_KERNEL_BYTES bytes. Compiled once per instruction
// set (raylift_add_kernels), each time with other flags: so everything here but Kernels() has
// internal linkage, and no library header is used whose inline functions could leak instructions
// that another processor lacks into the rest of the program.

#include "estimation/kernels/kernels.h"

#include <cstddef>

#include "estimation/kernels/joint_expectation.h"
#include "estimation/kernels/joint_lanes.h"
#include "estimation/kernels/joint_voting.h"
#include "estimation/kernels/lanes.h"

namespace raylift::kernels {
namespace {

// A pose with every coefficient in all lanes.
template <typename T>
struct WidePose {
  Vec3<T> row[3];
  Vec3<T> translation;

  explicit WidePose(const KernelPose<T>& pose)
      : row{Fill3(pose.rotation), Fill3(pose.rotation + 3), Fill3(pose.rotation + 6)},
        translation(Fill3(pose.translation)) {}
  Vec3<T> Rotate(const Vec3<T>& v) const {
    return {Dot(row[0], v), Dot(row[1], v), Dot(row[2], v)};
  }
  Vec3<T> RotateBack(const Vec3<T>& v) const { return row[0] * v.x + row[1] * v.y + row[2] * v.z; }
};

// One block of 2D-3D matches under a pose.
template <typename T>
struct Terms2D3D {
  Vec3<T> frame0, frame1, frame2;  // the rows of image_from_ray
  Vec3<T> point_in_cam;
  Lanes<T> n0, n1, depth, variance_at_unit_depth;

  Terms2D3D(const Block2D3D<T>& block, const WidePose<T>& pose)
      : frame0(LoadVec3<T>(block.image_from_ray)),
        frame1(LoadVec3<T>(block.image_from_ray + 3)),
        frame2(LoadVec3<T>(block.image_from_ray + 6)),
        point_in_cam(pose.Rotate(LoadVec3<T>(block.x)) + pose.translation),
        n0(Dot(frame0, point_in_cam)),
        n1(Dot(frame1, point_in_cam)),
        depth(Dot(frame2, point_in_cam)),
        variance_at_unit_depth(Lanes<T>::Load(block.variance_at_unit_depth)) {}

  Lanes<T> SquaredNumerator() const { return n0 * n0 + n1 * n1; }
  Lanes<T> SquaredDenominator() const { return depth * depth + variance_at_unit_depth; }
};

// One block of 2D-2D matches under a pose. `center` is the reference's camera center in the query's
// frame.
template <typename T>
struct Terms2D2D {
  Vec3<T> query_ray, g;         // g: the reference's ray in the query's frame
  Vec3<T> normal;               // of the epipolar plane: center x g = E r
  Vec3<T> h;                    // query ray x center; E' q in the query's frame
  Lanes<T> numerator;           // q . E r
  Lanes<T> eq0, eq1, er0, er1;  // the gradient
  Lanes<T> squared_denominator;
  // Signs of the depths along the two rays; a little below zero still counts, as rays that are
  // parallel but for the noise of their pixels meet behind the cameras half of the time.
  Lanes<T> query_depth, reference_depth;

  Terms2D2D(const Block2D2D<T>& block, const WidePose<T>& pose, const Vec3<T>& center,
            const Lanes<T>& baseline)
      : query_ray(LoadVec3<T>(block.query_ray)),
        g(pose.Rotate(LoadVec3<T>(block.reference_ray))),
        normal(Cross(center, g)),
        h(Cross(query_ray, center)),
        numerator(Dot(query_ray, normal)) {
    eq0 = Dot(LoadVec3<T>(block.query_gradient), normal);
    eq1 = Dot(LoadVec3<T>(block.query_gradient + 3), normal);
    const Vec3<T> u = pose.RotateBack(h);
    er0 = Dot(LoadVec3<T>(block.reference_gradient), u);
    er1 = Dot(LoadVec3<T>(block.reference_gradient + 3), u);
    squared_denominator = eq0 * eq0 + eq1 * eq1 + er0 * er0 + er1 * er1;
    const Lanes<T> a = Dot(center, query_ray);
    const Lanes<T> b = Dot(center, g);
    const Lanes<T> c = Dot(query_ray, g);
    const Lanes<T> tolerance = baseline * Lanes<T>::Load(block.parallax);
    query_depth = a - b * c + tolerance;
    reference_depth = a * c - b + tolerance;
  }
};

template <typename T>
inline Lanes<T> Length(const T* v) {
  const T length2 = v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
  return Lanes<T>::Fill(sizeof(T) == 4
                            ? static_cast<T>(__builtin_sqrtf(static_cast<float>(length2)))
                            : static_cast<T>(__builtin_sqrt(static_cast<double>(length2))));
}

[[gnu::flatten]] KernelScore Score2D3D(const Block2D3D<float>* blocks, int count,
                                       const KernelPose<float>& pose) {
  using L = Lanes<float>;
  const WidePose<float> wide(pose);
  const L one = L::Fill(1.0f);
  const L zero = L::Fill(0.0f);
  L cost = zero;
  L inliers = zero;
  for (int i = 0; i < count; ++i) {
    const Terms2D3D<float> m(blocks[i], wide);
    const L numerator = m.SquaredNumerator();
    const L denominator = m.SquaredDenominator();
    cost = cost + SelectInlier(numerator, denominator, m.depth, one, numerator / denominator, one);
    inliers = inliers + SelectInlier(numerator, denominator, m.depth, one, one, zero);
  }
  return {cost.Sum(), static_cast<int>(inliers.Sum())};
}

[[gnu::flatten]] KernelScore Score2D2D(const Block2D2D<float>* blocks,
                                       const int* block_camera_reference, int count,
                                       const KernelPose<float>& pose, const float* centers) {
  using L = Lanes<float>;
  const WidePose<float> wide(pose);
  const L one = L::Fill(1.0f);
  const L zero = L::Fill(0.0f);
  L cost = zero;
  L inliers = zero;
  for (int i = 0; i < count; ++i) {
    const float* center = centers + 3 * static_cast<std::ptrdiff_t>(block_camera_reference[i]);
    const Terms2D2D<float> m(blocks[i], wide, Fill3(center), Length(center));
    const L squared = m.numerator * m.numerator;
    cost = cost + SelectInlier(squared, m.squared_denominator, m.query_depth, m.reference_depth,
                               squared / m.squared_denominator, one);
    inliers = inliers + SelectInlier(squared, m.squared_denominator, m.query_depth,
                                     m.reference_depth, one, zero);
  }
  return {cost.Sum(), static_cast<int>(inliers.Sum())};
}

[[gnu::flatten]] void Residuals2D3D(const Block2D3D<double>* blocks, int count,
                                    const KernelPose<double>& pose, double* squared_residuals) {
  using L = Lanes<double>;
  const WidePose<double> wide(pose);
  const L one = L::Fill(1);
  const L infinity = L::Fill(__builtin_inf());
  const L zero = L::Fill(0);
  for (int i = 0; i < count; ++i) {
    const Terms2D3D<double> m(blocks[i], wide);
    const L denominator = m.SquaredDenominator();
    SelectInlier(zero, denominator, m.depth, one, m.SquaredNumerator() / denominator, infinity)
        .Store(squared_residuals + i * kLanes<double>);
  }
}

[[gnu::flatten]] void Residuals2D2D(const Block2D2D<double>* blocks,
                                    const int* block_camera_reference, int count,
                                    const KernelPose<double>& pose, const double* centers,
                                    double* squared_residuals) {
  using L = Lanes<double>;
  const WidePose<double> wide(pose);
  const L infinity = L::Fill(__builtin_inf());
  const L zero = L::Fill(0);
  for (int i = 0; i < count; ++i) {
    const double* center = centers + 3 * static_cast<std::ptrdiff_t>(block_camera_reference[i]);
    const Terms2D2D<double> m(blocks[i], wide, Fill3(center), Length(center));
    SelectInlier(zero, m.squared_denominator, m.query_depth, m.reference_depth,
                 m.numerator * m.numerator / m.squared_denominator, infinity)
        .Store(squared_residuals + i * kLanes<double>);
  }
}

// The 21 + 6 sums over lanes.
template <typename T>
struct NormalLanes {
  Lanes<T> hessian[21];
  Lanes<T> gradient[6];
  Lanes<T> cost, inliers;

  NormalLanes() {
    for (auto& h : hessian) h = Lanes<T>::Fill(0);
    for (auto& g : gradient) g = Lanes<T>::Fill(0);
    cost = inliers = Lanes<T>::Fill(0);
  }
  // Adds a residual with its derivatives by rotation and translation.
  void Add(const Vec3<T>& by_rotation, const Vec3<T>& by_translation, const Lanes<T>& residual) {
    const Lanes<T> j[6] = {by_rotation.x,    by_rotation.y,    by_rotation.z,
                           by_translation.x, by_translation.y, by_translation.z};
    int k = 0;
    for (int r = 0; r < 6; ++r) {
      gradient[r] = gradient[r] + j[r] * residual;
      for (int c = r; c < 6; ++c, ++k) {
        hessian[k] = hessian[k] + j[r] * j[c];
      }
    }
  }
  KernelNormals Sum() const {
    KernelNormals n;
    for (int k = 0; k < 21; ++k) n.hessian[k] = hessian[k].Sum();
    for (int k = 0; k < 6; ++k) n.gradient[k] = gradient[k].Sum();
    n.cost = cost.Sum();
    n.inliers = static_cast<int>(inliers.Sum());
    return n;
  }
};

// The cost of a squared residual, and the root of its weight, by which the residual and its
// derivatives are multiplied: zero beyond the limit.
template <typename T>
struct LossTerms {
  Lanes<T> cost, inlier, root_weight;

  LossTerms(const Lanes<T>& numerator, const Lanes<T>& denominator, const Lanes<T>& depth0,
            const Lanes<T>& depth1, const KernelLoss& loss) {
    using L = Lanes<T>;
    const L one = L::Fill(1);
    const L zero = L::Fill(0);
    const L limit = L::Fill(static_cast<T>(loss.limit));
    const L bound = denominator * limit;
    const L squared = numerator / denominator;
    inlier = SelectInlier(numerator, bound, depth0, depth1, one, zero);
    if (loss.shape == LossShape::kTruncated) {
      root_weight = inlier;
      cost = SelectInlier(numerator, bound, depth0, depth1, squared, limit);
    } else {
      root_weight = SelectInlier(numerator, bound, depth0, depth1, one - squared / limit, zero);
      cost =
          L::Fill(static_cast<T>(loss.limit / 3)) * (one - root_weight * root_weight * root_weight);
    }
  }
};

// Returns v, zero in the lanes that do not count: they may hold infinities and NaN, which a weight
// of zero would not silence.
template <typename T>
inline Vec3<T> Silence(const Vec3<T>& v, const Lanes<T>& inlier) {
  const Lanes<T> zero = Lanes<T>::Fill(0);
  const Lanes<T> one = Lanes<T>::Fill(1);
  return {SelectInlier(zero, inlier, one, one, v.x, zero),
          SelectInlier(zero, inlier, one, one, v.y, zero),
          SelectInlier(zero, inlier, one, one, v.z, zero)};
}
template <typename T>
inline Lanes<T> Silence(const Lanes<T>& v, const Lanes<T>& inlier) {
  const Lanes<T> zero = Lanes<T>::Fill(0);
  const Lanes<T> one = Lanes<T>::Fill(1);
  return SelectInlier(zero, inlier, one, one, v, zero);
}

template <typename T>
[[gnu::flatten]] KernelNormals Normals2D3D(const Block2D3D<T>* blocks, int count,
                                           const KernelPose<T>& pose, const KernelLoss& loss) {
  using L = Lanes<T>;
  const WidePose<T> wide(pose);
  const L one = L::Fill(1);
  NormalLanes<T> sums;
  for (int i = 0; i < count; ++i) {
    const Terms2D3D<T> m(blocks[i], wide);
    const LossTerms<T> terms(m.SquaredNumerator(), m.SquaredDenominator(), m.depth, one, loss);
    sums.cost = sums.cost + terms.cost;
    sums.inliers = sums.inliers + terms.inlier;
    // e = n / s with s^2 = depth^2 + variance_at_unit_depth, so d e / d p = (frame_k - e_k (depth /
    // s) frame_2) / s; a step (w, v) moves p by w x p + v.
    const L inverse = Silence(one / SquareRoot(m.SquaredDenominator()), terms.inlier);
    const L e0 = m.n0 * inverse;
    const L e1 = m.n1 * inverse;
    const L depth_share = m.depth * inverse;
    const L scale = inverse * terms.root_weight;
    const Vec3<T> a0 = (m.frame0 - m.frame2 * (e0 * depth_share)) * scale;
    const Vec3<T> a1 = (m.frame1 - m.frame2 * (e1 * depth_share)) * scale;
    sums.Add(Cross(m.point_in_cam, a0), a0, e0 * terms.root_weight);
    sums.Add(Cross(m.point_in_cam, a1), a1, e1 * terms.root_weight);
  }
  return sums.Sum();
}

template <typename T>
[[gnu::flatten]] KernelNormals Normals2D2D(const Block2D2D<T>* blocks,
                                           const int* block_camera_reference, int count,
                                           const KernelPose<T>& pose, const T* centers,
                                           const KernelLoss& loss) {
  using L = Lanes<T>;
  const WidePose<T> wide(pose);
  const L one = L::Fill(1);
  NormalLanes<T> sums;
  for (int i = 0; i < count; ++i) {
    const T* center_values = centers + 3 * static_cast<std::ptrdiff_t>(block_camera_reference[i]);
    const Vec3<T> center = Fill3(center_values);
    const Terms2D2D<T> m(blocks[i], wide, center, Length(center_values));
    const LossTerms<T> terms(m.numerator * m.numerator, m.squared_denominator, m.query_depth,
                             m.reference_depth, loss);
    sums.cost = sums.cost + terms.cost;
    sums.inliers = sums.inliers + terms.inlier;

    // s = num / sqrt(den). Under (w, v), g turns by w, the center moves by w x center + v:
    //   d num = w . (n x q) + v . (g x q)                        with n = center x g
    //   d (G_q . n) = w . (n x G_q) + v . (g x G_q)
    //   d (G_r . R' h) = w . (k x h + center x (k x q)) + v . (k x q)   with k = R G_r
    // All times the root of the weight.
    const L inverse = Silence(one / SquareRoot(m.squared_denominator), terms.inlier);
    const L weighted = inverse * terms.root_weight;
    const L s = Silence(m.numerator * weighted, terms.inlier);
    const L pull = s * inverse * inverse;  // num / den^(3/2)
    const Vec3<T> q0 = LoadVec3<T>(blocks[i].query_gradient);
    const Vec3<T> q1 = LoadVec3<T>(blocks[i].query_gradient + 3);
    const Vec3<T> k0 = wide.Rotate(LoadVec3<T>(blocks[i].reference_gradient));
    const Vec3<T> k1 = wide.Rotate(LoadVec3<T>(blocks[i].reference_gradient + 3));
    // The weighted sums of the gradient's derivatives are linear in G_q and in k.
    const Vec3<T> q_mix = q0 * m.eq0 + q1 * m.eq1;
    const Vec3<T> k_mix = k0 * m.er0 + k1 * m.er1;
    const Vec3<T> k_cross_q = Cross(k_mix, m.query_ray);
    const Vec3<T> by_rotation =
        Cross(m.normal, m.query_ray) * weighted -
        (Cross(m.normal, q_mix) + Cross(k_mix, m.h) + Cross(center, k_cross_q)) * pull;
    const Vec3<T> by_translation =
        Cross(m.g, m.query_ray) * weighted - (Cross(m.g, q_mix) + k_cross_q) * pull;
    sums.Add(Silence(by_rotation, terms.inlier), Silence(by_translation, terms.inlier), s);
  }
  return sums.Sum();
}

}  // namespace

const KernelTable& RAYLIFT_KERNEL_LEVEL::Kernels() {
  static constexpr KernelTable kTable = {
      Score2D3D,           Score2D2D,           Residuals2D3D,      Residuals2D2D,
      Normals2D3D<double>, Normals2D2D<double>, Normals2D3D<float>, Normals2D2D<float>,
      ScanJointly,         VoteJointly,         LinearizeJointly,   MoveJointly,
      ExpectJointly};
  return kTable;
}

}  // namespace raylift::kernels
