#include "viewpoints.h"

#include <array>
#include <cmath>
#include <numbers>
#include <string>

#include "base/constants.h"
#include <Eigen/Geometry>

namespace raylift::demo {

Rigid3 CamFromWorld(const Eigen::Vector3d& center, double heading_deg, double pitch_deg,
                    double roll_deg) {
  const double heading = heading_deg * kRadPerDeg, pitch = pitch_deg * kRadPerDeg;
  const Eigen::Vector3d forward(std::cos(pitch) * std::cos(heading),
                                std::cos(pitch) * std::sin(heading), std::sin(pitch));
  const Eigen::Vector3d right = forward.cross(Eigen::Vector3d::UnitZ()).normalized();
  Eigen::Matrix3d rows;
  rows << right.transpose(), forward.cross(right).transpose(), forward.transpose();
  const Eigen::AngleAxisd roll(-roll_deg * kRadPerDeg, Eigen::Vector3d::UnitZ());
  const Eigen::Quaterniond rotation = Eigen::Quaterniond(roll * rows).normalized();
  return {rotation, -(rotation * center)};
}

std::string Numbered(const std::string& prefix, size_t number) {
  return prefix + (number < 10 ? "0" : "") + std::to_string(number) + ".jpg";
}

std::vector<PosedImage> ReferenceViews() {
  const Camera phone(CameraModel::kSimpleRadial, 640, 480, std::array{505.0, 321.5, 238.7, -0.045});
  const Camera compact(CameraModel::kPinhole, 640, 480, std::array{462.0, 463.5, 318.2, 241.1});
  std::vector<PosedImage> views;
  for (int i = 0; i < 12; ++i) {
    const double angle_deg = 30.0 * i + 10, angle = angle_deg * std::numbers::pi / 180;
    const Eigen::Vector3d across(8 + 5.1 * std::cos(angle), 6 + 3.4 * std::sin(angle),
                                 1.6 + 0.05 * (i % 4));
    views.push_back({"", compact,
                     CamFromWorld(across, angle_deg + 180 + (i % 2 == 0 ? 27 : -27), 6 + i % 3,
                                  0.8 * (i % 3 - 1))});
  }
  for (int i = 0; i < 12; ++i) {
    const double angle_deg = 30.0 * i - 4, angle = angle_deg * std::numbers::pi / 180;
    const Eigen::Vector3d near_center(8 + 3.0 * std::cos(angle), 6 + 2.5 * std::sin(angle),
                                      1.55 + 0.07 * (i % 3));
    views.push_back({"", phone,
                     CamFromWorld(near_center, angle_deg + (i % 2 == 0 ? 14 : -14), 7 + 2 * (i % 3),
                                  1.1 * (i % 3 - 1))});
  }
  for (size_t i = 0; i < views.size(); ++i) views[i].name = Numbered("ref/ref_", i + 1);
  return views;
}

std::vector<PosedImage> QueryViews() {
  const Camera wide(CameraModel::kOpenCv, 640, 480,
                    std::array{415.0, 416.2, 316.4, 243.9, -0.19, 0.045, 0.0011, -0.0008});
  const Camera radial(CameraModel::kSimpleRadial, 640, 480, std::array{488.0, 323.1, 236.4, -0.11});
  const Camera upright(CameraModel::kSimpleRadial, 480, 640, std::array{520.0, 238.2, 322.7, 0.06});
  struct View {
    const Camera& camera;
    double x, y, z, heading_deg, pitch_deg, roll_deg;
  };
  const std::array<View, 12> taken{{{wide, 4.4, 7.6, 1.72, -12, 5, 2},
                                    {radial, 11.3, 8.7, 1.45, 228, 8, -3},
                                    {wide, 7.3, 2.3, 1.45, 64, 7, 1},
                                    {radial, 10.2, 4.3, 1.9, -38, 10, 4},
                                    {upright, 5.2, 6.9, 1.65, 158, 12, -2},
                                    {wide, 12.4, 5.2, 1.3, 170, 9, -4},
                                    {radial, 8.9, 8.9, 1.7, 74, 9, 2},
                                    {upright, 10.0, 7.9, 1.75, 8, 9, 3},
                                    {wide, 7.4, 3.0, 1.75, 262, 6, -1},
                                    {radial, 3.4, 4.3, 1.5, 42, 3, 5},
                                    {wide, 9.7, 9.2, 1.1, 290, 12, 3},
                                    {radial, 5.6, 8.2, 2.1, 118, -4, -6}}};
  std::vector<PosedImage> views;
  views.reserve(taken.size());
  for (const View& view : taken) {
    views.push_back(
        {Numbered("query/query_", views.size() + 1), view.camera,
         CamFromWorld({view.x, view.y, view.z}, view.heading_deg, view.pitch_deg, view.roll_deg)});
  }
  return views;
}

void MoveViews(Rng& rng, std::vector<PosedImage>& views) {
  constexpr double kMostMetres = 0.2, kMostRadians = 5 * std::numbers::pi / 180;
  const auto draw = [&rng](double most) -> Eigen::Vector3d {
    return Eigen::Vector3d{rng.Uniform(-1, 1), rng.Uniform(-1, 1), rng.Uniform(-1, 1)} *
           (most / std::numbers::sqrt3);
  };
  for (PosedImage& view : views) {
    Rigid3& pose = view.cam_from_world;
    const Eigen::Vector3d center = pose.OriginInSource() + draw(kMostMetres);
    const Eigen::Vector3d turn = draw(kMostRadians);
    const Eigen::Quaterniond rotation = RotationFromVector(turn);
    const Eigen::Quaterniond turned = (rotation * pose.rotation).normalized();
    pose = {turned, -(turned * center)};
  }
}

}  // namespace raylift::demo
