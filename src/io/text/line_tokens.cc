#include "io/text/line_tokens.h"

#include <algorithm>
#include <climits>

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/scene/photographs.h"

namespace raylift {

std::optional<Eigen::Quaterniond> UnitQuaternion(const Eigen::Vector4d& qvec_wxyz) {
  // Rounding makes files be off by so much; more than that is another quantity.
  constexpr double kUnitLengthTolerance = 1e-3;
  constexpr double kRounding = 1e-12;
  Eigen::Quaterniond q(qvec_wxyz[0], qvec_wxyz[1], qvec_wxyz[2], qvec_wxyz[3]);
  const double deviation = std::abs(q.norm() - 1);
  if (!(deviation <= kUnitLengthTolerance)) {
    return std::nullopt;
  }
  if (deviation > kRounding) {
    q.normalize();
  }
  return q;
}

namespace {

constexpr std::string_view kBlanks = " \t\r\v\f";

std::string NamesOfCameraModels() {
  std::string names;
  for (const CameraModelInfo& info : AllCameraModels()) {
    names += names.empty() ? "" : ", ";
    names += info.name;
  }
  return names;
}

}  // namespace

void LineTokens::SkipBlanks() {
  rest_.remove_prefix(std::min(rest_.find_first_not_of(kBlanks), rest_.size()));
}

bool LineTokens::AtEnd() {
  SkipBlanks();
  return rest_.empty();
}

std::string_view LineTokens::Token(std::string_view field) {
  if (AtEnd()) {
    Fail(fmt::format("{}: expected a value, the line ends here", field));
  }
  const size_t size = std::min(rest_.find_first_of(kBlanks), rest_.size());
  const std::string_view token = rest_.substr(0, size);
  rest_.remove_prefix(size);
  return token;
}

std::string_view LineTokens::Name(std::string_view field) {
  if (AtEnd() || rest_.front() != '"') return Token(field);
  const size_t end = rest_.find('"', 1);
  if (end == std::string_view::npos || end == 1) {
    Fail(fmt::format("{}: expected it between quotes, found {}", field, rest_));
  }
  const std::string_view name = rest_.substr(1, end - 1);
  rest_.remove_prefix(end + 1);
  return name;
}

bool LineTokens::NextIs(std::string_view token) {
  LineTokens ahead = *this;
  return !ahead.AtEnd() && ahead.Token(token) == token;
}

uint32_t LineTokens::Uint32(std::string_view field) {
  const uint64_t value = Uint64(field);
  if (value > UINT32_MAX) {
    Fail(fmt::format("{}: expected at most {}, found {}", field, UINT32_MAX, value));
  }
  return static_cast<uint32_t>(value);
}

int LineTokens::Int(std::string_view field) {
  const int64_t value = lines_->Int(Token(field), field);
  if (value > INT_MAX || value < INT_MIN) {
    Fail(fmt::format("{}: expected at most {} in size, found {}", field, INT_MAX, value));
  }
  return static_cast<int>(value);
}

std::string_view LineTokens::Rest() {
  const std::string_view rest = Trim(rest_);
  rest_ = {};
  return rest;
}

void LineTokens::ExpectEnd() {
  if (!AtEnd()) {
    Fail(fmt::format("expected the end of the line, found \"{}\"", Token("")));
  }
}

double LineTokens::FocalSigma() {
  const double sigma = Double("focal_sigma");
  if (!(sigma >= 0 && sigma <= kMaxFocalSigma)) {
    Fail(fmt::format("focal_sigma: expected a share of the focal length from 0 to {}",
                     kMaxFocalSigma));
  }
  return sigma;
}

Eigen::Vector4d LineTokens::Quaternion(std::string_view field) {
  Eigen::Vector4d qvec_wxyz = Vector<4>(field);
  if (!HasDirection(qvec_wxyz)) {
    Fail(fmt::format("{}: expected a rotation, found the quaternion {}", field,
                     fmt::join(qvec_wxyz, " ")));
  }
  return qvec_wxyz;
}

Rigid3 LineTokens::Pose() {
  const auto qvec_wxyz = Vector<4>("qvec");
  const auto rotation = UnitQuaternion(qvec_wxyz);
  if (rotation) return {*rotation, Vector<3>("tvec")};
  Fail(fmt::format("qvec: expected a quaternion of length 1, found one of length {:.6g}",
                   qvec_wxyz.norm()));
}

Camera LineTokens::CameraToEnd(std::string_view end) {
  const std::string_view name = Token("camera model");
  const auto model = CameraModelFromName(name);
  if (!model) {
    Fail(
        fmt::format("camera model: expected one of {}, found \"{}\"", NamesOfCameraModels(), name));
  }
  const int width_px = Int("width");
  const int height_px = Int("height");
  std::vector<double> params;
  while (!AtEnd() && !NextIs(end)) {
    params.push_back(Double("params"));
  }
  try {
    return Camera(*model, width_px, height_px, params);
  } catch (const InputError& error) {
    Fail(error.what());
  }
}

std::string FormatPose(const Rigid3& pose, std::string_view separator) {
  const Eigen::Quaterniond& q = pose.rotation;
  const Eigen::Vector3d& t = pose.translation;
  std::string text;
  for (const double number : {q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z()}) {
    if (!text.empty()) text += separator;
    text += FormatDouble(number);
  }
  return text;
}

std::string NameText(const std::filesystem::path& file, const std::string& name) {
  if (name.empty() || name.find_first_of("\"\r\n") != std::string::npos) {
    throw InputError(file, fmt::format("the file cannot hold the name \"{}\": expected one without "
                                       "quotes and line ends",
                                       name));
  }
  const bool is_plain = !name.starts_with('#') && name.find_first_of(kBlanks) == std::string::npos;
  return is_plain ? name : '"' + name + '"';
}

}  // namespace raylift
