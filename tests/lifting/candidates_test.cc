#include <algorithm>
#include <cmath>

#include "support/enum_names.h"
#include "support/matchers.h"
#include "support/meshes.h"
#include <gtest/gtest.h>

#include "raylift/base/error.h"
#include "raylift/lifting/lifter.h"

namespace raylift {
namespace {

// References on an arc that look at points around the origin, 6 units away.
struct Arc {
  std::vector<PosedImage> references;
  std::vector<Match2D2D> matches;
  std::vector<Match2D3D> candidates;

  explicit Arc(int num_references, double span = 3) {
    const double params[] = {500, 510, 322, 238, -0.1, 0.02, 0.001, -0.002};
    const Camera camera(CameraModel::kOpenCv, 640, 480, params);
    for (int i = 0; i < num_references; ++i) {
      const double x = num_references > 1 ? span * (i / (num_references - 1.0) - 0.5) : 0;
      references.push_back(
          {"r" + std::to_string(i), camera, LookAt({x, 0.3 * x * x, -6}, {0, 0, 0})});
    }
  }

  Eigen::Vector2d Pixel(int reference, const Eigen::Vector3d& point) const {
    const PosedImage& image = references[static_cast<size_t>(reference)];
    return image.camera.ImgFromCam(image.cam_from_world * point).value();
  }
  Eigen::Vector3d Center(int reference) const {
    return references[static_cast<size_t>(reference)].cam_from_world.OriginInSource();
  }
  // The query keypoint shows the point, and so do the references' keypoints, `off_px` beside it.
  void Match(const Eigen::Vector2d& query_px, int reference, const Eigen::Vector3d& point,
             const Eigen::Vector2d& off_px = {0, 0}) {
    matches.push_back({reference, query_px, Pixel(reference, point) + off_px});
  }
  // A candidate lifted from a reference with wrong depth.
  void Lift(const Eigen::Vector2d& query_px, int reference, const Eigen::Vector3d& point,
            double depth_factor) {
    const Eigen::Vector3d center = Center(reference);
    candidates.push_back({query_px, center + depth_factor * (point - center), reference, {}});
  }

  std::vector<Match2D3D> Merge(const CandidateOptions& options = {}) const {
    return MergeCandidates(references, matches, candidates, options);
  }
  std::vector<Match2D3D> Triangulate(const CandidateOptions& options = {}) const {
    return TriangulateMatches(references, matches, options);
  }
};

const Eigen::Vector3d kPoint(0.4, -0.3, 0.5);
const Eigen::Vector2d kQueryPx(100.25, 200.5);
constexpr double kNeverRefined = 89;  // degrees

TEST(MergeCandidates, TakesTheOneThatTheReferencesAgreeOn) {
  Arc arc(4);
  const double factors[] = {1.02, 0.99, 1.001, 1.3};
  for (int r = 0; r < 4; ++r) {
    arc.Match(kQueryPx, r, kPoint);
    arc.Lift(kQueryPx, r, kPoint, factors[r]);
  }
  const auto merged = arc.Merge({.min_angle_deg = kNeverRefined});
  ASSERT_EQ(merged.size(), 1u);
  EXPECT_EQ(merged[0].point_in_world, arc.candidates[2].point_in_world);
  EXPECT_EQ(merged[0].query_px, kQueryPx);
  EXPECT_EQ(merged[0].reference, 2);

  const auto refined = arc.Merge();
  ASSERT_EQ(refined.size(), 1u);
  EXPECT_EQ(refined[0].reference, 2);
  EXPECT_LT((refined[0].point_in_world - kPoint).norm(), 1e-6) << "the matches are exact";
}

TEST(MergeCandidates, AWrongMatchDoesNotPullThePoint) {
  Arc arc(5);
  for (int r = 0; r < 5; ++r) {
    arc.Match(kQueryPx, r, kPoint, r == 1 ? Eigen::Vector2d(30, -20) : Eigen::Vector2d(0, 0));
    arc.Lift(kQueryPx, r, kPoint, 1.005);
  }
  // What was lifted from the wrong keypoint is a candidate, too.
  arc.candidates[1].point_in_world += Eigen::Vector3d(0.4, -0.3, 0);
  const auto merged = arc.Merge();
  ASSERT_EQ(merged.size(), 1u);
  EXPECT_LT((merged[0].point_in_world - kPoint).norm(), 1e-6);
  EXPECT_NE(merged[0].reference, 1);
}

TEST(MergeCandidates, IsNotRefinedWhereRaysAreNearlyParallel) {
  Arc arc(3, 0.05);  // 0.5 degrees
  for (int r = 0; r < 3; ++r) {
    arc.Match(kQueryPx, r, kPoint, Eigen::Vector2d(r % 2, 0));
    arc.Lift(kQueryPx, r, kPoint, 1.01);
  }
  const auto merged = arc.Merge();
  ASSERT_EQ(merged.size(), 1u);
  const auto same = [&](const Match2D3D& candidate) {
    return candidate.point_in_world == merged[0].point_in_world;
  };
  EXPECT_TRUE(std::any_of(arc.candidates.begin(), arc.candidates.end(), same));
  EXPECT_FALSE(
      std::any_of(arc.candidates.begin(), arc.candidates.end(), [&](const Match2D3D& candidate) {
        return candidate.point_in_world == arc.Merge({.min_angle_deg = 0.1})[0].point_in_world;
      }));
}

TEST(MergeCandidates, KeypointsKeepTheirOrderAndThoseOfOneReferenceTheirPoint) {
  Arc arc(3);
  const Eigen::Vector2d second(7, 8), alone(3, 4);
  const Eigen::Vector3d other(-0.5, 0.6, 1);
  arc.Match(second, 1, other);
  arc.Match(kQueryPx, 0, kPoint);
  arc.Match(alone, 2, kPoint);
  arc.Match(second, 2, other);
  arc.Match(kQueryPx, 1, kPoint);
  arc.Lift(second, 1, other, 1.01);
  arc.Lift(alone, 2, kPoint, 1.2);
  arc.Lift(kQueryPx, 1, kPoint, 0.99);
  arc.Lift(second, 2, other, 1.01);
  const auto merged = arc.Merge();
  ASSERT_EQ(merged.size(), 3u);
  EXPECT_EQ(merged[0].query_px, second);
  EXPECT_LT((merged[0].point_in_world - other).norm(), 1e-6);
  EXPECT_EQ(merged[1].query_px, alone);
  EXPECT_EQ(merged[1].point_in_world, arc.candidates[1].point_in_world);
  EXPECT_EQ(merged[2].query_px, kQueryPx);
  EXPECT_LT((merged[2].point_in_world - kPoint).norm(), 1e-6);
  EXPECT_TRUE(Arc(3).Merge().empty());
}

TEST(TriangulateMatches, FindsThePointWithoutGeometryDespiteWrongMatches) {
  Rng rng = TestRng();
  // Few and more references than all their pairs are looked at.
  for (const int num_references : {2, 5, 20}) {
    Arc arc(num_references);
    std::vector<Eigen::Vector3d> points;
    for (int p = 0; p < 30; ++p) {
      points.emplace_back(rng.Uniform(-1, 1), rng.Uniform(-1, 1), rng.Uniform(-1, 1));
      for (int r = 0; r < num_references; ++r) {
        const bool wrong = num_references > 2 && r % 3 == p % 3;
        arc.Match({1.0 * p, 5}, r, points.back(),
                  wrong ? Eigen::Vector2d(rng.Uniform(-90, 90), 25) : Eigen::Vector2d(0, 0));
      }
    }
    const auto found = arc.Triangulate();
    ASSERT_EQ(found.size(), points.size());
    for (size_t p = 0; p < points.size(); ++p) {
      EXPECT_EQ(found[p].query_px, Eigen::Vector2d(static_cast<double>(p), 5));
      EXPECT_FALSE(found[p].reference);
      EXPECT_LT((found[p].point_in_world - points[p]).norm(), 1e-6) << num_references;
    }
  }
}

TEST(MergeCandidates, IndicesSayWhichPointsAreOfOneKeypoint) {
  // The last bit of a keypoint's pixel may differ, and two keypoints may share a pixel.
  const Eigen::Vector2d next(std::nextafter(kQueryPx.x(), 1e9), kQueryPx.y());
  Arc arc(3);
  arc.Match(kQueryPx, 0, kPoint);
  arc.Match(next, 1, kPoint);
  arc.Match(kQueryPx, 2, -kPoint);
  arc.Lift(kQueryPx, 0, kPoint, 1.01);
  arc.Lift(next, 1, kPoint, 0.99);
  arc.Lift(kQueryPx, 2, -kPoint, 1);
  const int keypoints[] = {12, 12, 4};
  for (size_t i = 0; i < 3; ++i) {
    arc.matches[i].query_keypoint = arc.candidates[i].query_keypoint = keypoints[i];
  }
  const auto merged = arc.Merge();
  ASSERT_EQ(merged.size(), 2u);
  EXPECT_EQ(merged[0].query_keypoint, 12);
  EXPECT_LT((merged[0].point_in_world - kPoint).norm(), 1e-6);
  EXPECT_EQ(merged[1].query_keypoint, 4);
  EXPECT_EQ(merged[1].point_in_world, arc.candidates[2].point_in_world);
  const auto triangulated = arc.Triangulate();
  ASSERT_EQ(triangulated.size(), 1u);
  EXPECT_EQ(triangulated[0].query_keypoint, 12);
  EXPECT_LT((triangulated[0].point_in_world - kPoint).norm(), 1e-6);
}

TEST(TriangulateMatches, IsBestInTheLeastSquaresSense) {
  Rng rng = TestRng();
  Arc arc(6);
  for (int r = 0; r < 6; ++r)
    arc.Match(kQueryPx, r, kPoint, {0.5 * rng.Normal(), 0.5 * rng.Normal()});
  const auto found = arc.Triangulate();
  ASSERT_EQ(found.size(), 1u);
  const auto cost = [&](const Eigen::Vector3d& point) {
    double sum = 0;
    for (const Match2D2D& match : arc.matches) {
      sum += (arc.Pixel(match.reference, point) - match.reference_px).squaredNorm();
    }
    return sum;
  };
  const double lowest = cost(found[0].point_in_world);
  for (int axis = 0; axis < 3; ++axis) {
    for (const double step : {-1e-3, 1e-3}) {
      EXPECT_GT(cost(found[0].point_in_world + step * Eigen::Vector3d::Unit(axis)), lowest);
    }
  }
}

TEST(TriangulateMatches, NeedsTwoReferencesThatAgreeAtAnAngle) {
  const auto count = [](const Arc& arc, const CandidateOptions& options = {}) {
    return arc.Triangulate(options).size();
  };
  Arc one(2);
  one.Match(kQueryPx, 0, kPoint);
  EXPECT_EQ(count(one), 0u);
  one.Match(kQueryPx, 0, kPoint, {9, 0});  // another keypoint of the same reference
  EXPECT_EQ(count(one), 0u);

  Arc apart(2);
  apart.Match(kQueryPx, 0, kPoint);
  apart.Match(kQueryPx, 1, kPoint, {0, 12});  // across the epipolar line
  EXPECT_EQ(count(apart), 0u);
  EXPECT_EQ(count(apart, {.max_error_px = 9}), 1u);

  Arc narrow(2, 0.05);
  narrow.Match(kQueryPx, 0, kPoint);
  narrow.Match(kQueryPx, 1, kPoint);
  EXPECT_EQ(count(narrow), 0u);
  EXPECT_EQ(count(narrow, {.min_angle_deg = 0.1}), 1u);

  Arc behind(2);  // rays that part: they would meet behind the cameras
  behind.matches = {{0, kQueryPx, {20, 240}}, {1, kQueryPx, {620, 240}}};
  EXPECT_EQ(count(behind), 0u);
}

TEST(CandidateOptions, OutOfRangeIsAnOptionError) {
  EXPECT_NO_THROW(CandidateOptions().Validate());
  EXPECT_THROW(CandidateOptions{.max_error_px = 0}.Validate(), OptionError);
  EXPECT_THROW(CandidateOptions{.min_angle_deg = -1}.Validate(), OptionError);
  EXPECT_THROW(CandidateOptions{.min_angle_deg = 90}.Validate(), OptionError);
}

TEST(CandidateOptions, ModesHaveNames) { EXPECT_TRUE(NamesEveryValue<CandidateMode>()); }

}  // namespace
}  // namespace raylift
