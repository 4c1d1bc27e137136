#include "io/binary/array_file.h"

#include <array>
#include <fstream>
#include <string_view>

#include "base/input_paths.h"
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {

namespace {

constexpr std::string_view kHdf5Magic = "\x89HDF";

bool BeginsAsHdf5(const std::filesystem::path& file) {
  RequireRegularFile(file);
  std::array<char, kHdf5Magic.size()> magic{};
  std::ifstream(file, std::ios::binary).read(magic.data(), magic.size());
  return std::string_view(magic.data(), magic.size()) == kHdf5Magic;
}

std::string_view SampleType(Hdf5Kind kind) {
  return kind == Hdf5Kind::kInteger ? "integer" : kind == Hdf5Kind::kHalf ? "float16" : "float";
}

}  // namespace

ArrayFile::ArrayFile(const std::filesystem::path& file) : file_(file) {
  if (BeginsAsHdf5(file)) {
    hdf5_.emplace(file);
    return;
  }
  bytes_ = ReadFile(file);
  if (!IsZip(bytes_)) {
    names_ = {kOnlyArray};
  } else {
    archive_.emplace(file, bytes_);
    for (const std::string& name : archive_->names()) {
      if (name.ends_with(".npy")) names_.insert(name.substr(0, name.size() - 4));
    }
  }
}

bool ArrayFile::Has(const std::string& name) const {
  return hdf5_ ? hdf5_->Has(name) : names_.contains(name);
}

template <typename Value>
NpyArray<Value> ArrayFile::Read(const std::string& name) const {
  if (!Has(name)) {
    throw InputError(
        file_,
        fmt::format("expected an array \"{}\"{}", name,
                    names_.empty() ? "" : fmt::format(", found {}", fmt::join(names_, ", "))));
  }
  NpyArray<Value> array;
  if (hdf5_) {
    Hdf5Array<Value> read = hdf5_->Read<Value>(name);
    array = {{read.shape.begin(), read.shape.end()},
             std::move(read.values),
             SampleType(read.kind_in_file)};
  } else {
    array = archive_
                ? DecodeNpyArray<Value>(file_.string() + ": " + name, archive_->Read(name + ".npy"))
                : DecodeNpyArray<Value>(file_, bytes_);
  }
  while (array.shape.size() > 2 && array.shape.front() == 1) array.shape.erase(array.shape.begin());
  return array;
}

template NpyArray<float> ArrayFile::Read(const std::string& name) const;
template NpyArray<double> ArrayFile::Read(const std::string& name) const;

void ArrayFile::Fail(const std::string& name, const std::string& message) const {
  if (name == kOnlyArray) throw InputError(file_, message);
  throw InputError(file_, name, message);
}

void ArrayFile::FailShape(const std::string& name, const std::vector<uint64_t>& shape,
                          std::string_view expected) const {
  Fail(name,
       fmt::format("expected {}, found an array of shape ({})", expected, fmt::join(shape, ", ")));
}

}  // namespace raylift
