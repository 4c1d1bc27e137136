// The SIMD kernels against each other, byte by byte, and against the reference implementations of
// the residuals in double precision.

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>
#include <numeric>

#include "estimation/kernels/kernel_table.h"
#include "estimation/near_truth.h"
#include "estimation/problem/normalized_problem.h"
#include "estimation/ransac/scores.h"
#include "estimation/refinement/pose_minimizer.h"
#include "geometry/test_cameras.h"
#include "support/matchers.h"
#include "support/synthetic_problem.h"
#include <Eigen/QR>

#include "raylift/geometry/residuals.h"

namespace raylift {
namespace {

using Eigen::Vector3d;

std::vector<int> AllIndices(size_t count) {
  std::vector<int> indices(count);
  std::iota(indices.begin(), indices.end(), 0);
  return indices;
}

constexpr kernels::KernelLoss kLosses[] = {{kernels::LossShape::kTruncated, 1},
                                           {kernels::LossShape::kTruncated, 9},
                                           {kernels::LossShape::kBiweight, 4}};

// Everything that a table computes for a problem, in one row of bytes.
template <typename T>
void Append(const T& value, std::vector<unsigned char>& bytes) {
  const auto* begin = reinterpret_cast<const unsigned char*>(&value);
  bytes.insert(bytes.end(), begin, begin + sizeof(T));
}
void AppendScore(const kernels::KernelScore& score, std::vector<unsigned char>& bytes) {
  Append(score.cost, bytes);
  Append(score.inliers, bytes);
}
void AppendNormals(const kernels::KernelNormals& normals, std::vector<unsigned char>& bytes) {
  Append(normals.hessian, bytes);
  Append(normals.gradient, bytes);
  Append(normals.cost, bytes);
  Append(normals.inliers, bytes);
}

std::vector<unsigned char> AllOutputs(const kernels::KernelTable& table, const NearTruth& near) {
  const NormalizedProblem& problem = near.prepared;
  const auto points =
      MakeBlocks2D3D<double>(problem.matches_2d3d, AllIndices(problem.matches_2d3d.size())).blocks;
  const auto pairs =
      MakeBlocks2D2D<double>(problem.matches_2d2d, AllIndices(problem.matches_2d2d.size()));
  const auto pose = ToKernelPose<double>(near.local);
  const auto pose_float = ToKernelPose<float>(near.local);
  const auto centers = CentersInCam<double>(problem, near.local);
  const auto centers_float = CentersInCam<float>(problem, near.local);
  const auto& points_float = problem.blocks_2d3d;
  const auto& pairs_float = problem.blocks_2d2d;
  const int* reference_float = problem.block_camera_reference_2d2d.data();
  const auto size = [](const auto& blocks) { return static_cast<int>(blocks.size()); };

  std::vector<unsigned char> bytes;
  AppendScore(table.score_2d3d(points_float.data(), size(points_float), pose_float), bytes);
  AppendScore(table.score_2d2d(pairs_float.data(), reference_float, size(pairs_float), pose_float,
                               centers_float.data()),
              bytes);
  std::vector<double> residuals(points.size() * kernels::kLanes<double>);
  table.residuals_2d3d(points.data(), size(points), pose, residuals.data());
  for (const double r : residuals) Append(r, bytes);
  residuals.resize(pairs.blocks.size() * kernels::kLanes<double>);
  table.residuals_2d2d(pairs.blocks.data(), pairs.block_camera_reference.data(), size(pairs.blocks),
                       pose, centers.data(), residuals.data());
  for (const double r : residuals) Append(r, bytes);
  for (const kernels::KernelLoss& loss : kLosses) {
    AppendNormals(table.normals_2d3d(points.data(), size(points), pose, loss), bytes);
    AppendNormals(table.normals_2d2d(pairs.blocks.data(), pairs.block_camera_reference.data(),
                                     size(pairs.blocks), pose, centers.data(), loss),
                  bytes);
    AppendNormals(
        table.normals_2d3d_float(points_float.data(), size(points_float), pose_float, loss), bytes);
    AppendNormals(table.normals_2d2d_float(pairs_float.data(), reference_float, size(pairs_float),
                                           pose_float, centers_float.data(), loss),
                  bytes);
  }
  return bytes;
}

SyntheticOptions WithCounts(int num_2d3d, int num_2d2d, int num_references) {
  SyntheticOptions options;
  options.num_2d3d = num_2d3d;
  options.num_2d2d = num_2d2d;
  options.num_references = num_references;
  return options;
}

TEST(Kernels, EverySimdLevelGivesTheSameBytes) {
  Rng rng = TestRng();
  const kernels::KernelTable& baseline = kernels::KernelsOf(SimdLevel::kSse2);
  for (const int count : {0, 1, 2, 7, 8, 9, 15, 16, 17, 31, 33, 100, 500}) {
    const NearTruth near = MakeNearTruth(rng, WithCounts(count, 2 * count, 5));
    const auto expected = AllOutputs(baseline, near);
    for (const auto level : {SimdLevel::kAvx2, SimdLevel::kAvx512}) {
      if (!IsSupported(level)) continue;
      EXPECT_TRUE(AllOutputs(kernels::KernelsOf(level), near) == expected)
          << ToString(level) << " with " << count << " matches";
    }
  }
}

TEST(Kernels, FarOffPosesGiveTheSameBytesToo) {
  Rng rng = TestRng();
  const kernels::KernelTable& baseline = kernels::KernelsOf(SimdLevel::kSse2);
  for (int trial = 0; trial < 20; ++trial) {
    const NearTruth near = MakeNearTruth(rng, WithCounts(100, 100, 3), rng.Uniform(0, 180), 3);
    const auto expected = AllOutputs(baseline, near);
    for (const auto level : {SimdLevel::kAvx2, SimdLevel::kAvx512}) {
      if (!IsSupported(level)) continue;
      EXPECT_TRUE(AllOutputs(kernels::KernelsOf(level), near) == expected) << ToString(level);
    }
  }
}

// Squared errors over the squared threshold by the reference implementations, by prepared match;
// infinite where a point lies behind a camera.
std::vector<double> ReferencePointErrors(const NearTruth& near) {
  std::vector<double> squared;
  for (const NormalizedMatch2D3D& point : near.prepared.matches_2d3d) {
    const Match2D3D& match = near.synthetic.problem.matches_2d3d[point.match];
    const auto error = ReprojectionError(near.synthetic.problem.query_camera, near.pose,
                                         match.point_in_world, match.query_px);
    squared.push_back(error ? error->error_px.squaredNorm() / std::pow(kPointThresholdPx, 2)
                            : std::numeric_limits<double>::infinity());
  }
  return squared;
}

// Whether both rays meet in front of the cameras, or would after a turn by less than what noise of
// a threshold explains.
bool LiesInFront(const NearTruth& near, const NormalizedMatch2D2D& pair) {
  const PosedImage& reference = near.synthetic.problem.references[pair.reference];
  const Rigid3 query_from_reference = near.pose * reference.cam_from_world.Inverse();
  const Match2D2D& match = near.synthetic.problem.matches_2d2d[pair.match];
  const auto q = near.synthetic.problem.query_camera.RayInCam(match.query_px);
  const auto r = reference.camera.RayInCam(match.reference_px);
  Eigen::Matrix<double, 3, 2> rays;
  rays << *q, -(query_from_reference.rotation * *r);
  const Eigen::Vector2d along = rays.colPivHouseholderQr().solve(query_from_reference.translation);
  const double sine2 = 1 - std::pow(q->dot(query_from_reference.rotation * *r), 2);
  return along.minCoeff() * sine2 + query_from_reference.translation.norm() * pair.parallax > 0;
}

std::vector<double> ReferencePairErrors(const NearTruth& near) {
  std::vector<double> squared;
  const PoseProblem& problem = near.synthetic.problem;
  for (const NormalizedMatch2D2D& pair : near.prepared.matches_2d2d) {
    const Match2D2D& match = problem.matches_2d2d[pair.match];
    const PosedImage& reference = problem.references[pair.reference];
    const auto error = SampsonError(problem.query_camera, near.pose, match.query_px,
                                    reference.camera, reference.cam_from_world, match.reference_px);
    const bool counts = error && LiesInFront(near, pair);
    squared.push_back(counts ? std::pow(error->error_px / kPairThresholdPx, 2)
                             : std::numeric_limits<double>::infinity());
  }
  return squared;
}

struct KernelErrors {
  std::vector<double> of_2d3d;
  std::vector<double> of_2d2d;
};
KernelErrors ErrorsByKernels(const NearTruth& near) {
  const auto& table = kernels::ActiveKernels();
  const NormalizedProblem& problem = near.prepared;
  const auto pose = ToKernelPose<double>(near.local);
  const auto centers = CentersInCam<double>(problem, near.local);
  const auto points =
      MakeBlocks2D3D<double>(problem.matches_2d3d, AllIndices(problem.matches_2d3d.size())).blocks;
  const auto pairs =
      MakeBlocks2D2D<double>(problem.matches_2d2d, AllIndices(problem.matches_2d2d.size()));
  KernelErrors errors;
  errors.of_2d3d.resize(points.size() * kernels::kLanes<double>);
  table.residuals_2d3d(points.data(), static_cast<int>(points.size()), pose, errors.of_2d3d.data());
  errors.of_2d3d.resize(problem.matches_2d3d.size());
  std::vector<double> lanes(pairs.lane_match.size());
  table.residuals_2d2d(pairs.blocks.data(), pairs.block_camera_reference.data(),
                       static_cast<int>(pairs.blocks.size()), pose, centers.data(), lanes.data());
  errors.of_2d2d.resize(problem.matches_2d2d.size());
  for (size_t i = 0; i < lanes.size(); ++i) {
    if (pairs.lane_match[i] >= 0) errors.of_2d2d[pairs.lane_match[i]] = lanes[i];
  }
  return errors;
}

double MsacCost(const std::vector<double>& squared) {
  return std::accumulate(squared.begin(), squared.end(), 0.0,
                         [](double sum, double e2) { return sum + std::min(e2, 1.0); });
}
int CountInliers(const std::vector<double>& squared) {
  return static_cast<int>(
      std::count_if(squared.begin(), squared.end(), [](double e2) { return e2 < 1; }));
}

TEST(Kernels, PinholeErrorsAreTheReferenceErrors) {
  Rng rng = TestRng();
  for (const double turn_deg : {0.0, 0.2, 20.0, 170.0}) {
    const NearTruth near = MakeNearTruth(rng, SyntheticOptions{}, turn_deg, 0.05);
    const KernelErrors errors = ErrorsByKernels(near);
    const auto points = ReferencePointErrors(near);
    for (size_t i = 0; i < points.size(); ++i) {
      ASSERT_EQ(std::isfinite(errors.of_2d3d[i]), std::isfinite(points[i]));
      if (std::isfinite(points[i])) {
        EXPECT_NEAR(errors.of_2d3d[i], points[i], 1e-9 * (1 + points[i]));
      }
    }
    const auto pairs = ReferencePairErrors(near);
    for (size_t i = 0; i < pairs.size(); ++i) {
      ASSERT_EQ(std::isfinite(errors.of_2d2d[i]), std::isfinite(pairs[i]));
      if (std::isfinite(pairs[i])) {
        EXPECT_NEAR(errors.of_2d2d[i], pairs[i], 1e-9 * (1 + pairs[i]));
      }
    }
  }
}

TEST(Kernels, PinholeScoresAreTheSumsOfTheReferenceErrors) {
  Rng rng = TestRng();
  for (int trial = 0; trial < 20; ++trial) {
    const NearTruth near = MakeNearTruth(rng, SyntheticOptions{}, rng.Uniform(0, 0.3), 0.02);
    const PoseScore pose_score(MatchSets::kBoth, ScoreCombination::kSumMsac, 1, 1);
    const SetScores score = Scorer(near.prepared, pose_score).ScoreAll(near.local);
    const auto points = ReferencePointErrors(near);
    const auto pairs = ReferencePairErrors(near);
    // Single precision: 1e-5 of a match's cost each.
    EXPECT_NEAR(score.of_2d3d.cost, MsacCost(points), 1e-5 * static_cast<double>(points.size()));
    EXPECT_NEAR(score.of_2d2d.cost, MsacCost(pairs), 1e-5 * static_cast<double>(pairs.size()));
    EXPECT_NEAR(score.of_2d3d.inliers, CountInliers(points), 1);
    EXPECT_NEAR(score.of_2d2d.inliers, CountInliers(pairs), 1);
  }
}

TEST(Kernels, EarlyExitNeverChangesWhichPoseIsBetter) {
  Rng rng = TestRng();
  const PoseScore pose_score(MatchSets::kBoth, ScoreCombination::kSumMsac, 500, 1000);
  for (int trial = 0; trial < 50; ++trial) {
    const NearTruth near = MakeNearTruth(rng, SyntheticOptions{}, rng.Uniform(0, 1), 0.05);
    const Scorer scorer(near.prepared, pose_score);
    const double value = pose_score.Value(scorer.ScoreAll(near.local));
    EXPECT_FALSE(scorer.ScoreIfBetter(near.local, value - 0.01));
    const auto better = scorer.ScoreIfBetter(near.local, value + 0.01);
    ASSERT_TRUE(better);
    EXPECT_NEAR(pose_score.Value(*better), value, 1e-3);
  }
}

class EveryCameraKernel : public ::testing::TestWithParam<TestCamera> {};
INSTANTIATE_TEST_SUITE_P(Models, EveryCameraKernel, ::testing::ValuesIn(TypicalCameras()),
                         [](const auto& test) { return test.param.name; });

TEST_P(EveryCameraKernel, ErrorsOfNearPointsAgreeToFirstOrder) {
  Rng rng = TestRng();
  SyntheticOptions options;
  options.camera = GetParam().camera;
  const NearTruth near = MakeNearTruth(rng, options, 0.1, 0.01);
  const KernelErrors errors = ErrorsByKernels(near);
  const auto points = ReferencePointErrors(near);
  int compared = 0;
  for (size_t i = 0; i < points.size(); ++i) {
    if (!(points[i] < 1)) continue;
    // Meridians meet at a panorama's poles: nothing is straight within 20 degrees of them.
    const double from_equator = std::abs(std::asin(near.prepared.matches_2d3d[i].ray.y()));
    if (GetParam().camera.is_panorama() && from_equator > 70 * std::numbers::pi / 180) continue;
    ++compared;
    // What is left is of second order: at most a seventh of the error at the threshold's four
    // pixels, for the fisheye with the shortest focal length (150 px) and the panorama (100 px).
    EXPECT_NEAR(std::sqrt(errors.of_2d3d[i]), std::sqrt(points[i]), 0.15 * points[i] + 1e-9);
  }
  EXPECT_GT(compared, 300);
  // The Sampson error is linearized in the reference implementation as well.
  const auto pairs = ReferencePairErrors(near);
  int disagree = 0;  // by rounding, about the side on which nearly parallel rays meet
  for (size_t i = 0; i < pairs.size(); ++i) {
    disagree += std::isfinite(errors.of_2d2d[i]) == std::isfinite(pairs[i]) ? 0 : 1;
    if (std::isfinite(pairs[i]) && std::isfinite(errors.of_2d2d[i])) {
      EXPECT_NEAR(errors.of_2d2d[i], pairs[i], 1e-9 * (1 + pairs[i]));
    }
  }
  EXPECT_LE(disagree, 2);
}

struct KindNormals {
  kernels::KernelNormals of_2d3d;
  kernels::KernelNormals of_2d2d;
};
KindNormals NormalsAt(const NearTruth& near, const CamFromLocal& local,
                      const kernels::KernelLoss& loss) {
  const auto& table = kernels::ActiveKernels();
  const NormalizedProblem& problem = near.prepared;
  const auto points =
      MakeBlocks2D3D<double>(problem.matches_2d3d, AllIndices(problem.matches_2d3d.size())).blocks;
  const auto pairs =
      MakeBlocks2D2D<double>(problem.matches_2d2d, AllIndices(problem.matches_2d2d.size()));
  const auto pose = ToKernelPose<double>(local);
  const auto centers = CentersInCam<double>(problem, local);
  return {table.normals_2d3d(points.data(), static_cast<int>(points.size()), pose, loss),
          table.normals_2d2d(pairs.blocks.data(), pairs.block_camera_reference.data(),
                             static_cast<int>(pairs.blocks.size()), pose, centers.data(), loss)};
}

TEST(Kernels, GradientsMatchCentralDifferencesOfTheCost) {
  Rng rng = TestRng();
  constexpr double kStep = 1e-7;
  for (const kernels::KernelLoss& loss : kLosses) {
    const NearTruth near = MakeNearTruth(rng, SyntheticOptions{});
    const KindNormals normals = NormalsAt(near, near.local, loss);
    for (int i = 0; i < 6; ++i) {
      const Vector6d step = kStep * Vector6d::Unit(i);
      const KindNormals plus = NormalsAt(near, Moved(near.local, step), loss);
      const KindNormals minus = NormalsAt(near, Moved(near.local, -step), loss);
      // The gradient is that of half the cost.
      const auto check = [&](const kernels::KernelNormals& at, const kernels::KernelNormals& p,
                             const kernels::KernelNormals& m) {
        const double scale = std::sqrt(at.hessian[0] * at.cost);
        EXPECT_NEAR(at.gradient[i], (p.cost - m.cost) / (4 * kStep), 1e-4 * scale);
      };
      check(normals.of_2d3d, plus.of_2d3d, minus.of_2d3d);
      check(normals.of_2d2d, plus.of_2d2d, minus.of_2d2d);
    }
  }
}

Matrix6d Unpacked(const kernels::KernelNormals& normals) {
  Matrix6d hessian;
  int k = 0;
  for (int r = 0; r < 6; ++r) {
    for (int c = r; c < 6; ++c, ++k) hessian(r, c) = hessian(c, r) = normals.hessian[k];
  }
  return hessian;
}

TEST(Kernels, NormalEquationsSumTheReferenceJacobians) {
  Rng rng = TestRng();
  const NearTruth near = MakeNearTruth(rng, SyntheticOptions{});
  const PoseProblem& problem = near.synthetic.problem;
  // A step's translation is in local units there, in scene units here.
  Vector6d unit = Vector6d::Ones();
  unit.tail<3>().setConstant(near.prepared.scale);
  const auto errors = ErrorsByKernels(near);
  Matrix6d points = Matrix6d::Zero();
  for (size_t i = 0; i < errors.of_2d3d.size(); ++i) {
    if (!(errors.of_2d3d[i] < 1)) continue;
    const Match2D3D& match = problem.matches_2d3d[near.prepared.matches_2d3d[i].match];
    const auto residual =
        ReprojectionError(problem.query_camera, near.pose, match.point_in_world, match.query_px);
    const Eigen::Matrix<double, 2, 6> j = residual->jacobian * unit.asDiagonal();
    points += j.transpose() * j / std::pow(kPointThresholdPx, 2);
  }
  Matrix6d pairs = Matrix6d::Zero();
  for (size_t i = 0; i < errors.of_2d2d.size(); ++i) {
    if (!(errors.of_2d2d[i] < 1)) continue;
    const Match2D2D& match = problem.matches_2d2d[near.prepared.matches_2d2d[i].match];
    const PosedImage& reference = problem.references[match.reference];
    const auto residual =
        SampsonError(problem.query_camera, near.pose, match.query_px, reference.camera,
                     reference.cam_from_world, match.reference_px);
    const Eigen::Matrix<double, 1, 6> j = residual->jacobian * unit.asDiagonal();
    pairs += j.transpose() * j / std::pow(kPairThresholdPx, 2);
  }
  const KindNormals normals = NormalsAt(near, near.local, kLosses[0]);
  EXPECT_LT((Unpacked(normals.of_2d3d) - points).norm(), 1e-9 * points.norm());
  EXPECT_LT((Unpacked(normals.of_2d2d) - pairs).norm(), 1e-9 * pairs.norm());
}

TEST(Kernels, SinglePrecisionNormalEquationsAgreeWithDouble) {
  Rng rng = TestRng();
  const NearTruth near = MakeNearTruth(rng, SyntheticOptions{});
  const NormalizedProblem& problem = near.prepared;
  const auto& table = kernels::ActiveKernels();
  const KindNormals exact = NormalsAt(near, near.local, kLosses[1]);
  const auto pose = ToKernelPose<float>(near.local);
  const auto centers = CentersInCam<float>(problem, near.local);
  const kernels::KernelLoss& loss = kLosses[1];
  const auto points = table.normals_2d3d_float(
      problem.blocks_2d3d.data(), static_cast<int>(problem.blocks_2d3d.size()), pose, loss);
  const auto pairs = table.normals_2d2d_float(
      problem.blocks_2d2d.data(), problem.block_camera_reference_2d2d.data(),
      static_cast<int>(problem.blocks_2d2d.size()), pose, centers.data(), loss);
  EXPECT_LT((Unpacked(points) - Unpacked(exact.of_2d3d)).norm(), 1e-3 * Unpacked(points).norm());
  EXPECT_LT((Unpacked(pairs) - Unpacked(exact.of_2d2d)).norm(), 1e-3 * Unpacked(pairs).norm());
}

}  // namespace
}  // namespace raylift
