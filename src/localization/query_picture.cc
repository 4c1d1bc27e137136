#include "raylift/localization/query_picture.h"

#include <cmath>
#include <vector>

#include "base/index_sets.h"
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "raylift/base/error.h"
#include "raylift/renderers/frame_renderer.h"

namespace raylift {
namespace {

// Fixed point pixels for OpenCV's anti-aliased drawing; its center of the first pixel is (0, 0).
constexpr int kShift = 4;
cv::Point FixedPoint(const Eigen::Vector2d& pixel) {
  return {static_cast<int>(std::lround((pixel.x() - 0.5) * (1 << kShift))),
          static_cast<int>(std::lround((pixel.y() - 0.5) * (1 << kShift)))};
}

void DrawMark(cv::Mat& canvas, const Eigen::Vector2d& pixel) {
  cv::circle(canvas, FixedPoint(pixel), 3 << kShift, cv::Scalar(20, 20, 20), 3, cv::LINE_AA,
             kShift);
  cv::circle(canvas, FixedPoint(pixel), 3 << kShift, cv::Scalar(255, 196, 40), 1, cv::LINE_AA,
             kShift);
}

// More marks would hide the picture.
constexpr size_t kMaxMarks = 150;

}  // namespace

Image DrawQueryPicture(const QueryResult& result, const Image& photograph, const RayCaster& mesh,
                       int threads) {
  const PoseProblem& problem = result.problem;
  const PoseEstimate& estimate = result.localized.estimate;
  RAYLIFT_CHECK(estimate.cam_from_world.has_value());
  const Camera& camera = problem.query_camera;
  ColorOptions colors;
  colors.samples_per_pixel_side = 2;
  colors.background_rgb = {222, 226, 232};
  if (!mesh.HasColors()) colors.shading = ColorOptions::Shading::kHeadlight;
  Image rendered = RenderColor(mesh, camera, *estimate.cam_from_world, colors, threads);

  const int width = camera.width_px();
  const int height = camera.height_px();
  Image picture{2 * width, height, 3,
                std::vector<uint8_t>(static_cast<size_t>(2) * width * height * 3)};
  cv::Mat canvas(height, 2 * width, CV_8UC3, picture.data.data());
  cv::Mat left = canvas.colRange(0, width);
  cv::Mat right = canvas.colRange(width, 2 * width);
  Image photo = photograph;
  cv::Mat(photo.height_px, photo.width_px, CV_8UC3, photo.data.data()).copyTo(left);
  cv::Mat(height, width, CV_8UC3, rendered.data.data()).copyTo(right);
  std::vector<size_t> inliers;
  for (size_t i = 0; i < problem.matches_2d3d.size(); ++i) {
    if (estimate.inliers_2d3d[i]) {
      inliers.push_back(i);
    }
  }
  for (const size_t i : EvenlySpaced(inliers.size(), kMaxMarks)) {
    const Match2D3D& match = problem.matches_2d3d[inliers[i]];
    DrawMark(left, match.query_px);
    if (const auto pixel = camera.ImgFromCam(*estimate.cam_from_world * match.point_in_world)) {
      DrawMark(right, *pixel);
    }
  }
  return picture;
}

}  // namespace raylift
