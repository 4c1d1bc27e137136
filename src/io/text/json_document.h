// Values of a JSON text, read strictly and named by their path in messages
// ("references[2].camera.width").

#pragma once

#include <cstddef>
#include <filesystem>
#include <initializer_list>
#include <memory>
#include <string>
#include <string_view>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "raylift/base/error.h"

namespace raylift {

// A value and its place. Children point to their parent, which must outlive them, as the document
// must.
class JsonPlace {
 public:
  // Returns a member; throws where it is missing or where this is no object.
  JsonPlace Member(std::string_view name) const&;
  JsonPlace Member(std::string_view name) && = delete;
  bool Has(std::string_view name) const;
  // Throws where this is no object, or has a member of another name.
  void ExpectMembers(std::initializer_list<std::string_view> names) const;
  JsonPlace At(size_t index) const&;
  JsonPlace At(size_t index) && = delete;
  // Returns the length of an array; throws where this is none.
  size_t ArraySize() const;
  void ExpectArraySize(size_t size) const;

  bool IsNull() const;
  bool IsArray() const;
  bool IsNumber() const;
  std::string String() const;
  double Number() const;  // JSON has only finite ones
  int Int() const;
  bool Bool() const;
  template <int N>
  Eigen::Matrix<double, N, 1> Vector() const {
    ExpectArraySize(N);
    Eigen::Matrix<double, N, 1> vector;
    for (int i = 0; i < N; ++i) vector[i] = At(static_cast<size_t>(i)).Number();
    return vector;
  }
  // Returns a rotation from four numbers, w first, of length 1.
  Eigen::Quaterniond Rotation() const;

  // Throws InputError "FILE: PATH: MESSAGE".
  [[noreturn]] void Fail(std::string_view message) const;
  // Returns what `use` does; what is wrong with it is wrong here.
  template <typename Use>
  auto Blame(const Use& use) const {
    try {
      return use();
    } catch (const InputError& error) {
      Fail(error.what());
    }
  }

 private:
  friend class JsonDocument;

  JsonPlace(const void* root, std::string_view file) : value_(root), file_(file) {}
  JsonPlace(const void* value, const JsonPlace& parent, std::string_view name, size_t index)
      : value_(value), file_(parent.file_), parent_(&parent), name_(name), index_(index) {}

  [[noreturn]] void FailToBe(std::string_view expected) const;
  std::string Path() const;

  const void* value_;  // of the JSON library, which no header shows
  std::string_view file_;
  const JsonPlace* parent_ = nullptr;
  std::string_view name_;  // empty: an element of an array
  size_t index_ = 0;
};

// Parses a text.
class JsonDocument {
 public:
  // Throws InputError naming the file for malformed JSON.
  JsonDocument(std::string_view json, const std::filesystem::path& file);
  ~JsonDocument();

  JsonPlace Root() const;

 private:
  struct Impl;
  std::unique_ptr<const Impl> impl_;
};

}  // namespace raylift
