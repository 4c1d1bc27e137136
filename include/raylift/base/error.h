// The two kinds of errors that leave a function, and the check for our own mistakes.
//
// Bad input (a file, a value in it) is an InputError: one line that names the file, the place in
// it, what was expected and what was found. A bad option is an OptionError. Both are caught once,
// in main. "No pose was found" is neither: it is a result (see PoseEstimate).

#pragma once

#include <filesystem>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>

namespace raylift {

// Says that input is bad. what() is one line: "FILE: PLACE: expected ..., found ...".
class InputError : public std::runtime_error {
 public:
  explicit InputError(const std::string& message);
  InputError(const std::filesystem::path& file, std::string_view message);
  // `place` is a line ("line 12"), a JSON path or a field ("camera 3, width").
  InputError(const std::filesystem::path& file, std::string_view place, std::string_view message);
};

// Says that an option is bad: "name = value: constraint". The name is that of the options' field
// ("min_iterations"); where a constraint speaks of another field, it does so as "name = value",
// too. Programs put their own names for the fields in their place.
class OptionError : public std::runtime_error {
 public:
  explicit OptionError(const std::string& message);
  OptionError(std::string_view name, std::string_view value, std::string_view constraint);

  // Both are empty where the message is no such sentence.
  const std::string& name() const { return name_; }
  const std::string& value() const { return value_; }
  const std::string& constraint() const { return constraint_; }

 private:
  std::string name_, value_, constraint_;
};

namespace internal {
[[noreturn]] void CheckFailed(const char* file, int line, const char* condition,
                              const std::string& detail);
}  // namespace internal

// States what must hold if our code is right; never used on input. Throws std::logic_error.
#define RAYLIFT_CHECK(condition)                                            \
  do {                                                                      \
    if (!(condition)) {                                                     \
      ::raylift::internal::CheckFailed(__FILE__, __LINE__, #condition, {}); \
    }                                                                       \
  } while (false)

// Checks a == b as RAYLIFT_CHECK does, and prints both values.
#define RAYLIFT_CHECK_EQ(a, b)                                                \
  do {                                                                        \
    const auto& check_a_ = (a);                                               \
    const auto& check_b_ = (b);                                               \
    if (!(check_a_ == check_b_)) {                                            \
      ::raylift::internal::CheckFailed(                                       \
          __FILE__, __LINE__, #a " == " #b,                                   \
          std::to_string(check_a_) + " against " + std::to_string(check_b_)); \
    }                                                                         \
  } while (false)

// An output that cannot be written: no space is left, a folder is read-only, a file is in the way.
// The input is not to blame, and the same command may well succeed later. It is an InputError so
// that callers that need not tell the two apart catch both.
class OutputError : public InputError {
 public:
  using InputError::InputError;
};

// The machine lacks what the call needs: a thread cannot be started (memory is std::bad_alloc's).
class ResourceError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// Check a number that an option holds, an int or a double: throw OptionError with the name, the
// value and the constraint where it is out of range or not finite.
template <typename T>
void RequireAtLeast(std::string_view name, T value, std::type_identity_t<T> least);

template <typename T>
void RequirePositive(std::string_view name, T value);

// Says that a file of an open scene cannot be read any more, or has changed. The sender of a
// photograph is not to blame.
class LostFile : public InputError {
 public:
  using InputError::InputError;
};

// Returns what `read` returns, a function that reads files of an open scene; an InputError that it
// throws becomes a LostFile.
template <typename Read>
auto ReadOpened(const Read& read) {
  try {
    return read();
  } catch (const OutputError&) {
    throw;
  } catch (const InputError& error) {
    throw LostFile(error.what());
  }
}

}  // namespace raylift
