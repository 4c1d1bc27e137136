#include <cmath>
#include <map>

#include "localization/continuous/joined_references.h"
#include "support/matchers.h"
#include "support/synthetic_problem.h"
#include <gtest/gtest.h>

namespace raylift {
namespace {

Camera PinholeCamera() {
  const double params[] = {500, 500, 320, 240};
  return Camera(CameraModel::kPinhole, 640, 480, params);
}

// At the origin, looks along z; its pixel (320, 240) is linked to a point 5 units ahead.
JoinedReference MakeReference(const PoseCovariance& covariance) {
  return {.image = {"joined", PinholeCamera(), Rigid3()},
          .covariance = covariance,
          .distance = 10,
          .links = {{{320, 240}, {0, 0, 5}}}};
}

PoseCovariance Diagonal(double rotation_variance, double position_variance) {
  PoseCovariance covariance = PoseCovariance::Zero();
  covariance.diagonal() << Eigen::Vector3d::Constant(rotation_variance),
      Eigen::Vector3d::Constant(position_variance);
  return covariance;
}

TEST(JoinedReferences, PixelsSpreadByThePosesCovariance) {
  JoinedReferences joined(true);
  // Half a centimeter at 5 units is half a pixel, at the distance of 10 a quarter.
  joined.Add(MakeReference(Diagonal(0, 0.005 * 0.005)));
  EXPECT_NEAR(*joined.SigmaPx("joined", Eigen::Vector2d(320, 240)), 0.5, 1e-12);
  EXPECT_NEAR(*joined.SigmaPx("joined", Eigen::Vector2d(321, 240)), 0.25, 1e-4);
  EXPECT_EQ(joined.SigmaPx("another", Eigen::Vector2d(321, 240)), std::nullopt);
  // A turn moves both alike.
  joined.Add(MakeReference(Diagonal(1e-6, 0)));
  EXPECT_NEAR(*joined.SigmaPx("joined", Eigen::Vector2d(320, 240)), 0.5, 1e-12);
  EXPECT_NEAR(*joined.SigmaPx("joined", Eigen::Vector2d(321, 240)), 0.5, 1e-4);
}

TEST(JoinedReferences, AnErrorOfPositionThatATurnMakesUpForMovesNothing) {
  // Turned about y by a, and moved by -5 a along x, the camera sees the point at the same pixel.
  Eigen::Matrix<double, 6, 1> step;
  step << 0, 1e-3, 0, -5e-3, 0, 0;
  JoinedReferences joined(true);
  joined.Add(MakeReference(step * step.transpose()));
  EXPECT_NEAR(*joined.SigmaPx("joined", Eigen::Vector2d(320, 240)), 0, 1e-9);
  EXPECT_GT(*joined.SigmaPx("joined", Eigen::Vector2d(321, 240)), 0.1);
}

TEST(JoinedReferences, OnlyMatchesWithThemAreWeighed) {
  QueryMatches matches;
  matches.references = {{"model's", PinholeCamera(), Rigid3()},
                        MakeReference(PoseCovariance::Zero()).image};
  matches.matches = {{0, {1, 1}, {320, 240}}, {1, {1, 1}, {320, 240}}};
  JoinedReferences joined(true);
  joined.Add(MakeReference(Diagonal(1e-6, 0)));
  joined.Weigh(matches);
  EXPECT_EQ(matches.matches[0].reference_sigma_px, std::nullopt);
  EXPECT_NEAR(*matches.matches[1].reference_sigma_px, 0.5, 1e-12);
  JoinedReferences trusted(false);
  trusted.Add(MakeReference(Diagonal(1e-6, 0)));
  trusted.Weigh(matches);
  EXPECT_EQ(matches.matches[1].reference_sigma_px, std::nullopt);
}

// Knows a point at depth 2 for every pixel.
class Wall final : public GeometrySource {
 public:
  std::string Description() const override { return "wall"; }
  std::vector<std::optional<SurfacePoint>> Lift(
      const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const override {
    std::vector<std::optional<SurfacePoint>> points;
    for (const Eigen::Vector2d& pixel : pixels) {
      const Eigen::Vector3d ray = *reference.camera.RayInCam(pixel);
      points.push_back(SurfacePoint{.point_in_world = 2 * ray,
                                    .normal_in_world = -ray,
                                    .depth_z = 2 * ray.z(),
                                    .incidence_deg = 0,
                                    .back_face = false});
    }
    return points;
  }
};

TEST(JoinedGeometry, LinksGoBeforeTheSource) {
  const auto joined = std::make_shared<JoinedReferences>(true);
  joined->Add(MakeReference(Diagonal(1e-6, 0)));
  const auto wall = std::make_shared<const Wall>();
  const JoinedGeometry geometry(wall, joined, JoinedGeometry::Links::kGive);
  const std::vector<Eigen::Vector2d> pixels = {{320, 240}, {321, 240}};
  const auto points = geometry.Lift(MakeReference(PoseCovariance::Zero()).image, pixels);
  EXPECT_EQ(points[0]->point_in_world, Eigen::Vector3d(0, 0, 5));
  EXPECT_EQ(points[0]->depth_z, 5);
  EXPECT_EQ(points[0]->point_sigma, std::nullopt);  // the pose was found by it, not it by the pose
  EXPECT_NEAR(points[1]->depth_z, 2, 1e-4);
  EXPECT_NEAR(*points[1]->point_sigma, 0.5 * 2 / 500, 1e-6);
  // The references of the model are the source's own.
  const auto others = geometry.Lift({"model's", PinholeCamera(), Rigid3()}, pixels);
  EXPECT_EQ(others[0]->depth_z, 2);
  EXPECT_EQ(others[0]->point_sigma, std::nullopt);
  const JoinedGeometry second(wall, joined, JoinedGeometry::Links::kLeaveOut);
  EXPECT_FALSE(second.Lift(MakeReference(PoseCovariance::Zero()).image, pixels)[0].has_value());
}

QueryResult Localize(const PoseProblem& problem) {
  QueryResult result;
  result.problem = problem;
  result.localized.estimate = MakePoseEstimator({})->Estimate(problem);
  return result;
}

TEST(JoinedReferences, LinksAreTheInliersOneForEachKeypoint) {
  SyntheticProblem synthetic = MakeRegime(RegimeByName("accurate"), 1).front();
  auto& matches = synthetic.problem.matches_2d3d;
  matches[1].query_px = matches[2].query_px = matches[0].query_px;
  // Three candidates along one ray: the middle one.
  const Eigen::Vector3d center = synthetic.query_from_world.OriginInSource();
  for (int i = 0; i < 3; ++i) {
    const double share[] = {1.0, 1.2, 1.1};
    const Eigen::Vector3d ray = synthetic.query_from_world.rotation.conjugate() *
                                *synthetic.problem.query_camera.RayInCam(matches[0].query_px);
    matches[static_cast<size_t>(i)].point_in_world = center + 8 * share[i] * ray;
  }
  const QueryResult result = Localize(synthetic.problem);
  std::map<double, Eigen::Vector3d> by_x;
  const std::vector<PointLink> links = LinksOfInliers(result);
  for (const PointLink& link : links) by_x.emplace(link.pixel.x(), link.point_in_world);
  EXPECT_EQ(by_x.size(), links.size());
  EXPECT_EQ(by_x.at(matches[0].query_px.x()), matches[2].point_in_world);
  EXPECT_EQ(static_cast<int>(links.size()), result.localized.estimate.score_2d3d.num_inliers - 2);
}

TEST(JoinedReferences, TheDistanceFollowsFromPointsOrFromRays) {
  SyntheticProblem synthetic = MakeRegime(RegimeByName("accurate"), 1).front();
  const double by_points = SceneDistance(Localize(synthetic.problem));
  EXPECT_GT(by_points, 5);
  EXPECT_LT(by_points, 15);
  synthetic.problem.matches_2d3d.clear();
  EXPECT_NEAR(SceneDistance(Localize(synthetic.problem)), by_points, 0.2 * by_points);
}

TEST(JoinedReferences, AQueryInheritsTheErrorsOfWhatItRestsOn) {
  SyntheticProblem synthetic = MakeRegime(RegimeByName("accurate"), 1).front();
  const QueryResult result = Localize(synthetic.problem);
  JoinedReferences joined(true);
  EXPECT_EQ(joined.PassedOn(result), PoseCovariance::Zero());
  // Were the references moved alike by a tenth, the query would go with them by as much as their
  // matches, two in three, hold it against the points.
  for (const PosedImage& reference : synthetic.problem.references) {
    joined.Add({reference, Diagonal(0, 0.01), 10, {}});
  }
  const PoseCovariance passed_on = joined.PassedOn(result);
  const double sigma = std::sqrt(passed_on.bottomRightCorner<3, 3>().trace() / 3);
  EXPECT_NEAR(sigma, 0.1 * 2 / 3, 0.01);
}

}  // namespace
}  // namespace raylift
