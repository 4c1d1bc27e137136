#include "localization/patch_alignment.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "features/cv_image.h"
#include <Eigen/LU>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace raylift {
namespace {

constexpr int kMaxPatches = 600;
// Shares of the longer side: half a patch's side, and how far from its place it is looked for.
constexpr double kHalfSide = 1.0 / 40;
constexpr double kSearchRadius = 0.02;
// Its square is the share of the patch's variance that the photograph shows, one half here.
constexpr double kLeastCorrelation = 0.7071;

cv::Mat ToFloat(const Image& gray, cv::Size size) {
  cv::Mat values;
  AsMat(gray).convertTo(values, CV_32F);
  if (values.size() != size) cv::resize(values, values, size, 0, 0, cv::INTER_AREA);
  return values;
}

// Returns the corners whose patches lie within the rendering and the mask.
std::vector<cv::Point> Corners(const cv::Mat& rendering, const Image& mask, int half_px) {
  cv::Mat inside;
  const int side_px = 2 * half_px + 1;
  cv::erode(AsMat(mask), inside, cv::Mat::ones(side_px, side_px, CV_8U), {-1, -1}, 1,
            cv::BORDER_CONSTANT, cv::Scalar::all(0));
  // As many as there are: a weak one is a corner, too, and the correlation judges it.
  constexpr double kLeastQuality = 1e-4;
  std::vector<cv::Point2f> found;
  cv::goodFeaturesToTrack(rendering, found, kMaxPatches, kLeastQuality, half_px / 2.0, inside,
                          half_px);
  std::vector<cv::Point> corners;
  for (const cv::Point2f& corner : found)
    corners.emplace_back(cvRound(corner.x), cvRound(corner.y));
  return corners;
}

// Returns where the quadratic through a maximum and its neighbors has its peak; nullopt where that
// is not beside the maximum. A patch along an edge has an oblique one: both axes count at once.
std::optional<Eigen::Vector2d> PeakBeside(const cv::Mat& correlation, cv::Point at) {
  const auto value = [&](int x, int y) -> double {
    return correlation.at<float>(at.y + y, at.x + x);
  };
  const Eigen::Vector2d gradient((value(1, 0) - value(-1, 0)) / 2,
                                 (value(0, 1) - value(0, -1)) / 2);
  const double xy = (value(1, 1) - value(1, -1) - value(-1, 1) + value(-1, -1)) / 4;
  Eigen::Matrix2d curvature;
  curvature << value(1, 0) - 2 * value(0, 0) + value(-1, 0), xy, xy,
      value(0, 1) - 2 * value(0, 0) + value(0, -1);
  if (!(curvature.determinant() > 0)) return std::nullopt;
  const Eigen::Vector2d offset = -curvature.inverse() * gradient;
  if (!(offset.cwiseAbs().maxCoeff() <= 1)) return std::nullopt;
  return offset;
}

// Returns the highest correlation's place, to a fraction of a pixel; nullopt where it is on the
// border or too low.
std::optional<Eigen::Vector2d> Peak(const cv::Mat& correlation) {
  double best = 0;
  cv::Point at;
  cv::minMaxLoc(correlation, nullptr, &best, nullptr, &at);
  if (!(best >= kLeastCorrelation) || at.x == 0 || at.y == 0 || at.x == correlation.cols - 1 ||
      at.y == correlation.rows - 1) {
    return std::nullopt;
  }
  const auto offset = PeakBeside(correlation, at);
  if (!offset) return std::nullopt;
  return Eigen::Vector2d(at.x, at.y) + *offset;
}

}  // namespace

std::vector<PatchMatch> AlignPatches(const Image& photograph, const Image& rendering,
                                     const Image& mask) {
  const cv::Size size(rendering.width_px, rendering.height_px);
  const cv::Mat seen = ToFloat(photograph, size);
  const cv::Mat rendered = ToFloat(rendering, size);
  const Eigen::Array2d photograph_from_rendering(
      static_cast<double>(photograph.width_px) / size.width,
      static_cast<double>(photograph.height_px) / size.height);
  const double longer_px = std::max(seen.cols, seen.rows);
  const int half_px = std::max(3, static_cast<int>(std::lround(kHalfSide * longer_px)));
  const int reach_px = half_px + std::max(2, static_cast<int>(kSearchRadius * longer_px));
  const cv::Rect all({0, 0}, seen.size());
  std::vector<PatchMatch> matches;
  cv::Mat correlation;
  for (const cv::Point& corner : Corners(rendered, mask, half_px)) {
    const auto around = [&](int px) {
      return cv::Rect(corner.x - px, corner.y - px, 2 * px + 1, 2 * px + 1) & all;
    };
    const cv::Rect searched = around(reach_px);
    cv::matchTemplate(seen(searched), rendered(around(half_px)), correlation, cv::TM_CCOEFF_NORMED);
    const auto peak = Peak(correlation);
    if (!peak) continue;
    const Eigen::Array2d found =
        peak->array() + Eigen::Array2d(searched.x, searched.y) + half_px + 0.5;
    matches.push_back({{corner.x + 0.5, corner.y + 0.5}, photograph_from_rendering * found});
  }
  return matches;
}

}  // namespace raylift
