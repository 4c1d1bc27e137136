#include "lifting/point_rays.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Geometry>

namespace raylift {
namespace {

class Correlation {
 public:
  void Add(double x, double y) {
    ++count_;
    const double dx = x - mean_x_, dy = y - mean_y_;
    mean_x_ += dx / count_;
    mean_y_ += dy / count_;
    xx_ += dx * (x - mean_x_);
    yy_ += dy * (y - mean_y_);
    xy_ += dx * (y - mean_y_);
  }
  double count() const { return count_; }
  double Value() const { return xx_ > 0 && yy_ > 0 ? xy_ / std::sqrt(xx_ * yy_) : 0; }

 private:
  double count_ = 0, mean_x_ = 0, mean_y_ = 0, xx_ = 0, yy_ = 0, xy_ = 0;
};

}  // namespace

double AgreementWithRays(std::span<const float> points, PlaneSize size,
                         const Eigen::Matrix<float, 3, 4>& cam_from_points) {
  constexpr float kMaxTangent = 4;  // 76 degrees from the axis
  Correlation columns, rows;
  double asked = 0;
  for (int y = 0; y < size.height_px; ++y) {
    for (int x = 0; x < size.width_px; ++x) {
      const size_t i =
          static_cast<size_t>(y) * static_cast<size_t>(size.width_px) + static_cast<size_t>(x);
      const Eigen::Map<const Eigen::Vector3f> stored(points.data() + 3 * i);
      if (stored.isZero(0) || !stored.allFinite()) continue;
      ++asked;
      const Eigen::Vector3f point = cam_from_points * stored.homogeneous();
      if (!(point.head<2>().cwiseAbs().maxCoeff() < kMaxTangent * point.z())) continue;
      columns.Add(x, static_cast<double>(point.x() / point.z()));
      rows.Add(y, static_cast<double>(point.y() / point.z()));
    }
  }
  return 2 * columns.count() > asked ? std::min(columns.Value(), rows.Value()) : 0;
}

}  // namespace raylift
