// Reads and writes HDF5 files in terms of arrays and paths; the C library is hidden.
//
// The library is not thread-safe in most builds: all that it does holds one global lock. It does
// not print its errors; their text is in the InputErrors.

#pragma once

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "raylift/base/file.h"

namespace raylift {

// The kind of numbers that the file holds (they are converted to the type that is asked for).
enum class Hdf5Kind { kHalf, kFloat, kDouble, kInteger };

template <typename T>
struct Hdf5Array {
  std::vector<size_t> shape;
  std::vector<T> values;  // row-major
  Hdf5Kind kind_in_file = Hdf5Kind::kFloat;
};

class Hdf5Reader {
 public:
  explicit Hdf5Reader(std::filesystem::path path);
  ~Hdf5Reader();
  Hdf5Reader(const Hdf5Reader&) = delete;
  Hdf5Reader& operator=(const Hdf5Reader&) = delete;

  const std::filesystem::path& path() const { return path_; }

  // Returns whether there is an object of this path ("group/group/dataset").
  bool Has(const std::string& object) const;
  // Returns the paths of all groups that hold a member of this name, sorted.
  std::vector<std::string> GroupsWith(const std::string& member) const;

  // Reads a data set of floating-point numbers or integers; T: float, double or int64_t, where
  // int64_t takes only integers. Throws InputError naming it where it is absent, of another type,
  // of more elements than the file can hold, or damaged.
  template <typename T>
  Hdf5Array<T> Read(const std::string& dataset) const;

  // Returns the numbers of an attribute; nullopt where the object has none of this name.
  std::optional<std::vector<double>> ReadAttribute(const std::string& object,
                                                   const std::string& name) const;

  // Throws InputError "FILE: OBJECT: MESSAGE".
  [[noreturn]] void Fail(const std::string& object, std::string_view message) const;

 private:
  class Access;

  void Open() const;
  // Throws InputError, unless the environment allows what lies in other files.
  void RefuseOtherFiles(const std::string& object) const;

  std::filesystem::path path_;
  mutable int64_t file_ = -1;   // an hid_t; below 0 after a failure, until it is opened again
  mutable uint64_t inode_ = 0;  // of the file that was opened first
};

// Makes a file that appears under its name when it is complete. Groups on the way are made.
class Hdf5Writer {
 public:
  explicit Hdf5Writer(std::filesystem::path path);
  ~Hdf5Writer();
  Hdf5Writer(const Hdf5Writer&) = delete;
  Hdf5Writer& operator=(const Hdf5Writer&) = delete;

  bool Has(const std::string& object) const;
  void WriteFloats(const std::string& dataset, std::span<const size_t> shape,
                   std::span<const float> values, Hdf5Kind kind);
  void WriteIntegers(const std::string& dataset, std::span<const size_t> shape,
                     std::span<const int64_t> values, int num_bytes_in_file);
  void WriteAttribute(const std::string& object, const std::string& name, double value);
  void Commit();

 private:
  std::filesystem::path path_;
  AtomicFile file_on_disk_;
  int64_t file_ = -1;
};

template <typename T>
void CheckFinite(const Hdf5Reader& file, const std::string& dataset, const std::vector<T>& values) {
  for (size_t i = 0; i < values.size(); ++i) {
    if (!std::isfinite(values[i])) {
      file.Fail(dataset, fmt::format("expected finite numbers, number {} is {}", i + 1, values[i]));
    }
  }
}

inline std::string ToString(const std::vector<size_t>& shape) {
  return shape.empty() ? "one number" : fmt::format("{}", fmt::join(shape, " x "));
}

// Keeps HDF5 from cleaning up when the process ends, for programs, which end when their results are
// written; to be called before anything else. Where a disk was full the cleanup would crash, as it
// goes through files again that it could not close.
void LeaveHdf5AsItIsAtExit();

}  // namespace raylift
