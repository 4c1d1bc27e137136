// What readers of HDF5 files say of arrays. Private to io.

#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "io/hloc/hdf5_file.h"
#include <fmt/format.h>
#include <fmt/ranges.h>

namespace raylift {

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

}  // namespace raylift
