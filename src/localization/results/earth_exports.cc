#include "localization/results/earth_exports.h"

#include <array>
#include <cmath>
#include <numbers>

#include "base/constants.h"
#include "base/input_paths.h"
#include "base/json_text.h"
#include "io/text/line_tokens.h"
#include <Eigen/Eigenvalues>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Json = nlohmann::ordered_json;

Matrix3d WorldFromCam(const Rigid3& cam_from_world) {
  return cam_from_world.rotation.conjugate().toRotationMatrix();
}

// Returns the angles of a rotation about z, then the new y, then the new x.
Json YawPitchRoll(const Matrix3d& r) {
  const double horizontal = std::hypot(r(0, 0), r(1, 0));
  const bool is_vertical = horizontal < 1e-9;
  Json angles;
  SetMember(
      angles, "yaw",
      kDegPerRad * (is_vertical ? std::atan2(-r(0, 1), r(1, 1)) : std::atan2(r(1, 0), r(0, 0))));
  SetMember(angles, "pitch", kDegPerRad * std::atan2(-r(2, 0), horizontal));
  SetMember(angles, "roll", is_vertical ? 0.0 : kDegPerRad * std::atan2(r(2, 1), r(2, 2)));
  return angles;
}

// Returns the ellipse of a covariance in east and north that holds 95 %: the square root of chi
// squared's quantile of two degrees of freedom times the standard deviations.
Json Ellipse(const EarthFrame::Place& place, const Eigen::Matrix2d& covariance_m2) {
  constexpr double kQuantile = 2.447746830680816;
  constexpr int kCorners = 36;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> axes(covariance_m2);
  const Eigen::Matrix2d half_axes =
      kQuantile * axes.eigenvectors() * axes.eigenvalues().cwiseMax(0).cwiseSqrt().asDiagonal();
  // GeoJSON's rings turn counter-clockwise.
  const double turn = half_axes.determinant() < 0 ? -1 : 1;
  constexpr double kMetersPerDegree = 6371008.8 / kDegPerRad;
  const double shrink = std::cos(place.geographic.y() / kDegPerRad);
  Json ring = Json::array();
  for (int i = 0; i <= kCorners; ++i) {
    const double angle = turn * 2 * std::numbers::pi * (i % kCorners) / kCorners;
    const Eigen::Vector2d step_m = half_axes * Eigen::Vector2d(std::cos(angle), std::sin(angle));
    ring.push_back({place.geographic.x() + step_m.x() / (kMetersPerDegree * shrink),
                    place.geographic.y() + step_m.y() / kMetersPerDegree});
  }
  return {{"type", "Polygon"}, {"coordinates", Json::array({ring})}};
}

Json Feature(const Json& geometry, const Json& properties) {
  return {{"type", "Feature"}, {"geometry", geometry}, {"properties", properties}};
}

}  // namespace

EarthFrame::Place EarthFrame::At(const Vector3d& point_in_world) const {
  const Vector3d in_crs = point_in_world + world_.origin;
  world_.crs.Check(in_crs);
  const LocalFrame frame = LocalFrameAt(world_.crs, in_crs);
  return {to_wgs84_(in_crs), frame.Axes(), frame.Scale()};
}

std::optional<std::string> EarthFrame::HeightsWarning() const {
  if (world_.crs.has_heights()) return std::nullopt;
  return fmt::format("{} says not what heights are above: they count as above the ellipsoid",
                     world_.crs.definition());
}

std::optional<Matrix3d> CenterCovariance(const PoseEstimate& estimate) {
  if (!estimate.covariance || !estimate.cam_from_world) return std::nullopt;
  // A step (w, v) moves the center by -R' v.
  const Matrix3d r = estimate.cam_from_world->rotation.toRotationMatrix();
  return r.transpose() * estimate.covariance->bottomRightCorner<3, 3>() * r;
}

std::optional<Matrix3d> CenterCovarianceEnu(const PoseEstimate& estimate,
                                            const EarthFrame::Place& place) {
  const auto covariance = CenterCovariance(estimate);
  if (!covariance) return std::nullopt;
  return place.world_from_enu.transpose() * *covariance * place.world_from_enu /
         (place.units_per_meter * place.units_per_meter);
}

Json GeoPoseOf(const Rigid3& cam_from_world, const EarthFrame::Place& place, GeoPoseForm form) {
  Matrix3d cam_from_body;  // x, y, z: where the camera looks, left, up
  cam_from_body << 0, -1, 0, 0, 0, -1, 1, 0, 0;
  const Matrix3d enu_from_body =
      place.world_from_enu.transpose() * WorldFromCam(cam_from_world) * cam_from_body;
  Json json;
  SetIn(json, "position", "lat", place.geographic.y());
  SetIn(json, "position", "lon", place.geographic.x());
  SetIn(json, "position", "h", place.geographic.z());
  if (form == GeoPoseForm::kYawPitchRoll) {
    SetMember(json, "angles", YawPitchRoll(enu_from_body));
    return json;
  }
  Eigen::Quaterniond q(enu_from_body);
  if (q.w() < 0) q.coeffs() *= -1;
  SetIn(json, "quaternion", "x", q.x());
  SetIn(json, "quaternion", "y", q.y());
  SetIn(json, "quaternion", "z", q.z());
  SetIn(json, "quaternion", "w", q.w());
  return json;
}

void WriteGeoPoses(const std::filesystem::path& folder, const EarthFrame& earth,
                   std::span<const LocalizedQuery> queries, GeoPoseForm form) {
  for (const LocalizedQuery& query : queries) {
    const Rigid3& cam_from_world = *query.estimate.cam_from_world;
    const std::filesystem::path file = PathBelow(folder, query.name + ".json");
    std::filesystem::create_directories(file.parent_path());
    const auto place = earth.At(cam_from_world.OriginInSource());
    WriteFile(file, JsonText(GeoPoseOf(cam_from_world, place, form), 1) + '\n');
  }
}

void WriteGeoJson(const std::filesystem::path& file, const EarthFrame& earth,
                  std::span<const LocalizedQuery> queries) {
  Json features = Json::array();
  for (const LocalizedQuery& query : queries) {
    const auto place = earth.At(query.estimate.cam_from_world->OriginInSource());
    const Vector3d& at = place.geographic;
    Json properties = {{"name", query.name},
                       {"verdict", ToString(query.verdict())},
                       {"confidence", query.confidence()}};
    const auto in_enu = CenterCovarianceEnu(query.estimate, place);
    if (!in_enu) {
      features.push_back(
          Feature({{"type", "Point"}, {"coordinates", {at.x(), at.y(), at.z()}}}, properties));
      continue;
    }
    const Vector3d sigma_m = in_enu->diagonal().cwiseMax(0).cwiseSqrt();
    properties["sigma_east_m"] = sigma_m.x();
    properties["sigma_north_m"] = sigma_m.y();
    properties["sigma_up_m"] = sigma_m.z();
    features.push_back(
        Feature({{"type", "Point"}, {"coordinates", {at.x(), at.y(), at.z()}}}, properties));
    features.push_back(Feature(Ellipse(place, in_enu->topLeftCorner<2, 2>()),
                               {{"name", query.name}, {"holds", "95 %"}}));
  }
  const Json collection = {{"type", "FeatureCollection"}, {"features", features}};
  WriteFile(file, JsonText(collection) + '\n');
}

void WriteMapPoses(const std::filesystem::path& file, const EarthFrame& earth, const Crs& target,
                   std::span<const LocalizedQuery> queries) {
  const CrsTransform to_target(earth.world().crs, target);
  std::string text;
  for (const LocalizedQuery& query : queries) {
    const Vector3d center = query.estimate.cam_from_world->OriginInSource();
    const auto place = earth.At(center);
    const Vector3d there = to_target(center + earth.world().origin);
    target.Check(there);
    const Matrix3d target_from_world =
        LocalFrameAt(target, there).Axes() * place.world_from_enu.transpose();
    const Matrix3d target_from_cam = target_from_world *
                                     WorldFromCam(*query.estimate.cam_from_world) *
                                     Vector3d(1, -1, -1).asDiagonal();
    Eigen::Quaterniond q(target_from_cam);
    if (q.w() < 0) q.coeffs() *= -1;
    text += NameText(file, query.name);
    for (const double number : {q.w(), q.x(), q.y(), q.z(), there.x(), there.y(), there.z()}) {
      text += ' ' + FormatDouble(number);
    }
    text += '\n';
  }
  WriteFile(file, text);
}

}  // namespace raylift
