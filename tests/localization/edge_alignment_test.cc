#include <algorithm>
#include <filesystem>
#include <memory>
#include <numbers>

#include "features/cv_image.h"
#include "localization/alignment/edge_aligner.h"
#include "localization/alignment/edge_image.h"
#include "localization/alignment/edge_search.h"
#include "localization/alignment/edge_turns.h"
#include "localization/alignment/scene_edges.h"
#include "support/meshes.h"
#include "support/test_data.h"
#include "views/mesh_scene.h"
#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include "raylift/base/error.h"
#include "raylift/io/image_file.h"
#include "raylift/io/query_list.h"
#include "raylift/localization/scene.h"

namespace raylift {
namespace {

Camera Pinhole() {
  const double params[] = {100, 80, 60};
  return {CameraModel::kSimplePinhole, 160, 120, params};
}

// Black to the left of x, white to the right of it, the pixel that it lies in in between.
Image StepAt(double x, int width_px, int height_px) {
  Image image{width_px, height_px, 1, {}};
  for (int row = 0; row < height_px; ++row) {
    for (int column = 0; column < width_px; ++column) {
      image.data.push_back(NearestByte(255 * std::clamp(column + 1 - x, 0.0, 1.0)));
    }
  }
  return image;
}

TEST(EdgeImage, AStepIsAnEdgeThereAndAcrossItAlone) {
  const EdgeImage image(StepAt(70.3, 160, 120), Pinhole(), 1);
  ASSERT_GT(image.edges().size(), 100u);
  // The parabola through three magnitudes of a step is off by some tenth of a pixel.
  for (const EdgePixel& edge : image.edges()) EXPECT_NEAR(edge.position_px.x(), 70.3, 0.15);
  const Eigen::Vector2d across(1, 0);
  EXPECT_GT(image.Evidence({70.3, 60}, across), 1);
  EXPECT_LT(image.Evidence({80, 60}, across), -0.9);
  EXPECT_LT(image.Evidence({70.3, 60}, {0, 1}), -0.9);
  EXPECT_EQ(image.Evidence({-1, 60}, across), 0);
  const auto near = image.NearestAlong({68, 60}, across, 4);
  ASSERT_TRUE(near);
  EXPECT_NEAR(near->position_px.x(), 70.3, 0.15);
  EXPECT_FALSE(image.NearestAlong({68, 60}, {0, 1}, 4));
  EXPECT_FALSE(image.NearestAlong({60, 60}, across, 4));
}

TEST(SceneEdges, OfABoxLieOnItsOutlineAndItsCreases) {
  const Eigen::Vector3d half(1, 0.8, 0.6);
  const auto mesh = std::make_shared<const RayCaster>(
      std::make_shared<const TriangleMesh>(MakeBox(Eigen::Vector3d::Zero(), half)));
  const Rigid3 pose = LookAt({2.5, -2, -3}, Eigen::Vector3d::Zero());
  const PixelRays rays(Pinhole(), 1);
  Frame frame;
  FrameRenderer(mesh, FrameOfEdges()).Render(rays, pose, 1, frame);
  const std::vector<SceneEdge> edges = SceneEdges(frame, rays, pose, 10000);
  ASSERT_GT(edges.size(), 200u);
  int creases = 0;
  for (const SceneEdge& edge : edges) {
    // On an edge of a box two coordinates are at their limits. A pixel is 4 cm wide there,
    // and wider on a face that is seen from aside.
    const Eigen::Array3d inside = half.array() - edge.point_in_world.array().abs();
    const int at_limits = static_cast<int>((inside.abs() < 0.15).count());
    EXPECT_GE(at_limits, 2) << edge.point_in_world.transpose();
    creases += edge.kind == SceneEdgeKind::kCrease ? 1 : 0;
  }
  EXPECT_GT(creases, 30);
}

// A white box before black.
TEST(EdgeTurns, FindTheTurnOfABox) {
  const auto mesh = std::make_shared<const RayCaster>(std::make_shared<const TriangleMesh>(
      MakeBox(Eigen::Vector3d::Zero(), Eigen::Vector3d(1, 0.8, 0.6))));
  const Rigid3 pose = LookAt({2.5, -2, -3}, Eigen::Vector3d::Zero());
  const PixelRays rays(Pinhole(), 1);
  FrameOptions options = FrameOfEdges();
  options.mask = true;
  Frame frame;
  FrameRenderer(mesh, options).Render(rays, pose, 1, frame);
  const EdgeImage image(frame.mask, Pinhole(), 1);
  EXPECT_THROW(EdgeTurns(image, 1, std::numbers::pi), InputError);
  EXPECT_THROW(EdgeTurns(image, 1, 1e300), InputError);
  const EdgeTurns turns(image, 1, 0.2);
  EXPECT_GT(turns.NumTried(), 1000u);
  const std::vector<SceneEdge> edges = SceneEdges(frame, rays, pose, 10000);
  const Eigen::Quaterniond turn = RotationFromVector({0.06, -0.1, 0.08});
  const Eigen::Quaterniond turned = turn * pose.rotation;
  const auto found = turns.BestOfWindows(edges, {turned, -(turned * pose.OriginInSource())});
  const auto best = std::max_element(
      found.begin(), found.end(), [](const auto& a, const auto& b) { return a.score < b.score; });
  ASSERT_NE(best, found.end());
  // A pixel is 0.6 degrees wide; the roll has steps of 2.3.
  EXPECT_LT(AngleBetweenDeg(best->cam_from_world.rotation, pose.rotation), 2);
  EXPECT_LT((best->cam_from_world.OriginInSource() - pose.OriginInSource()).norm(), 1e-9);
  const auto near = turns.BestOfWindow(edges, best->cam_from_world);
  EXPECT_GT(near.score, 0.9 * best->score);
}

// The demo's mesh, of whose textures alignment by edges sees nothing.
class DemoAlignment : public testing::Test {
 protected:
  PoseEstimate Align(const Eigen::Vector3d& turn_deg, const Eigen::Vector3d& shift,
                     double sigma_m = 0.3, double sigma_deg = 2, size_t index = 1) {
    static const MeshScene mesh = LoadMeshScene({"mesh:" + (DemoFolder() / "scene.obj").string()});
    const Query query = ReadQueryList(DemoFolder() / "queries.txt").at(index);
    truth_ = PosesOf(LoadReferences(DemoFolder() / "ground_truth").references).at(query.name);
    if (roll_deg_ != 0) RollCamera(query);
    const Eigen::Quaterniond rotation =
        RotationFromVector(turn_deg * std::numbers::pi / 180) * truth_.rotation;
    PoseProblem problem;
    problem.name = query.name;
    problem.query_camera = query.camera;
    problem.priors.position = {.position = truth_.OriginInSource() + shift,
                               .sigma = Eigen::Vector3d::Constant(sigma_m)};
    problem.priors.orientation = {.cam_from_world = rotation, .sigma_deg = sigma_deg};
    return EdgeAligner(mesh.caster, photographs_, 1).Estimate(problem);
  }
  Rigid3 truth_;
  double roll_deg_ = 0;

 private:
  // Turns the photograph about its principal point, as its camera about its axis: its lens has one
  // focal length and is distorted radially.
  void RollCamera(const Query& query) {
    ASSERT_EQ(query.camera.model(), CameraModel::kSimpleRadial);
    Image image = ReadImage(DemoFolder() / "images" / query.name, ImageChannels::kGray);
    const auto params = query.camera.params();
    const cv::Point2d principal_point(params[1] - 0.5, params[2] - 0.5);
    const cv::Mat photograph = AsMat(image).clone();
    cv::Mat rolled(image.height_px, image.width_px, CV_8U, image.data.data());
    cv::warpAffine(photograph, rolled, cv::getRotationMatrix2D(principal_point, -roll_deg_, 1),
                   rolled.size(), cv::INTER_LINEAR, cv::BORDER_REPLICATE);
    photographs_ = TestFolder();
    std::filesystem::create_directories((photographs_ / query.name).parent_path());
    WriteImage(photographs_ / query.name, image, 100);
    const Eigen::AngleAxisd roll(roll_deg_ * std::numbers::pi / 180, Eigen::Vector3d::UnitZ());
    truth_ = Rigid3{Eigen::Quaterniond(roll), Eigen::Vector3d::Zero()} * truth_;
  }
  std::filesystem::path photographs_ = DemoFolder() / "images";
};

TEST_F(DemoAlignment, FromAPriorNearByIsExactAndSure) {
  const PoseEstimate estimate = Align({2, -1, 1}, {0.2, -0.3, 0.1});
  ASSERT_TRUE(estimate.cam_from_world && estimate.covariance);
  EXPECT_EQ(estimate.verdict, PoseVerdict::kLocalized);
  EXPECT_LT((estimate.cam_from_world->OriginInSource() - truth_.OriginInSource()).norm(), 0.03);
  EXPECT_LT(AngleBetweenDeg(estimate.cam_from_world->rotation, truth_.rotation), 0.2);
}

TEST_F(DemoAlignment, IsTheSameAgain) {
  const PoseEstimate estimate = Align({2, -1, 1}, {0.2, -0.3, 0.1});
  const PoseEstimate again = Align({2, -1, 1}, {0.2, -0.3, 0.1});
  ASSERT_TRUE(estimate.cam_from_world && again.cam_from_world);
  EXPECT_EQ(again.cam_from_world->translation, estimate.cam_from_world->translation);
}

// Where half of the cells speak for each of two modes as clearly, each is right or not with equal
// odds; one that no cell speaks for is none, and one within the best one's covariance no other.
TEST(AlternativesOf, AreModesElsewhereThatExplainThePhotographAsWell) {
  const auto mode = [](double x, CellScores cells) {
    EdgeMode made;
    made.fit.cam_from_world.translation.x() = x;
    made.fit.covariance = 1e-4 * Eigen::Matrix<double, 6, 6>::Identity();
    made.cells = std::move(cells);
    return made;
  };
  CellScores best = CellScores::Constant(2);
  best.tail(kNumCells / 2).setConstant(4);
  const FoundByEdges found{
      {mode(0, best), mode(0.02, best.reverse()), mode(3, 0 * best), mode(1, best.reverse())}, 0.1};
  const std::vector<AlternativePose> alternatives = AlternativesOf(found);
  ASSERT_EQ(alternatives.size(), 1U);
  EXPECT_EQ(alternatives[0].cam_from_world.translation.x(), 1);
  EXPECT_NEAR(alternatives[0].probability, 0.45, 1e-6);
  EXPECT_NEAR(ConfidenceOf(found), 0.45, 1e-6);
}

// Its few edges are in few cells; what the mirrored photograph shows by chance is far less.
TEST_F(DemoAlignment, FewEdgesAreEnoughWhereChanceShowsFewer) {
  const PoseEstimate estimate = Align({2, -1, 1}, {0.2, -0.3, 0.1}, 0.3, 2, 11);
  ASSERT_TRUE(estimate.cam_from_world);
  EXPECT_EQ(estimate.verdict, PoseVerdict::kLocalized);
  EXPECT_LT((estimate.cam_from_world->OriginInSource() - truth_.OriginInSource()).norm(), 0.03);
}

TEST_F(DemoAlignment, FromAPriorFurtherOffIsAsExact) {
  const PoseEstimate estimate = Align({7, -6, 5}, {0.9, -1.1, 0.6}, 1, 5);
  ASSERT_TRUE(estimate.cam_from_world);
  EXPECT_LT((estimate.cam_from_world->OriginInSource() - truth_.OriginInSource()).norm(), 0.03);
  EXPECT_LT(AngleBetweenDeg(estimate.cam_from_world->rotation, truth_.rotation), 0.2);
}

TEST_F(DemoAlignment, FromAPriorSomewhereElseIsNotSure) {
  for (const Eigen::Vector3d& shift : {Eigen::Vector3d(4, 0, 0), Eigen::Vector3d(0, 20, 0)}) {
    EXPECT_NE(Align({0, 0, 0}, shift).verdict, PoseVerdict::kLocalized);
  }
}

TEST_F(DemoAlignment, ARolledCameraIsNotSureFromAPriorSomewhereElse) {
  roll_deg_ = 25;
  const PoseEstimate estimate = Align({2, -1, 1}, {0.2, -0.3, 0.1});
  ASSERT_TRUE(estimate.cam_from_world);
  EXPECT_LT((estimate.cam_from_world->OriginInSource() - truth_.OriginInSource()).norm(), 0.03);
  EXPECT_NE(Align({0, 0, 0}, {4, 0, 0}).verdict, PoseVerdict::kLocalized);
}

}  // namespace
}  // namespace raylift
