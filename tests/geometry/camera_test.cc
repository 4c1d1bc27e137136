#include "raylift/geometry/camera.h"

#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <set>
#include <sstream>

#include "geometry/test_cameras.h"
#include "support/matchers.h"

#include "raylift/base/error.h"

namespace raylift {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using enum CameraModel;

class EveryCamera : public ::testing::TestWithParam<TestCamera> {
 protected:
  const Camera& camera() const { return GetParam().camera; }

  // Pixels over the whole image, the corners included; but where a panorama's edges meet.
  std::vector<Vector2d> ImageGrid() const {
    const int begin = camera().is_panorama() ? 16 : 0;
    std::vector<Vector2d> pixels;
    for (int y = begin; y <= camera().height_px() - begin; y += 16) {
      for (int x = begin; x <= camera().width_px() - begin; x += 16) {
        pixels.emplace_back(x, y);
      }
    }
    return pixels;
  }
};

INSTANTIATE_TEST_SUITE_P(Models, EveryCamera, ::testing::ValuesIn(TypicalCameras()),
                         [](const auto& test) { return test.param.name; });

TEST_P(EveryCamera, PixelToRayToPixelIsExactOverTheWholeImage) {
  for (const Vector2d& pixel : ImageGrid()) {
    const auto ray = camera().RayInCam(pixel);
    ASSERT_TRUE(ray) << pixel.transpose();
    EXPECT_NEAR(ray->norm(), 1, 1e-14);
    const auto again = camera().ImgFromCam(*ray);
    ASSERT_TRUE(again) << pixel.transpose();
    EXPECT_LT((*again - pixel).norm(), 1e-10 * camera().MeanFocalPx()) << pixel.transpose();
  }
}

TEST_P(EveryCamera, RayToPixelToRayIsExactAtAnyDistance) {
  Rng rng = TestRng();
  for (const Vector2d& pixel : ImageGrid()) {
    const Vector3d ray = camera().RayInCam(pixel).value();
    const auto projected = camera().ImgFromCam(std::exp(rng.Uniform(-5, 5)) * ray);
    ASSERT_TRUE(projected);
    const auto again = camera().RayInCam(*projected);
    ASSERT_TRUE(again);
    EXPECT_LT((*again - ray).norm(), 1e-10);
  }
}

TEST_P(EveryCamera, JacobianMatchesCentralDifferences) {
  Rng rng = TestRng();
  for (const Vector2d& pixel : ImageGrid()) {
    const double distance = std::exp(rng.Uniform(-1, 2));
    const Vector3d point = distance * camera().RayInCam(pixel).value();
    const auto projection = camera().ImgFromCamWithJacobian(point);
    ASSERT_TRUE(projection);
    EXPECT_EQ(projection->pixel, camera().ImgFromCam(point));
    const double step = 1e-5 * distance;
    for (int i = 0; i < 3; ++i) {
      const Vector3d offset = step * Vector3d::Unit(i);
      const Vector2d difference = (camera().ImgFromCam(point + offset).value() -
                                   camera().ImgFromCam(point - offset).value()) /
                                  (2 * step);
      // Differences are good to about step^2 and eps / step of the largest derivative.
      EXPECT_LT((projection->jacobian.col(i) - difference).norm(),
                1e-7 * (1 + projection->jacobian.norm()))
          << pixel.transpose() << ", column " << i;
    }
  }
}

TEST_P(EveryCamera, AxisFallsOnThePrincipalPoint) {
  const auto projection = camera().ImgFromCamWithJacobian({0, 0, 2});
  ASSERT_TRUE(projection);
  EXPECT_EQ(projection->pixel, camera().principal_point_px());
  EXPECT_TRUE(projection->jacobian.allFinite());
  EXPECT_EQ(camera().RayInCam(camera().principal_point_px()), Vector3d(0, 0, 1));
}

TEST_P(EveryCamera, NeverGivesNonFiniteNumbers) {
  const double kInf = std::numeric_limits<double>::infinity();
  const double kNan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<double> values = {0,     -0.0,   1,    -1,    1e-320, 1e-200, -1e-200,
                                      1e200, -1e300, kInf, -kInf, kNan,   1e6};
  for (const double x : values) {
    for (const double y : values) {
      if (const auto ray = camera().RayInCam({x, y})) {
        EXPECT_TRUE(ray->allFinite()) << x << " " << y;
        EXPECT_NEAR(ray->norm(), 1, 1e-9) << x << " " << y;
      }
      for (const double z : values) {
        const Vector3d point(x, y, z);
        if (const auto pixel = camera().ImgFromCam(point)) {
          EXPECT_TRUE(pixel->allFinite()) << point.transpose();
        }
        if (const auto projection = camera().ImgFromCamWithJacobian(point)) {
          EXPECT_TRUE(projection->pixel.allFinite()) << point.transpose();
          EXPECT_TRUE(projection->jacobian.allFinite()) << point.transpose();
        }
      }
    }
  }
}

// Whatever projects has a ray, and it is the point's: the valid domain is one-to-one.
TEST_P(EveryCamera, WhatProjectsHasItsRay) {
  Rng rng = TestRng();
  int projected = 0;
  for (int i = 0; i < 3000; ++i) {
    const Vector3d direction = Vector3d(rng.Normal(), rng.Normal(), rng.Normal()).normalized();
    const auto pixel = camera().ImgFromCam(direction);
    if (!pixel) continue;
    ++projected;
    const auto ray = camera().RayInCam(*pixel);
    ASSERT_TRUE(ray) << direction.transpose();
    const auto again = camera().ImgFromCam(*ray);
    ASSERT_TRUE(again) << direction.transpose();
    // Relative, as far from the axis the pixels run to infinity; the distance in rays is bounded
    // by 1e-6 only because the pixel hardly moves close to where the lens folds.
    EXPECT_LT((*again - *pixel).norm(), 1e-9 * (1 + pixel->norm())) << direction.transpose();
    EXPECT_LT((*ray - direction).norm(), 1e-6) << direction.transpose();
  }
  EXPECT_GT(projected, 100);
}

TEST_P(EveryCamera, ScalingTheImageScalesThePixels) {
  for (const auto& [width, height] : {std::pair(1280, 960), {320, 240}, {213, 160}, {700, 333}}) {
    const Camera scaled = camera().Scaled(width, height);
    EXPECT_EQ(scaled.width_px(), width);
    EXPECT_EQ(scaled.height_px(), height);
    const Vector2d ratio(width / 640., height / 480.);
    for (const Vector2d& pixel : ImageGrid()) {
      const Vector3d ray = camera().RayInCam(pixel).value();
      const Vector2d expected = ratio.cwiseProduct(camera().ImgFromCam(ray).value());
      EXPECT_LT((scaled.ImgFromCam(ray).value() - expected).norm(), 1e-11);
    }
  }
}

TEST_P(EveryCamera, TextNamesModelSizeAndParameters) {
  std::vector<std::string> tokens;
  std::istringstream text(camera().ToString());
  for (std::string token; text >> token;) tokens.push_back(token);
  ASSERT_EQ(tokens.size(), 3 + camera().params().size());
  EXPECT_EQ(CameraModelFromName(tokens[0]), camera().model());
  EXPECT_EQ(tokens[1], "640");
  EXPECT_EQ(tokens[2], "480");
  for (size_t i = 0; i < camera().params().size(); ++i) {
    EXPECT_EQ(std::stod(tokens[3 + i]), camera().params()[i]);
  }
}

TEST_P(EveryCamera, RefusesBadParameters) {
  const std::string name(GetCameraModelInfo(camera().model()).name);
  const std::vector<double> good(camera().params().begin(), camera().params().end());
  const auto make = [&](int width, int height, const std::vector<double>& params) {
    return [&, width, height, params] { Camera(camera().model(), width, height, params); };
  };
  std::vector<double> params = good;
  params.push_back(0);
  EXPECT_TRUE(FailsWithInputError(
      make(640, 480, params), {name, std::to_string(good.size()), std::to_string(params.size())}));
  EXPECT_TRUE(FailsWithInputError(make(640, 480, {}), {name, "found 0"}));
  EXPECT_TRUE(FailsWithInputError(make(0, 480, good), {name, "0 x 480"}));
  EXPECT_TRUE(FailsWithInputError(make(640, -1, good), {name, "640 x -1"}));
  for (size_t i = 0; i < good.size(); ++i) {
    for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
      params = good;
      params[i] = bad;
      EXPECT_TRUE(FailsWithInputError(make(640, 480, params), {name, "finite"}));
    }
  }
  for (const double bad : {0., -500.}) {
    params = good;
    params[0] = bad;
    EXPECT_TRUE(FailsWithInputError(
        make(640, 480, params),
        {name, camera().is_panorama() ? "positive width and height" : "positive focal length"}));
  }
}

TEST(TypicalCameras, CoverEveryModel) {
  std::set<CameraModel> covered;
  for (const TestCamera& test : TypicalCameras()) {
    covered.insert(test.camera.model());
  }
  EXPECT_EQ(covered.size(), AllCameraModels().size());
}

TEST(CameraModels, NamesAndIdsAreColmaps) {
  EXPECT_EQ(AllCameraModels().size(), 18u);
  for (const CameraModelInfo& info : AllCameraModels()) {
    EXPECT_EQ(CameraModelFromName(info.name), info.model);
    EXPECT_EQ(CameraModelFromId(static_cast<int>(info.model)), info.model);
    EXPECT_EQ(GetCameraModelInfo(info.model).name, info.name);
    EXPECT_LE(info.num_params, kMaxCameraParams);
  }
  EXPECT_EQ(CameraModelFromId(4), kOpenCv);
  EXPECT_EQ(CameraModelFromName("THIN_PRISM_FISHEYE"), kThinPrismFisheye);
  EXPECT_FALSE(CameraModelFromName("pinhole"));
  EXPECT_EQ(CameraModelFromId(16), kEucm);
  EXPECT_EQ(CameraModelFromId(17), kEquirectangular);
  EXPECT_FALSE(CameraModelFromId(18));
  EXPECT_FALSE(CameraModelFromId(-1));
}

TEST(Camera, DefaultIsOnePixelWide) {
  const Camera camera;
  EXPECT_EQ(camera, Camera(kPinhole, 1, 1, std::array{1., 1., 0.5, 0.5}));
  EXPECT_EQ(camera.ImgFromCam({1, 2, 2}), Vector2d(1, 1.5));
}

TEST(Camera, ComparesModelSizeAndParameters) {
  const Camera camera(kSimpleRadial, 640, 480, std::array{500., 320., 240., 0.1});
  EXPECT_EQ(camera, Camera(kSimpleRadial, 640, 480, std::array{500., 320., 240., 0.1}));
  EXPECT_NE(camera, Camera(kSimpleRadial, 640, 481, std::array{500., 320., 240., 0.1}));
  EXPECT_NE(camera, Camera(kSimpleRadial, 640, 480, std::array{500., 320., 240., 0.2}));
  EXPECT_NE(camera, Camera(kSimpleDivision, 640, 480, std::array{500., 320., 240., 0.1}));
}

TEST(Camera, ContainsItsRectangle) {
  const Camera camera(kSimplePinhole, 640, 480, std::array{500., 320., 240.});
  EXPECT_TRUE(camera.Contains({0, 0}));
  EXPECT_TRUE(camera.Contains({640, 480}));
  EXPECT_FALSE(camera.Contains({-1e-9, 5}));
  EXPECT_FALSE(camera.Contains({5, 480.001}));
  EXPECT_FALSE(camera.Contains({std::nan(""), 5}));
}

TEST(Camera, ScalingKeepsTheModelWhereTheRatiosAgree) {
  const Camera camera(kSimpleRadial, 640, 480, std::array{500., 320., 240., 0.1});
  EXPECT_EQ(camera.Scaled(1280, 960),
            Camera(kSimpleRadial, 1280, 960, std::array{1000., 640., 480., 0.1}));
  EXPECT_EQ(camera.Scaled(1280, 480),
            Camera(kOpenCv, 1280, 480, std::array{1000., 500., 640., 240., 0.1, 0., 0., 0.}));
}

TEST(Camera, PerspectiveSeesNothingBehind) {
  for (const TestCamera& test : TypicalCameras()) {
    const auto pixel = test.camera.ImgFromCam({0, 0, -1});
    EXPECT_EQ(pixel.has_value(), test.camera.is_panorama()) << test.name;
    EXPECT_FALSE(test.camera.ImgFromCam({0, 0, 0})) << test.name;
  }
  const Camera pinhole(kSimplePinhole, 640, 480, std::array{500., 320., 240.});
  EXPECT_FALSE(pinhole.ImgFromCam({1, 1, -1}));
  EXPECT_FALSE(pinhole.ImgFromCam({1, 1, 0}));
}

TEST(Camera, FisheyePixelsAreAnglesBeyondNinetyDegrees) {
  const Camera camera(kSimpleFisheye, 640, 640, std::array{100., 320., 320.});
  for (const double deg : {0.0, 1e-9, 10., 89., 90., 91., 135., 179.}) {
    const double angle = deg * std::numbers::pi / 180;
    const auto pixel = camera.ImgFromCam({3 * std::sin(angle), 0, 3 * std::cos(angle)});
    ASSERT_TRUE(pixel) << deg;
    EXPECT_NEAR(pixel->x(), 320 + 100 * angle, 1e-12 * 320) << deg;
    EXPECT_EQ(pixel->y(), 320) << deg;
  }
  EXPECT_FALSE(camera.RayInCam({320 + 100 * 3.15, 320}));
  EXPECT_FALSE(camera.ImgFromCam({0, 0, -1}));
}

TEST(Camera, FisheyeFoldsAtItsFirstCriticalAngle) {
  // theta - theta^3 / 6 has its maximum, sqrt(8) / 3, at theta = sqrt(2) (81 degrees).
  const Camera camera(kSimpleRadialFisheye, 640, 640, std::array{300., 320., 320., -1. / 6});
  const auto point = [](double angle) { return Vector3d(0, std::sin(angle), std::cos(angle)); };
  EXPECT_TRUE(camera.ImgFromCam(point(std::sqrt(2.) - 1e-6)));
  EXPECT_FALSE(camera.ImgFromCam(point(std::sqrt(2.) + 1e-6)));
  EXPECT_FALSE(camera.ImgFromCam(point(3)));
  const double max_radius_px = 300 * std::sqrt(8.) / 3;
  EXPECT_TRUE(camera.RayInCam({320 + max_radius_px - 1e-6, 320}));
  EXPECT_FALSE(camera.RayInCam({320 + max_radius_px + 1e-6, 320}));
}

TEST(Camera, BarrelDistortionFoldsAtItsFirstMaximum) {
  // r - r^3 / 12 has its maximum, 4 / 3, at r = 2.
  const Camera camera(kSimpleRadial, 640, 480, std::array{100., 320., 240., -1. / 12});
  EXPECT_TRUE(camera.ImgFromCam({0, 2 - 1e-6, 1}));
  EXPECT_FALSE(camera.ImgFromCam({0, 2 + 1e-6, 1}));
  // Beyond sqrt(12) the polynomial is negative: the naive projection would land in the image again.
  EXPECT_FALSE(camera.ImgFromCam({0, 3.6, 1}));
  EXPECT_TRUE(camera.RayInCam({320 + 400. / 3 - 1e-6, 240}));
  EXPECT_FALSE(camera.RayInCam({320 + 400. / 3 + 1e-6, 240}));
  const auto near_fold = camera.RayInCam({320 + 400. / 3 - 1e-9, 240});
  ASSERT_TRUE(near_fold);
  EXPECT_NEAR(near_fold->x() / near_fold->z(), 2, 1e-5);
}

TEST(Camera, RationalDistortionStopsAtItsPole) {
  // 1 / (1 - r^2): the distorted radius runs to infinity at r = 1.
  const Camera camera(kFullOpenCv, 640, 480,
                      std::array{100., 100., 320., 240., 0., 0., 0., 0., 0., -1., 0., 0.});
  EXPECT_TRUE(camera.ImgFromCam({0.999, 0, 1}));
  EXPECT_FALSE(camera.ImgFromCam({1.001, 0, 1}));
  const auto far = camera.RayInCam({320 + 1e7, 240});
  ASSERT_TRUE(far);
  EXPECT_NEAR(far->x() / far->z(), 1, 1e-5);
}

TEST(Camera, DivisionModelIsItsClosedForm) {
  const double k = -0.3;
  const Camera camera(kSimpleDivision, 640, 480, std::array{400., 320., 240., k});
  const Vector2d pixel(20, 400);
  const Vector2d u = (pixel - Vector2d(320, 240)) / 400;
  const Vector3d expected = Vector3d(u.x(), u.y(), 1 + k * u.squaredNorm()).normalized();
  EXPECT_LT((camera.RayInCam(pixel).value() - expected).norm(), 1e-15);
  EXPECT_LT((camera.ImgFromCam(7 * expected).value() - pixel).norm(), 1e-11);
  // Beyond |u|^2 = 1 / 0.3 the ray points backwards and still projects.
  const Vector2d wide(320 + 400 * 2, 240);
  const auto backwards = camera.RayInCam(wide);
  ASSERT_TRUE(backwards);
  EXPECT_LT(backwards->z(), 0);
  EXPECT_LT((camera.ImgFromCam(*backwards).value() - wide).norm(), 1e-10);
  // k > 0 folds at |u| = 1 / sqrt(k).
  const Camera pincushion(kSimpleDivision, 640, 480, std::array{100., 320., 240., 0.25});
  EXPECT_TRUE(pincushion.RayInCam({320 + 199.9, 240}));
  EXPECT_FALSE(pincushion.RayInCam({320 + 200.1, 240}));
  EXPECT_FALSE(pincushion.ImgFromCam({1.001, 0, 1}));
}

TEST(Camera, FovModelIsItsClosedForm) {
  const double omega = 0.8;
  const Camera camera(kFov, 640, 480, std::array{400., 400., 320., 240., omega});
  for (const double r : {1e-8, 1e-3, 0.02, 0.05, 0.5, 10.}) {
    const double expected = std::atan(2 * r * std::tan(omega / 2)) / omega;
    EXPECT_NEAR(camera.ImgFromCam({r, 0, 1})->x(), 320 + 400 * expected, 1e-11);
  }
  EXPECT_FALSE(camera.RayInCam({320 + 400 * (std::numbers::pi / 2 / omega) + 1e-6, 240}));
  // COLMAP accepts any omega; with half a turn or more there is no image.
  const Camera senseless(kFov, 640, 480, std::array{400., 400., 320., 240., 3.5});
  EXPECT_FALSE(senseless.ImgFromCam({0.1, 0, 1}));
  EXPECT_FALSE(senseless.RayInCam({330, 240}));
}

// COLMAP 4.1, src/colmap/sensor/models/eucm.h; Khomutenko, Garcia, Martinet (2016), eq. 3 and 6.
TEST(Camera, EnhancedUnifiedModelIsItsClosedForm) {
  const double alpha = 0.7, beta = 1.2;
  const Camera camera(kEucm, 640, 480, std::array{300., 310., 320., 240., alpha, beta});
  const Vector3d point(0.7, -0.4, 1.3);
  const double rho = std::sqrt(beta * (0.7 * 0.7 + 0.4 * 0.4) + 1.3 * 1.3);
  const double denominator = alpha * rho + (1 - alpha) * 1.3;
  EXPECT_NEAR((camera.ImgFromCam(point).value() -
               Vector2d(320 + 300 * 0.7 / denominator, 240 - 310 * 0.4 / denominator))
                  .norm(),
              0, 1e-12);
  EXPECT_LT((camera.RayInCam(*camera.ImgFromCam(point)).value() - point.normalized()).norm(),
            1e-14);
  // Where beta is 1, the fold is at z = -rho (1 - alpha) / alpha: 115 degrees off the axis.
  const Camera unit(kEucm, 640, 480, std::array{300., 300., 320., 240., alpha, 1.});
  const double fold = std::acos(-(1 - alpha) / alpha);
  const auto at = [](double angle) { return Vector3d(std::sin(angle), 0, std::cos(angle)); };
  EXPECT_TRUE(unit.ImgFromCam(at(fold - 1e-6)));
  EXPECT_FALSE(unit.ImgFromCam(at(fold + 1e-6)));
  const double max_radius_px = 300 / std::sqrt(2 * alpha - 1);
  EXPECT_TRUE(unit.RayInCam({320 + max_radius_px - 1e-6, 240}));
  EXPECT_FALSE(unit.RayInCam({320 + max_radius_px + 1e-6, 240}));
  // Without alpha it is a pinhole; outside of its parameters' ranges there is no image.
  const Camera pinhole(kEucm, 640, 480, std::array{300., 300., 320., 240., 0., 1.3});
  EXPECT_NEAR((pinhole.ImgFromCam({1, 2, 4}).value() - Vector2d(395, 390)).norm(), 0, 1e-12);
  for (const auto& [bad_alpha, bad_beta] :
       {std::pair(-0.1, 1.), {1.1, 1.}, {0.5, 0.}, {0.5, -1.}}) {
    const Camera senseless(kEucm, 640, 480,
                           std::array{300., 300., 320., 240., bad_alpha, bad_beta});
    EXPECT_FALSE(senseless.ImgFromCam({0, 0, 1}));
    EXPECT_FALSE(senseless.RayInCam({320, 240}));
  }
}

// COLMAP 4.1, src/colmap/sensor/models/spherical.h: +x is a quarter of the image to the right of
// the middle, -y is the upper edge, and -z lies on both sides.
TEST(Camera, PanoramasSeeAllAround) {
  const Camera camera(kEquirectangular, 800, 400, std::array{800., 400.});
  EXPECT_EQ(camera.ToString(), "EQUIRECTANGULAR 800 400 800 400");
  const auto pixel = [&](double x, double y, double z) { return *camera.ImgFromCam({x, y, z}); };
  EXPECT_LT((pixel(0, 0, 2) - Vector2d(400, 200)).norm(), 1e-12);
  EXPECT_LT((pixel(2, 0, 0) - Vector2d(600, 200)).norm(), 1e-12);
  EXPECT_LT((pixel(-2, 0, 0) - Vector2d(200, 200)).norm(), 1e-12);
  EXPECT_LT((pixel(1, 0, -1) - Vector2d(700, 200)).norm(), 1e-12);
  EXPECT_NEAR(pixel(0, -3, 0).y(), 0, 1e-12);
  EXPECT_LT((pixel(1, std::sqrt(2.), 1) - Vector2d(500, 300)).norm(), 1e-12);
  EXPECT_LT((*camera.RayInCam({0, 200}) - Vector3d(0, 0, -1)).norm(), 1e-14);
  EXPECT_LT((*camera.RayInCam({800, 200}) - Vector3d(0, 0, -1)).norm(), 1e-14);
  EXPECT_LT((*camera.RayInCam({123, 400}) - Vector3d(0, 1, 0)).norm(), 1e-14);
  EXPECT_FALSE(camera.RayInCam({800.01, 200}));
  EXPECT_FALSE(camera.RayInCam({400, -0.01}));
  EXPECT_EQ(camera.Scaled(400, 300), Camera(kEquirectangular, 400, 300, std::array{400., 300.}));
  EXPECT_EQ(camera.DepthOf({2, 1, -2}), 3);
  EXPECT_EQ(Camera().DepthOf({2, 1, -2}), -2);
}

// Random, often absurd coefficients: what a projection gives, its inverse finds.
TEST(Camera, AbsurdDistortionStaysInvertible) {
  Rng rng = TestRng();
  int projected = 0;
  for (const CameraModelInfo& info : AllCameraModels()) {
    for (int trial = 0; trial < 300; ++trial) {
      std::vector<double> params(static_cast<size_t>(info.num_params), 100);
      for (size_t i = static_cast<size_t>(info.num_focal_lengths) + 2; i < params.size(); ++i) {
        params[i] = rng.Normal() * std::pow(10., rng.Uniform(-4, 0));
      }
      const Camera camera(info.model, 200, 200, params);
      for (int i = 0; i < 20; ++i) {
        const Vector3d point(rng.Uniform(-2, 2), rng.Uniform(-2, 2), rng.Uniform(-0.2, 2));
        const auto pixel = camera.ImgFromCam(point);
        // No image is wider than twenty focal lengths.
        if (!pixel || (*pixel - camera.principal_point_px()).norm() > 10 * 100) continue;
        ++projected;
        const auto ray = camera.RayInCam(*pixel);
        ASSERT_TRUE(ray) << camera.ToString() << ": " << point.transpose();
        EXPECT_LT((camera.ImgFromCam(*ray).value() - *pixel).norm(), 1e-8)
            << camera.ToString() << ": " << point.transpose();
      }
    }
  }
  EXPECT_GT(projected, 10000);
}

}  // namespace
}  // namespace raylift
