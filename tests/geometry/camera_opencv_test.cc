// OpenCV's projections as an independent reference for the models that come from it.

#include <cmath>
#include <fstream>
#include <sstream>

#include "support/matchers.h"
#include "support/test_data.h"
#include <gmock/gmock.h>

#include "raylift/base/text.h"
#include "raylift/geometry/camera.h"

namespace raylift {
namespace {

constexpr const char* kScript = R"(
import sys
import cv2
import numpy as np

kind, points_file = sys.argv[1:3]
params = [float(token) for token in sys.argv[3:]]
fx, fy, cx, cy = params[:4]
K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
points = np.loadtxt(points_file).reshape(-1, 1, 3)
project = cv2.fisheye.projectPoints if kind == "fisheye" else cv2.projectPoints
arguments = [np.zeros(3), np.zeros(3), K, np.array(params[4:])]
pixels = project(points, *arguments)[0].reshape(-1, 2)
for x, y in pixels:
    print("%.17g %.17g" % (x, y))
)";

std::vector<Eigen::Vector2d> ProjectByOpenCv(const std::string& kind, const Camera& camera,
                                             const std::vector<Eigen::Vector3d>& points) {
  const auto folder = TestFolder();
  std::ofstream(folder / "project.py") << kScript;
  {
    std::ofstream file(folder / "points.txt");
    for (const auto& point : points) {
      file << FormatDouble(point.x()) << ' ' << FormatDouble(point.y()) << ' '
           << FormatDouble(point.z()) << '\n';
    }
  }
  std::string command = "/usr/bin/python3 " + (folder / "project.py").string() + " " + kind + " " +
                        (folder / "points.txt").string();
  for (const double param : camera.params()) {
    command += " " + FormatDouble(param);
  }
  std::istringstream output(RunProgram(command));
  std::vector<Eigen::Vector2d> pixels;
  for (double x, y; output >> x >> y;) {
    pixels.emplace_back(x, y);
  }
  return pixels;
}

void ExpectSameAsOpenCv(const std::string& kind, const Camera& camera) {
  if (!HasProgram("/usr/bin/python3 -c 'import cv2, numpy'")) {
    GTEST_SKIP() << "OpenCV for Python is not on this machine";
  }
  Rng rng = TestRng();
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < 500; ++i) {
    const double z = std::exp(rng.Uniform(-2, 3));
    points.emplace_back(z * rng.Uniform(-0.7, 0.7), z * rng.Uniform(-0.6, 0.6), z);
  }
  const auto expected = ProjectByOpenCv(kind, camera, points);
  ASSERT_EQ(expected.size(), points.size());
  for (size_t i = 0; i < points.size(); ++i) {
    const auto pixel = camera.ImgFromCam(points[i]);
    ASSERT_TRUE(pixel) << points[i].transpose();
    EXPECT_LT((*pixel - expected[i]).norm(), 1e-9) << points[i].transpose();
  }
}

TEST(CameraAgainstOpenCv, OpenCv) {
  const std::vector<double> params = {500, 510, 315, 245, -0.28, 0.09, 0.002, -0.003};
  ExpectSameAsOpenCv("perspective", Camera(CameraModel::kOpenCv, 640, 480, params));
}

TEST(CameraAgainstOpenCv, FullOpenCv) {
  const std::vector<double> params = {500,   510,    315,  245, 0.4,   -0.1,
                                      0.001, -0.002, 0.02, 0.7, -0.05, 0.03};
  ExpectSameAsOpenCv("perspective", Camera(CameraModel::kFullOpenCv, 640, 480, params));
}

TEST(CameraAgainstOpenCv, OpenCvFisheye) {
  const std::vector<double> params = {260, 262, 320, 240, -0.01, 0.02, -0.008, 0.001};
  ExpectSameAsOpenCv("fisheye", Camera(CameraModel::kOpenCvFisheye, 640, 480, params));
}

}  // namespace
}  // namespace raylift
