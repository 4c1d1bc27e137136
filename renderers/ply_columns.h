// The rows of a binary PLY element whose properties are all single numbers, by property: any order
// and type. Private to renderers.

#pragma once

#include <filesystem>
#include <optional>
#include <string_view>
#include <vector>

#include "ply_header.h"

namespace raylift {

class PlyColumns {
 public:
  // A property's place in a row.
  struct Column {
    size_t offset;
    PlyType type;
  };

  // The element `name` in the contents of a file. InputError where there is none, it or one before it
  // has a list, the file is not binary, or it ends before the last row.
  PlyColumns(const std::filesystem::path& path, const PlyHeader& header, std::string_view contents,
             std::string_view name);

  size_t num_rows() const { return num_rows_; }

  std::optional<Column> Find(std::string_view property) const;
  // InputError where there is none, or it is of another type.
  Column Get(std::string_view property) const;
  Column Get(std::string_view property, PlyType type) const;

  double At(size_t row, const Column& column) const;

 private:
  template <typename T>
  T Load(const char* from) const;

  std::filesystem::path path_;
  PlyElement element_;
  std::string_view rows_;
  size_t num_rows_ = 0;
  size_t row_bytes_ = 0;
  bool swap_bytes_;
};

}  // namespace raylift
