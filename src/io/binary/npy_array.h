// Arrays of numbers in numpy's NPY.

#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace raylift {

inline constexpr std::string_view kNpyMagic("\x93NUMPY", 6);
bool IsNpy(std::string_view bytes);

struct NpyHeader {
  std::string descr;
  bool fortran_order = false;
  std::vector<uint64_t> shape;
  size_t data_offset = 0;

  bool swapped() const { return descr[0] == '>'; }
};
// Throws InputError where it is none, or is cut off. Whether the data are all there is the caller's
// to check.
NpyHeader ReadNpyHeader(const std::filesystem::path& file, std::string_view bytes);

// Names a type of numbers and reads them.
struct NpySamples {
  std::string_view code, name;  // "f4", "float32"
  size_t num_bytes;
  void (*to_float)(const char* data, bool swap, std::span<float> values);
  void (*to_double)(const char* data, bool swap, std::span<double> values);
};
// Throws InputError where the elements are no numbers.
const NpySamples& SamplesOf(const std::filesystem::path& file, const NpyHeader& header);

template <typename Value>
struct NpyArray {
  std::vector<uint64_t> shape;
  std::vector<Value> values;  // in C's order, whatever the order in the file
  std::string_view sample_type;
};
// Returns a whole file's array, as float or double. Throws InputError where it is malformed; no
// memory is allocated by an unchecked header.
template <typename Value>
NpyArray<Value> DecodeNpyArray(const std::filesystem::path& file, std::string_view bytes);

}  // namespace raylift
