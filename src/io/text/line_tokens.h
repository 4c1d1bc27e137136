// Takes the tokens of one line one after the other, and names them in messages.

#pragma once

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "raylift/base/text.h"
#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"

namespace raylift {

// The reader and the line must outlive it.
class LineTokens {
 public:
  LineTokens(const LineReader& lines, std::string_view line) : lines_(&lines), rest_(line) {}

  bool AtEnd();
  // Returns the next token; throws where the line ends.
  std::string_view Token(std::string_view field);
  // Returns the next token; in double quotes it may hold blanks.
  std::string_view Name(std::string_view field = "name");
  double Double(std::string_view field) { return lines_->Double(Token(field), field); }
  uint64_t Uint64(std::string_view field) { return lines_->Uint(Token(field), field); }
  uint32_t Uint32(std::string_view field);
  int Int(std::string_view field);
  // Returns the rest of the line, without blanks at its ends.
  std::string_view Rest();
  bool NextStartsWith(std::string_view start) { return !AtEnd() && rest_.starts_with(start); }
  // Throws where there are tokens left.
  void ExpectEnd();
  [[noreturn]] void Fail(std::string_view message) const { lines_->Fail(message); }

  template <int N>
  Eigen::Matrix<double, N, 1> Vector(std::string_view field) {
    Eigen::Matrix<double, N, 1> vector;
    for (double& x : vector) {
      x = Double(field);
    }
    return vector;
  }
  // Returns the standard deviation of a focal length as a share of it.
  double FocalSigma();
  // Reads four numbers, w first, not normalized but not all zero.
  Eigen::Vector4d Quaternion(std::string_view field);

  // Reads "QW QX QY QZ TX TY TZ", with a quaternion of length 1.
  Rigid3 Pose();

  // Reads "MODEL WIDTH HEIGHT PARAMS..." up to the end of the line, or up to this word.
  Camera CameraToEnd(std::string_view end = {});

 private:
  void SkipBlanks();
  bool NextIs(std::string_view token);

  const LineReader* lines_;
  std::string_view rest_;
};

// Returns the name as LineTokens::Name() reads it back: in quotes where it has blanks or starts
// with `#`. Throws InputError for a name that would not read back.
std::string NameText(const std::filesystem::path& file, const std::string& name);

// Returns the seven numbers of LineTokens::Pose().
std::string FormatPose(const Rigid3& pose, std::string_view separator = " ");

// Returns the unit quaternion, nullopt if the length is not 1 within the tolerance. One that is of
// unit length up to rounding stays as it is, so that it is written back with the same digits.
std::optional<Eigen::Quaterniond> UnitQuaternion(const Eigen::Vector4d& qvec_wxyz);

// Returns whether a vector of any length can be normalized: it is not zero, nor so short or long
// that its squares leave the range of numbers.
template <int N>
bool HasDirection(const Eigen::Matrix<double, N, 1>& vector) {
  return std::isnormal(vector.squaredNorm());
}

}  // namespace raylift
