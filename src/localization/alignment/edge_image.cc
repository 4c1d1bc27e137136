#include "localization/alignment/edge_image.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/statistics.h"
#include "features/cv_image.h"
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace raylift {
namespace {

// The derivative's scale, in pixels: the least at which the direction of a step is that of its edge
// rather than that of the pixels' grid.
constexpr double kBlurPx = 1;
// The share of gradients of noise alone, whose magnitude is Rayleigh distributed, that exceed the
// threshold.
constexpr double kNoiseShare = 0.01;
// Edges that are more deviations away than this are no edges of the scene.
constexpr double kFarthest = 5;
// The neighborhood in which the rate of edges is measured, as a share of the longer side.
constexpr double kNeighborhood = 0.2;

struct Gradients {
  cv::Mat along_x, along_y, magnitude;
};

Gradients GradientsOf(const Image& gray) {
  cv::Mat smooth;
  AsMat(gray).convertTo(smooth, CV_32F);
  cv::GaussianBlur(smooth, smooth, {0, 0}, kBlurPx);
  Gradients found;
  cv::Scharr(smooth, found.along_x, CV_32F, 1, 0, 1.0 / 32);
  cv::Scharr(smooth, found.along_y, CV_32F, 0, 1, 1.0 / 32);
  cv::magnitude(found.along_x, found.along_y, found.magnitude);
  return found;
}

// Returns the magnitude that noise seldom reaches, by the median of all: most pixels show no edge.
float Threshold(const cv::Mat& magnitude) {
  std::vector<float> values(magnitude.begin<float>(), magnitude.end<float>());
  return UpperMedianInPlace(std::span(values)) *
         static_cast<float>(std::sqrt(std::log(1 / kNoiseShare) / std::log(2.0)));
}

float At(const cv::Mat& map, float x, float y) {
  const int x0 = static_cast<int>(x);
  const int y0 = static_cast<int>(y);
  const float fx = x - static_cast<float>(x0);
  const float fy = y - static_cast<float>(y0);
  const float* above = map.ptr<float>(y0) + x0;
  const float* below = map.ptr<float>(y0 + 1) + x0;
  return (1 - fy) * ((1 - fx) * above[0] + fx * above[1]) +
         fy * ((1 - fx) * below[0] + fx * below[1]);
}

// Returns the edge in a pixel where the magnitude has its maximum along the gradient.
std::optional<EdgePixel> EdgeIn(const Gradients& gradients, int x, int y) {
  const float here = gradients.magnitude.at<float>(y, x);
  const Eigen::Vector2f normal(gradients.along_x.at<float>(y, x) / here,
                               gradients.along_y.at<float>(y, x) / here);
  const Eigen::Vector2f center(static_cast<float>(x), static_cast<float>(y));
  const auto beside = [&](float step) {
    const Eigen::Vector2f place = center + step * normal;
    return At(gradients.magnitude, place.x(), place.y());
  };
  const float after = beside(1);
  const float before = beside(-1);
  if (!(here > after && here >= before)) return std::nullopt;
  const float offset = 0.5f * (before - after) / (after - 2 * here + before);
  return EdgePixel{center + Eigen::Vector2f(0.5f, 0.5f) + offset * normal, normal};
}

}  // namespace

EdgeImage::EdgeImage(const Image& gray, const Camera& camera, double sigma_px)
    : camera_(camera), width_(gray.width_px), height_(gray.height_px) {
  FindEdges(gray);
  MakeEvidence(sigma_px);
}

size_t EdgeImage::Direction(const Eigen::Vector2d& normal) {
  // Looks the angle up in a table of |y| / (|x| + |y|), as an arc tangent would dominate the cost
  // of a score.
  constexpr size_t kSteps = 256;
  static const auto kOfFirstQuadrant = [] {
    std::array<uint8_t, kSteps + 1> directions;
    for (size_t i = 0; i <= kSteps; ++i) {
      const double share = (static_cast<double>(i) + 0.5) / (kSteps + 1);
      const double turns = std::atan2(share, 1 - share) / std::numbers::pi;
      directions[i] = static_cast<uint8_t>(std::lround(turns * kDirections));
    }
    return directions;
  }();
  const double x = std::abs(normal.x());
  const double y = std::abs(normal.y());
  const size_t direction = kOfFirstQuadrant[static_cast<size_t>(kSteps * y / (x + y))];
  return (normal.x() > 0) == (normal.y() > 0) ? direction : (kDirections - direction) % kDirections;
}

void EdgeImage::FindEdges(const Image& gray) {
  const Gradients gradients = GradientsOf(gray);
  const float threshold = Threshold(gradients.magnitude);
  edge_at_.assign(static_cast<size_t>(width_) * static_cast<size_t>(height_), -1);
  constexpr int kBorder = 2;  // where the derivative sees what is no picture
  for (int y = kBorder; y < height_ - kBorder; ++y) {
    for (int x = kBorder; x < width_ - kBorder; ++x) {
      if (!(gradients.magnitude.at<float>(y, x) > threshold)) continue;
      if (const auto edge = EdgeIn(gradients, x, y)) {
        edge_at_[Index(x, y)] = static_cast<int32_t>(edges_.size());
        edges_.push_back(*edge);
      }
    }
  }
}

void EdgeImage::MakeEvidence(double sigma_px) {
  std::array<cv::Mat, kDirections> edges;
  for (cv::Mat& map : edges) map = cv::Mat::zeros(height_, width_, CV_8U);
  for (int y = 0; y < height_; ++y) {
    for (int x = 0; x < width_; ++x) {
      const int32_t edge = edge_at_[Index(x, y)];
      if (edge < 0) continue;
      const size_t direction = Direction(edges_[static_cast<size_t>(edge)].normal.cast<double>());
      for (size_t beside : {size_t{0}, size_t{1}, size_t{kDirections} - 1}) {
        edges[(direction + beside) % kDirections].at<uint8_t>(y, x) = 255;
      }
    }
  }
  const int side = std::max(3, static_cast<int>(kNeighborhood * std::max(width_, height_)) | 1);
  const double least_rate = 1.0 / side;  // one edge is crossed by the neighborhood
  const size_t num_pixels = edge_at_.size();
  for (size_t direction = 0; direction < kDirections; ++direction) {
    cv::Mat rate;
    cv::Mat distance;
    cv::boxFilter(edges[direction], rate, CV_32F, {side, side}, {-1, -1}, true, cv::BORDER_REFLECT);
    cv::distanceTransform(255 - edges[direction], distance, cv::DIST_L2, 5);
    std::vector<float>& evidence = evidence_[direction];
    evidence.resize(num_pixels);
    std::vector<float>& rates = rate_[direction];
    rates.resize(num_pixels);
    for (size_t i = 0; i < num_pixels; ++i) {
      const double d = distance.ptr<float>()[i];
      const double r = std::max(least_rate, rate.ptr<float>()[i] / 255.0);
      rates[i] = static_cast<float>(r);
      if (d > kFarthest * sigma_px) {
        evidence[i] = -1;
        continue;
      }
      const double z = d / sigma_px;
      const double density =
          2 / (sigma_px * std::sqrt(2 * std::numbers::pi)) * std::exp(-0.5 * z * z);
      evidence[i] = static_cast<float>(density / (2 * r) + std::erfc(z / std::numbers::sqrt2) - 1);
    }
  }
}

double EdgeImage::ChanceRate(const Eigen::Vector2d& pixel, const Eigen::Vector2d& normal) const {
  const int x = std::clamp(static_cast<int>(pixel.x()), 0, width_ - 1);
  const int y = std::clamp(static_cast<int>(pixel.y()), 0, height_ - 1);
  return rate_[Direction(normal)][Index(x, y)];
}

std::optional<EdgePixel> EdgeImage::NearestAlong(const Eigen::Vector2d& pixel,
                                                 const Eigen::Vector2d& normal,
                                                 double reach_px) const {
  constexpr double kStepPx = 0.5;
  const double least_cosine = std::cos(1.5 * std::numbers::pi / kDirections);
  const int steps = static_cast<int>(reach_px / kStepPx);
  for (int step = 0; step <= steps; ++step) {
    for (const int sign : {1, -1}) {
      const Eigen::Vector2d place = pixel + sign * step * kStepPx * normal;
      if (!(place.x() >= 0 && place.y() >= 0 && place.x() < width_ && place.y() < height_)) {
        continue;
      }
      const int32_t index =
          edge_at_[Index(static_cast<int>(place.x()), static_cast<int>(place.y()))];
      if (index >= 0) {
        const EdgePixel& edge = edges_[static_cast<size_t>(index)];
        if (std::abs(edge.normal.cast<double>().dot(normal)) >= least_cosine) return edge;
      }
      if (step == 0) break;
    }
  }
  return std::nullopt;
}

}  // namespace raylift
