// Numbers as the bytes of files.

#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstring>
#include <span>
#include <string_view>

namespace raylift {

// Returns the number whose bytes begin at `from`, of this machine's byte order or the other one.
template <typename T>
T LoadNumber(const char* from, bool swap_bytes = false) {
  std::array<char, sizeof(T)> bytes;
  std::memcpy(bytes.data(), from, sizeof(T));
  if (swap_bytes) std::reverse(bytes.begin(), bytes.end());
  return std::bit_cast<T>(bytes);
}

// Returns values as they are in memory.
template <typename T, size_t kCount>
std::string_view AsBytes(std::span<T, kCount> values) {
  return {reinterpret_cast<const char*>(values.data()), values.size_bytes()};
}

}  // namespace raylift
