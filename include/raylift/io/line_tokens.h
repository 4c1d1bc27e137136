// The tokens of one line, taken one after the other and named in messages.

#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

#include <Eigen/Core>

#include "raylift/base/text.h"
#include "raylift/geometry/camera.h"

namespace raylift {

// The reader and the line must outlive it.
class LineTokens {
 public:
  LineTokens(const LineReader& lines, std::string_view line) : lines_(lines), rest_(line) {}

  bool AtEnd();
  // The next token; fails where the line ends.
  std::string_view Token(std::string_view field);
  double Double(std::string_view field) { return lines_.Double(Token(field), field); }
  uint64_t Uint64(std::string_view field) { return lines_.Uint(Token(field), field); }
  uint32_t Uint32(std::string_view field);
  int Int(std::string_view field);
  // All that is left, without blanks at its ends.
  std::string_view Rest();
  // Fails where there are tokens left.
  void ExpectEnd();
  [[noreturn]] void Fail(std::string_view message) const { lines_.Fail(message); }

  template <int N>
  Eigen::Matrix<double, N, 1> Vector(std::string_view field) {
    Eigen::Matrix<double, N, 1> vector;
    for (double& x : vector) {
      x = Double(field);
    }
    return vector;
  }
  // Four numbers, w first, not normalized but not all zero.
  Eigen::Vector4d Quaternion(std::string_view field);

  // "MODEL WIDTH HEIGHT PARAMS..." up to the end of the line.
  Camera CameraToEnd();

 private:
  void SkipBlanks();

  const LineReader& lines_;
  std::string_view rest_;
};

// Names end at white space in such files, and `#` starts a comment. InputError for a name that
// would not read back.
void CheckName(const std::filesystem::path& file, const std::string& name);

}  // namespace raylift
