// Arrays by name in a file that a program in Python wrote: NPZ, HDF5, or NPY, which holds one.

#pragma once

#include <filesystem>
#include <optional>
#include <set>
#include <string>

#include "io/binary/npy_array.h"
#include "io/binary/zip_archive.h"
#include "io/hloc/hdf5_file.h"

namespace raylift {

// Arrays are decoded when they are asked for, as others in the file need not be numbers.
class ArrayFile {
 public:
  static constexpr const char* kOnlyArray = "";  // the name of what is in an NPY

  explicit ArrayFile(const std::filesystem::path& file);

  bool Has(const std::string& name) const;
  // Returns the names in an NPZ or NPY; none are listed of HDF5.
  const std::set<std::string>& names() const { return names_; }

  // Returns the array as float or double, of a batch of one its one. Throws InputError where it is
  // absent or malformed.
  template <typename Value>
  NpyArray<Value> Read(const std::string& name) const;

  // Throws InputError "FILE: NAME: MESSAGE".
  [[noreturn]] void Fail(const std::string& name, const std::string& message) const;
  template <typename Value>
  [[noreturn]] void FailShape(const std::string& name, const NpyArray<Value>& array,
                              std::string_view expected) const {
    FailShape(name, array.shape, expected);
  }

 private:
  [[noreturn]] void FailShape(const std::string& name, const std::vector<uint64_t>& shape,
                              std::string_view expected) const;

  std::filesystem::path file_;
  std::string bytes_;
  std::optional<ZipReader> archive_;
  std::optional<Hdf5Reader> hdf5_;
  std::set<std::string> names_;
};

}  // namespace raylift
